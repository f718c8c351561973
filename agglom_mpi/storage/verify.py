"""Structure and checksums of a campaign file: what is whole and what is damaged.

Rows refer to rows that were written before them. So the tables are read against the order of
writing: whatever a row refers to is then there, also while a run goes on.
"""

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from agglom_mpi.storage.access import damage_named, open_file, read_attributes
from agglom_mpi.storage.columns import fitted
from agglom_mpi.storage.contents import Key, VerificationReport, row_list
from agglom_mpi.storage.reader import Status
from agglom_mpi.storage.schema import CAMPAIGN_STATES, layouts
from agglom_mpi.storage.table import Rows, Table, checksum_ok, concatenated, runs_of

WRITTEN_WITHIN: Final = 0.05
"""Seconds after which a row that was being written is whole."""
_READ: Final = ("generations", "results", "samples", "strings", "failures", "legs")


def read_contents(path: str | os.PathLike[str]) -> VerificationReport:
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


def _read(file: h5py.File, path: Path) -> VerificationReport:
    attributes, status = read_attributes(file, path), _status(file, path)
    tables = (*_READ, "final_particles", "frames")
    contents = VerificationReport(path, attributes, status, {}, {name: set() for name in tables})
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


def _check_shapes(file: h5py.File, contents: VerificationReport) -> None:
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


def _final_rows(file: h5py.File, table: Table, contents: VerificationReport) -> np.ndarray:
    """Rows of a table that are whole and in their places."""
    name = table.rows.name.removeprefix("/")
    done = table.done.read_all()
    places = np.flatnonzero(done)
    odd = places[done[places] != 1]
    if len(odd):
        keys = [_key(name, int(place), contents) for place in odd]
        contents.faults.append(f"{name}_done: neither 0 nor 1 for {row_list(keys)}")
    parts = [table.rows.read(first, count) for first, count in runs_of(done)]
    rows = concatenated(parts, table.rows.dtype)
    whole = checksum_ok(rows)
    if not whole.all():  # perhaps a row that is being written again, as those of /legs are
        if _status(file, contents.path).state == "running":
            time.sleep(WRITTEN_WITHIN)
        for at in np.flatnonzero(~whole):
            rows[at] = table.rows.read(int(places[at]), 1)[0]
        whole = checksum_ok(rows)
    torn = {_key(name, int(place), contents) for place in places[~whole]}
    if torn:
        contents.lose(name, torn, "with a wrong checksum")
    astray = whole & (_own_places(name, rows, contents) != places)
    if astray.any():  # a resume would believe the numbers in the row
        strangers = {_key(name, int(place), contents) for place in places[astray]}
        contents.lost[name] |= strangers
        contents.faults.append(f"{name}: numbers of another row in {row_list(strangers)}")
    return fitted(rows[whole & ~astray], table.dtype)


def _own_places(name: str, rows: np.ndarray, contents: VerificationReport) -> np.ndarray:
    """Places of rows as their own numbers have it."""
    if name in ("strings", "results"):
        return rows["string"]
    if name == "generations":
        return rows["generation"]
    if name == "samples":
        return rows["string"] * int(contents.attributes["max_samples"]) + rows["sample"]
    return np.arange(len(rows))


def _key(name: str, place: int, contents: VerificationReport) -> Key:
    if name != "samples":
        return place
    return divmod(place, int(contents.attributes["max_samples"]))


REPLACED_WITHIN: Final = 0.1
"""Seconds after which a picture that takes the place of another is whole."""
_READ_BYTES: Final = 1 << 25


def check_particles(file: h5py.File, contents: VerificationReport) -> None:
    """Verify checksums, and that rows are what belongs there.

    A final state must have as many particles as its sample says, and a picture its place among
    those of its sample. That a final state is absent cannot be seen: a leg need not have stored
    any.
    """
    rows = contents.rows["samples"][["string", "sample", "particles"]].tolist()
    left = {(string, sample): particles for string, sample, particles in rows}
    if "final_particles" in file:
        _check_finals(Table(file, "final_particles", contents.path), left, contents)
    if "frames" in file:
        _check_frames(Table(file, "frames", contents.path), contents)


def _check_finals(
    table: Table, left: dict[tuple[int, int], int], contents: VerificationReport
) -> None:
    torn: set[Key] = set()
    astray: set[Key] = set()
    most = int(contents.attributes["max_samples"])
    for place, whole, row in _rows(table, ["string", "sample", "particles"]):
        key = divmod(place, most)
        if not whole:
            torn.add(key)
        elif row[:2] != key or left.get(key, row[2]) != row[2]:
            astray.add(key)
    _tell(table, "final_particles", torn, astray, contents)


def _check_frames(table: Table, contents: VerificationReport) -> None:
    torn: set[Key] = set()
    stored: dict[int, tuple[int, ...]] = {}
    for place, whole, row in _rows(table, ["string", "sample", "frame"]):
        if whole:
            stored[place] = row
        else:
            torn.add(place)
    settled = contents.status.state == "finished"  # before, others may be taking their places
    count = 1 + max((row[2] for row in stored.values()), default=0)
    first = {place // count: row[:2] for place, row in reversed(stored.items())}
    astray: set[Key] = {
        place
        for place, (string, sample, frame) in stored.items()
        if settled and (place % count != frame or first[place // count] != (string, sample))
    }
    _tell(table, "frames", torn, astray, contents)
    all_of = {block * count + frame for block in first for frame in range(count)}
    if settled:
        contents.miss("frames", all_of - stored.keys(), "though others of their samples are there")


def _rows(table: Table, columns: list[str]) -> Iterator[tuple[int, bool, tuple[int, ...]]]:
    """Place of each final row, whether it is whole, and what is in some columns."""
    step = max(1, _READ_BYTES // table.rows.dtype.itemsize)
    for first, length in table.runs():
        for at in range(first, first + length, step):
            rows = table.rows.read(at, min(step, first + length - at))
            whole = checksum_ok(rows)
            for i, row in enumerate(rows[columns].tolist()):
                if whole[i]:
                    yield at + i, True, row
                else:
                    yield from _again(table, at + i, columns)


def _again(
    table: Table, place: int, columns: list[str]
) -> Iterator[tuple[int, bool, tuple[int, ...]]]:
    """Look once more at a row that was not whole: perhaps it was being replaced."""
    time.sleep(REPLACED_WITHIN)
    found = table.read(place, 1)
    if found.damaged:
        yield place, False, ()
    for row in found.rows[columns].tolist():
        yield place, True, row


def _tell(
    table: Table, name: str, torn: set[Key], astray: set[Key], contents: VerificationReport
) -> None:
    contents.counts[name] = int(np.count_nonzero(table.done.read_all())) - len(torn)
    if torn:
        contents.lose(name, torn, "with a wrong checksum")
    if astray:
        contents.faults.append(f"{name}: not what belongs there in {row_list(astray)}")
