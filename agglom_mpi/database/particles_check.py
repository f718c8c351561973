"""What is whole in the tables of particles, which may be too large to be read at once."""

import time
from typing import Final

import h5py
import numpy as np

from agglom_mpi.database.contents import Contents, Key, named
from agglom_mpi.database.table import Table, checksums

REPLACED_WITHIN: Final = 0.1
"""Seconds after which a picture that takes the place of another is whole."""
_READ_BYTES: Final = 1 << 25


def check_particles(file: h5py.File, contents: Contents) -> None:
    """Verify checksums, and that rows are of samples that are there with as many particles."""
    for name in ("final_particles", "frames"):
        if name in file:
            _check_table(Table(file, name, contents.path), name, contents)


def _check_table(table: Table, name: str, contents: Contents) -> None:
    torn: set[Key] = set()
    astray: set[Key] = set()
    left = _particles_left(contents)
    step = max(1, _READ_BYTES // table.rows.dtype.itemsize)
    for first, length in table.runs():
        for at in range(first, first + length, step):
            rows = table.rows.read(at, min(step, first + length - at))
            whole = checksums(rows) == rows["crc"]
            keys = [_key(name, at + i, contents) for i in range(len(rows))]
            if not whole.all():
                time.sleep(REPLACED_WITHIN)
            places = (at + int(i) for i in np.flatnonzero(~whole))
            torn |= {_key(name, place, contents) for place in places if _torn(table, place)}
            if name == "final_particles":
                pairs = rows[["string", "sample", "particles"]].tolist()
                astray |= {
                    key
                    for key, good, (*pair, count) in zip(keys, whole, pairs, strict=True)
                    if good and (tuple(pair) != key or left.get(key, count) != count)
                }
    contents.counts[name] = int(np.count_nonzero(table.done.read_all())) - len(torn)
    if torn:
        contents.lose(name, torn, "with a wrong checksum")
    if astray:
        contents.faults.append(f"{name}: not what the sample says in {named(astray)}")


def _torn(table: Table, place: int) -> bool:
    """Whether a row is final and still not whole: that of a picture may have been replaced."""
    return table.read(place, 1).damaged > 0


def _particles_left(contents: Contents) -> dict[Key, int]:
    rows = contents.rows["samples"][["string", "sample", "particles"]].tolist()
    return {(string, sample): particles for string, sample, particles in rows}


def _key(name: str, place: int, contents: Contents) -> Key:
    if name == "frames":
        return place
    return divmod(place, int(contents.attributes["max_samples"]))
