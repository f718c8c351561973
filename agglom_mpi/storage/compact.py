"""A compact copy of a campaign file: the same tables, as short as they are, compressed."""

import time
from pathlib import Path
from typing import Final, NamedTuple

import h5py
import numpy as np

from agglom_mpi.storage.access import NotACampaign, open_file
from agglom_mpi.storage.files import CheckedFile, atomic_file, new_file
from agglom_mpi.storage.schema import TableSchema, table_schemas
from agglom_mpi.storage.table import Rows, checksum_ok

CHUNK_BYTES: Final = 1 << 18
"""Size of a chunk before compression; several fit into HDF5's cache of 1 MiB."""
REWRITE_SECONDS: Final = 0.1
"""Longer than a row of `/legs` takes to be rewritten in place."""


class Copied(NamedTuple):
    """What a compact copy holds; damaged rows are final ones with a wrong checksum."""

    strings: int
    samples: int
    damaged: int


def write_compact(source: Path, target: Path) -> Copied:
    """Write a chunked, compressed copy of what is final in a campaign file, also a growing one.

    Attributes, rows, checksums and done bytes are the same; the attribute `strings` and the
    tables are as short as what they hold, but not empty. A damaged row is copied as it is.

    Raises
    ------
    NotACampaign
        If the source is none, or parts of it cannot be read.
    FileExistsError
        If there is a target already.
    OSError
        If the target cannot be written; nothing is left behind.
    """
    with open_file(source) as old, atomic_file(target) as temporary:
        attributes = dict(old.attrs)
        tables = table_schemas(attributes)
        # Before the rows, for the last word of a run is that it has finished.
        plain = {t.name: _read(old, t.name, source) for t in tables if not t.final}
        final = final_rows(old, source)
        damaged = 0
        with new_file(temporary) as (new, disc):
            rooms = {name: len(final[name]) for name in ("strings", "frames") if name in final}
            new.attrs.update(attributes | rooms)
            for table in tables:
                if not table.final:
                    _compressed(new, old[table.name], plain[table.name])
                    continue
                damaged += _copy(old, new, table, final[table.name], source, disc)
                _compressed(new, old[table.done], final[table.name].astype("u1"))
    strings, samples = (int(final[name].sum()) for name in ("strings", "samples"))
    return Copied(strings, samples, damaged)


def final_rows(file: h5py.File, path: Path) -> dict[str, np.ndarray]:
    """Which rows of each table are final, up to the last one, as bool arrays of length ≥ 1.

    A run writes strings, then their samples, then judgements, then the generation. Read the
    other way round, no row is there without those that it rests on.
    """
    final = {
        name: _up_to_last(_read(file, f"{name}_done", path) != 0)
        for name in ("legs", "generations", "results", "failures", "strings")
    }
    strings = len(final["strings"])
    short = final["results"]
    final["results"] = np.zeros(strings, bool)
    final["results"][: len(short)] = short[:strings]
    count = strings * int(file.attrs["max_samples"])
    final["samples"] = _read(file, "samples_done", path, 0, count) != 0
    if "final_particles" in file:
        whole = _read(file, "final_particles_done", path, 0, count) != 0
        final["final_particles"] = whole & final["samples"]
    if "frames" in file:
        final["frames"] = _up_to_last(_read(file, "frames_done", path) != 0)
    return final


def _up_to_last(final: np.ndarray) -> np.ndarray:
    found = np.flatnonzero(final)
    return final[: max(1, int(found[-1]) + 1 if len(found) else 0)]


def _copy(
    old: h5py.File,
    new: h5py.File,
    table: TableSchema,
    final: np.ndarray,
    source: Path,
    disc: CheckedFile,
) -> int:
    """Copy the final rows of a table, chunk by chunk; how many of them are damaged."""
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
        disc.check()
    return damaged


def _compressed(new: h5py.File, dataset: h5py.Dataset, rows: np.ndarray) -> None:
    _dataset(new, dataset, len(rows))[:] = rows


def _dataset(new: h5py.File, dataset: h5py.Dataset, length: int) -> h5py.Dataset:
    """Make a chunked dataset of this length with the type and the attributes of another."""
    chunk = min(length, max(1, CHUNK_BYTES // dataset.dtype.itemsize))
    storage = {"chunks": (chunk,), "compression": "gzip", "shuffle": True}
    copy = new.create_dataset(dataset.name, (length,), dataset.dtype, **storage)
    copy.attrs.update(dataset.attrs)
    return copy


def _read(
    file: h5py.File, name: str, path: Path, first: int = 0, count: int | None = None
) -> np.ndarray:
    rows = Rows(file[name], path)
    try:
        return rows.read(first, rows.capacity - first if count is None else count)
    except OSError as error:
        raise NotACampaign(f"{path}: a damaged campaign file: /{name} cannot be read") from error
