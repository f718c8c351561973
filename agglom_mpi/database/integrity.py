"""What is whole in a campaign file, and what is damaged: structure, done bytes and checksums.

Rows refer to rows that were written before them. So the tables are read against the order of
writing: whatever a row refers to is then there, also while a run goes on.
"""

import os
import time
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from agglom_mpi.database.access import damage_named, open_file, read_attributes
from agglom_mpi.database.contents import Contents, Key, named
from agglom_mpi.database.particles_check import check_particles
from agglom_mpi.database.reader import Status
from agglom_mpi.database.schema import CAMPAIGN_STATES, layouts
from agglom_mpi.database.table import Rows, Table, are_whole, joined, unbroken

WRITTEN_WITHIN: Final = 0.05
"""Seconds after which a row that was being written is whole."""
_READ: Final = ("generations", "results", "samples", "strings", "failures", "legs")


def read_contents(path: str | os.PathLike[str]) -> Contents:
    """Read everything that is final, and find out whether it is whole.

    Raises
    ------
    NotACampaign
        If it is something else, or so badly damaged that no resume would open it
        (`DamagedCampaign`).
    OSError
        If it is missing or cannot be read.
    """
    path = Path(path)
    with open_file(path) as file, damage_named(path):
        return _read(file, path)


def _read(file: h5py.File, path: Path) -> Contents:
    attributes, status = read_attributes(file, path), _status(file, path)
    tables = (*_READ, "final_particles", "frames")
    contents = Contents(path, attributes, status, {}, {name: set() for name in tables})
    _check_shapes(file, contents)
    for name in _READ:
        contents.rows[name] = _final_rows(file, Table(file, name, path), contents)
    check_particles(file, contents)
    contents.rows["variables"] = Rows(file["variables"], path).read_all()
    generations = Table(file, "generations", path)
    contents.recorded = {at for first, n in generations.runs() for at in range(first, first + n)}
    ended = contents.status.state in ("stopped", "finished")
    contents.settled = ended and contents.status == _status(file, path)
    if contents.status.state not in CAMPAIGN_STATES:
        contents.faults.append(f"status: unknown state {contents.status.state!r}")
    return contents


def _status(file: h5py.File, path: Path) -> Status:
    row = Rows(file["status"], path).read_all()[0]
    texts = [row[name].decode(errors="replace") for name in ("state", "reason")]
    return Status(texts[0], float(row["updated"]), texts[1])


def _check_shapes(file: h5py.File, contents: Contents) -> None:
    strings, most = (int(contents.attributes[name]) for name in ("strings", "max_samples"))
    wanted = {"strings": strings, "results": strings, "samples": strings * most}
    wanted["final_particles"] = strings * most
    wanted["frames"] = int(contents.attributes.get("frames", 0))
    for layout in layouts(contents.attributes):
        room = len(file[layout.name])
        contents.room[layout.name] = room
        if layout.final and len(file[layout.done]) != room:
            raise IndexError(f"/{layout.done} is not as long as /{layout.name}")
        if wanted.get(layout.name, room) != room:
            raise IndexError(f"/{layout.name} has {room} rows, not {wanted[layout.name]}")


def _final_rows(file: h5py.File, table: Table, contents: Contents) -> np.ndarray:
    """Rows of a table that are whole and in their places."""
    name = table.rows.name.removeprefix("/")
    done = table.done.read_all()
    places = np.flatnonzero(done)
    odd = places[done[places] != 1]
    if len(odd):
        keys = [_key(name, int(place), contents) for place in odd]
        contents.faults.append(f"{name}_done: neither 0 nor 1 for {named(keys)}")
    parts = [table.rows.read(first, count) for first, count in unbroken(done)]
    rows = joined(parts, table.rows.dtype)
    whole = are_whole(rows)
    if not whole.all():  # perhaps a row that is being written again, as those of /legs are
        if _status(file, contents.path).state == "running":
            time.sleep(WRITTEN_WITHIN)
        for at in np.flatnonzero(~whole):
            rows[at] = table.rows.read(int(places[at]), 1)[0]
        whole = are_whole(rows)
    torn = {_key(name, int(place), contents) for place in places[~whole]}
    if torn:
        contents.lose(name, torn, "with a wrong checksum")
    astray = whole & (_own_places(name, rows, contents) != places)
    if astray.any():  # a resume would believe the numbers in the row
        strangers = {_key(name, int(place), contents) for place in places[astray]}
        contents.lost[name] |= strangers
        contents.faults.append(f"{name}: numbers of another row in {named(strangers)}")
    return rows[whole & ~astray]


def _own_places(name: str, rows: np.ndarray, contents: Contents) -> np.ndarray:
    """Places of rows as their own numbers have it."""
    if name in ("strings", "results"):
        return rows["string"]
    if name == "generations":
        return rows["generation"]
    if name == "samples":
        return rows["string"] * int(contents.attributes["max_samples"]) + rows["sample"]
    return np.arange(len(rows))


def _key(name: str, place: int, contents: Contents) -> Key:
    if name != "samples":
        return place
    return divmod(place, int(contents.attributes["max_samples"]))
