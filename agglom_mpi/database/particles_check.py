"""What is whole in the tables of particles, which may be too large to be read at once."""

import time
from collections.abc import Iterator
from typing import Final

import h5py
import numpy as np

from agglom_mpi.database.contents import Contents, Key, named
from agglom_mpi.database.table import Table, are_whole

REPLACED_WITHIN: Final = 0.1
"""Seconds after which a picture that takes the place of another is whole."""
_READ_BYTES: Final = 1 << 25


def check_particles(file: h5py.File, contents: Contents) -> None:
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


def _check_finals(table: Table, left: dict[tuple[int, int], int], contents: Contents) -> None:
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


def _check_frames(table: Table, contents: Contents) -> None:
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
            whole = are_whole(rows)
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


def _tell(table: Table, name: str, torn: set[Key], astray: set[Key], contents: Contents) -> None:
    contents.counts[name] = int(np.count_nonzero(table.done.read_all())) - len(torn)
    if torn:
        contents.lose(name, torn, "with a wrong checksum")
    if astray:
        contents.faults.append(f"{name}: not what belongs there in {named(astray)}")
