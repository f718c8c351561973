"""A compact copy of a campaign file: the same tables, as short as they are, compressed."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

import h5py
import numpy as np

from agglom_mpi.storage.access import DamagedCampaign, open_file, report_damage
from agglom_mpi.storage.attributes import CHECKSUMS, write_checksums
from agglom_mpi.storage.files import CheckedFile, atomic_file, new_file
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import LEARNED, TableSchema, volume_table
from agglom_mpi.storage.table import REWRITE_SECONDS, checksum_ok

CHUNK_BYTES: Final = 1 << 18
"""Bytes of a chunk before compression; several fit into HDF5's cache of 1 MiB."""


class CopyCounts(NamedTuple):
    """Rows that a compact copy holds; damaged ones are final, but with a wrong checksum."""

    strings: int
    samples: int
    damaged: int


def write_compact(source: Path, target: Path) -> CopyCounts:
    """Write a chunked, compressed copy of what is final in a campaign file, also a growing one.

    Attributes, rows, checksums and done bytes are the same; the attribute `strings` and the
    tables are as short as what they hold, but not empty. A damaged row is copied as it is.

    Raises
    ------
    NotACampaign
        If the source is none; a `DamagedCampaign` if parts of it cannot be read.
    FileExistsError
        If there is a target already.
    OSError
        If the target cannot be written; nothing is left behind.
    """
    with open_file(source) as old, atomic_file(target) as temporary, report_damage(source):
        attributes = dict(old.attrs)
        tables = TableSizes.of(attributes).tables()
        # Before the rows: the file then has all that the status states.
        plain = {t.name: _read(old, t.name, source) for t in tables if not t.final}
        final, length = final_places(old, source)
        damaged = 0
        with new_file(temporary) as (new, checked):
            lengths = {name: length[name] for name in ("strings", "frames") if name in length}
            new.attrs.update(attributes | lengths)
            if CHECKSUMS in attributes:
                write_checksums(new, lengths)
            for table in tables:
                if not table.final:
                    _write_compressed(new, old[table.name], plain[table.name])
                    continue
                done = np.zeros(length[table.name], "u1")
                done[final[table.name]] = 1
                damaged += _copy(old, new, table, done != 0, source, checked)
                _write_compressed(new, old[table.done], done)
    return CopyCounts(len(final["strings"]), len(final["samples"]), damaged)


def final_places(file: h5py.File, path: Path) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Return the numbers of the final rows of each table, and how many rows a copy has: some.

    A run writes strings, then their samples, then results, then the generation. Read the other
    way round, no row is there without those that it rests on.
    """
    found: dict[str, np.ndarray] = {}
    length: dict[str, int] = {}

    def read(name: str, room: int | None = None) -> None:
        if f"{name}_done" in file:
            with _naming_table(path, f"{name}_done"):
                found[name] = Rows(file[f"{name}_done"], path).nonzero(0, room)
            length[name] = max(1, 1 + int(found[name].max(initial=-1)) if room is None else room)

    for name in ("legs", "generations", "results", "failures", "strings"):
        read(name)
    strings, sizes = length["strings"], TableSizes.of(file.attrs)
    found["results"] = found["results"][found["results"] < strings]
    length["results"] = strings
    for name in ("samples", "final_particles"):
        read(name, strings * sizes.sample_room)
    if "final_particles" in found:
        found["final_particles"] = np.intersect1d(found["final_particles"], found["samples"])
    for name in map(volume_table, sizes.volumes):
        read(name, strings * sizes.fresh)
    read("frames")
    read(LEARNED, sizes.learned)
    return found, length


def _copy(
    old: h5py.File,
    new: h5py.File,
    table: TableSchema,
    final: np.ndarray,
    source: Path,
    checked: CheckedFile,
) -> int:
    """Copy the final rows of a table, chunk by chunk; return how many of them are damaged."""
    copy = _dataset(new, old[table.name], len(final))
    step, damaged = copy.chunks[0], 0
    for first in range(0, len(final), step):
        kept = final[first : first + step]
        if not kept.any():
            continue  # a chunk that is not written takes no space and reads as zeros
        part = _read(old, table.name, source, first, len(kept))
        if not checksum_ok(part[kept]).all():
            time.sleep(REWRITE_SECONDS)
            part = _read(old, table.name, source, first, len(kept))
            damaged += int((~checksum_ok(part[kept])).sum())
        part[~kept] = np.zeros(1, part.dtype)
        copy[first : first + len(part)] = part
        checked.check()
    return damaged


def _write_compressed(new: h5py.File, dataset: h5py.Dataset, rows: np.ndarray) -> None:
    _dataset(new, dataset, len(rows))[:] = rows


def _dataset(new: h5py.File, dataset: h5py.Dataset, length: int) -> h5py.Dataset:
    """Create a chunked dataset of a length, with the type and the attributes of another."""
    chunk = min(length, max(1, CHUNK_BYTES // dataset.dtype.itemsize))
    storage = {"chunks": (chunk,), "compression": "gzip", "shuffle": True}
    copy = new.create_dataset(dataset.name, (length,), dataset.dtype, **storage)
    copy.attrs.update(dataset.attrs)
    return copy


def _read(
    file: h5py.File, name: str, path: Path, first: int = 0, count: int | None = None
) -> np.ndarray:
    rows = Rows(file[name], path)
    with _naming_table(path, name):
        return rows.read(first, rows.capacity - first if count is None else count)


@contextmanager
def _naming_table(path: Path, name: str) -> Iterator[None]:
    """Turn the error of a table that cannot be read into a DamagedCampaign that names it."""
    try:
        yield
    except OSError as error:
        raise DamagedCampaign(f"{path}: a damaged campaign file: /{name} cannot be read") from error
