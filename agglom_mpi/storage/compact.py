"""A compact copy of a campaign file: the same tables, as short as they are, compressed."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

import h5py
import numpy as np

from agglom_mpi.storage.access import DamagedCampaign, open_file, report_damage
from agglom_mpi.storage.checksums import CHECKSUMS, checksum_ok, write_checksums
from agglom_mpi.storage.files import CheckedFile, atomic_file, new_file
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import TableSchema, volume_table
from agglom_mpi.storage.table import REWRITE_SECONDS

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
        final = final_rows(old, source)
        damaged = 0
        with new_file(temporary) as (new, checked):
            lengths = {name: len(final[name]) for name in ("strings", "frames") if name in final}
            new.attrs.update(attributes | lengths)
            if CHECKSUMS in attributes:
                write_checksums(new, lengths)
            for table in tables:
                if not table.final:
                    _write_compressed(new, old[table.name], plain[table.name])
                    continue
                damaged += _copy(old, new, table, final[table.name], source, checked)
                _write_compressed(new, old[table.done], final[table.name].astype("u1"))
    strings, samples = (int(final[name].sum()) for name in ("strings", "samples"))
    return CopyCounts(strings, samples, damaged)


def final_rows(file: h5py.File, path: Path) -> dict[str, np.ndarray]:
    """Return which rows of each table are final, up to the last one: bool arrays of length ≥ 1.

    A run writes strings, then their samples, then results, then the generation. Read the other
    way round, no row is there without those that it rests on.
    """
    order = ("legs", "generations", "results", "failures", "strings")
    places = {name: _final_places(file, name, path) for name in order}
    strings = _length(places["strings"])
    final = {name: _flags(places[name], _length(places[name])) for name in order}
    final["results"] = _flags(places["results"], strings)
    sizes = TableSizes.of(file.attrs)
    count = strings * sizes.sample_room
    final["samples"] = _flags(_final_places(file, "samples", path, count), count)
    if "final_particles" in file:
        whole = _flags(_final_places(file, "final_particles", path, count), count)
        final["final_particles"] = whole & final["samples"]
    fresh = strings * sizes.fresh
    for table in map(volume_table, sizes.volumes):
        final[table] = _flags(_final_places(file, table, path, fresh), max(1, fresh))
    if "frames" in file:
        frames = _final_places(file, "frames", path)
        final["frames"] = _flags(frames, _length(frames))
    return final


def _final_places(file: h5py.File, name: str, path: Path, count: int | None = None) -> np.ndarray:
    """Return the numbers of the final rows among the first `count` of a table (default: all)."""
    with _naming_table(path, f"{name}_done"):
        return Rows(file[f"{name}_done"], path).nonzero(0, count)


def _length(places: np.ndarray) -> int:
    """Return how many rows a copy has of a table with these final rows: one at least."""
    return int(places[-1]) + 1 if len(places) else 1


def _flags(places: np.ndarray, length: int) -> np.ndarray:
    """Return which of the first `length` rows are final, bool."""
    flags = np.zeros(length, bool)
    flags[places[places < length]] = True
    return flags


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
