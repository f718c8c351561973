"""A compact copy of a campaign file: the same tables, as short as they are, compressed."""

import time
from pathlib import Path
from typing import Final, NamedTuple

import h5py
import numpy as np

from agglom_mpi.storage.access import DamagedCampaign, open_file, report_damage
from agglom_mpi.storage.files import CheckedFile, atomic_file, new_file
from agglom_mpi.storage.reader import REWRITE_SECONDS
from agglom_mpi.storage.schema import TableSchema, table_schemas
from agglom_mpi.storage.table import Rows, checksum_ok

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
        tables = table_schemas(attributes)
        # Before the rows: what the status tells of is then in the file.
        plain = {t.name: _read(old, t.name, source) for t in tables if not t.final}
        final = final_rows(old, source)
        damaged = 0
        with new_file(temporary) as (new, checked):
            lengths = {name: len(final[name]) for name in ("strings", "frames") if name in final}
            new.attrs.update(attributes | lengths)
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
    try:
        return rows.read(first, rows.capacity - first if count is None else count)
    except OSError as error:
        raise DamagedCampaign(f"{path}: a damaged campaign file: /{name} cannot be read") from error
