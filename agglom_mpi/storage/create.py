"""Creating a campaign file, and a larger one, or one of other data, with the same rows."""

import json
import os
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from h5py import h5d, h5p, h5s, h5t

from agglom_mpi.storage.access import open_file, refuse_compact
from agglom_mpi.storage.attributes import CHECKSUMS, EARLIER_DATA, write_checksums
from agglom_mpi.storage.files import atomic_file, new_file
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import (
    BY_SAMPLE,
    FORMAT,
    IN_VOLUME,
    LEARNED,
    STATUS,
    VARIABLE_TABLE,
    TableSchema,
    variables_schema,
)
from agglom_mpi.storage.table import Table, make_row, sealed
from agglom_mpi.variables import VariableTable

_COPY_BYTES: Final = 1 << 25
"""Maximum number of bytes that are copied at once."""


def create_campaign_file(
    path: str | os.PathLike[str],
    description: Mapping[str, Any],
    box: tuple[np.ndarray, np.ndarray],
    sizes: TableSizes,
    learned: np.ndarray | None = None,
) -> None:
    """Create the file of a campaign; the caller holds its `CampaignLock`.

    Parameters
    ----------
    path
        The file; it must not exist.
    description
        Attributes that describe the campaign.
    box
        Lower and upper ends of the search box in SI units, (k,); equal where a variable is fixed,
        nan where it is unused.
    sizes
        Sizes of its tables. The attribute `max_samples` of the file counts fresh samples, too.
    learned
        Rows of `/learned`, which has as many; None: there is no such table.

    Raises
    ------
    FileExistsError
        If there is a file already.
    ValueError
        If a table would have no rows.
    OSError
        If it cannot be written; nothing is left behind.
    """
    path = Path(os.path.realpath(path))
    if min(sizes.strings, sizes.max_samples, sizes.generations, sizes.population) < 1:
        raise ValueError("a campaign file needs room for at least one row in every table")
    attributes = {
        "format": FORMAT,
        "format_version": sizes.version,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        **description,
        **sizes.attributes(),
    }
    with atomic_file(path) as temporary, new_file(temporary) as (file, _):
        _lay_out(file, attributes, sizes)
        rows = _variable_rows(sizes.variables, *box)
        Rows(file[VARIABLE_TABLE.name], path).write(0, rows)
        _write_stopped(file, path, "not started yet")
        if learned is not None:
            Table(file, LEARNED, path).write(0, learned)
        write_checksums(file)


def _write_stopped(file: h5py.File, path: Path, reason: str) -> None:
    now = datetime.now(UTC).timestamp()
    status = make_row(STATUS.dtype, state="stopped", updated=now, reason=reason)
    Rows(file[STATUS.name], path).write(0, sealed(status))


def enlarge_campaign_file(path: str | os.PathLike[str], sizes: TableSizes) -> bool:
    """Replace a campaign file by one with more room and the same rows, unless it has enough.

    The caller holds its `CampaignLock` and has no writer open. Samples of the search and the
    population keep the numbers that the file has.

    Returns
    -------
    bool
        Whether it was replaced.

    Raises
    ------
    NotACampaign, OSError
        As from opening for writing, and from writing; the old file is then as it was.
    """
    path = Path(os.path.realpath(path))
    with open_file(path) as old:
        refuse_compact(old, path)
        attributes = dict(old.attrs)
        known = TableSizes.of(attributes, len(old["generations"]))
        wanted = known.enlarged(sizes)
        if wanted == known:
            return False
        _copy_tables(old, path, attributes | wanted.counts(), (known, wanted), known.tables())
        return True


def replace_data(
    path: str | os.PathLike[str], description: Mapping[str, Any], earlier: Mapping[str, Any]
) -> None:
    """Give a campaign file another section `data`: its strings and samples stay, all else goes.

    What is decided again from the samples is no longer in it: results and generations. The caller
    holds its `CampaignLock`; if this fails, the file is as it was.

    Parameters
    ----------
    path
        The file.
    description
        Attributes that describe the campaign with its new data.
    earlier
        The entries of the identity that are no longer valid.
    """
    path = Path(os.path.realpath(path))
    with open_file(path) as old:
        refuse_compact(old, path)
        attributes = dict(old.attrs)
        known = TableSizes.of(attributes, len(old["generations"]))
        counts = {name: len(Table(old, name, path).done.nonzero()) for name in ("legs", "strings")}
        changes = [*json.loads(attributes.get(EARLIER_DATA, "[]")), counts | {"data": earlier}]
        attributes |= {**description, EARLIER_DATA: json.dumps(changes, sort_keys=True)}
        kept = [each for each in known.tables() if each.name not in ("results", "generations")]
        _copy_tables(old, path, attributes, (known, known), kept, "has new data")


def _copy_tables(
    old: h5py.File,
    path: Path,
    attributes: Mapping[str, Any],
    sizes: tuple[TableSizes, TableSizes],
    tables: Iterable[TableSchema],
    stopped: str = "",
) -> None:
    """Replace a file by one with other attributes and sizes, and the rows of some tables.

    It says that its run is `stopped` if a reason is given.
    """
    known, wanted = sizes
    with atomic_file(path, replace=True) as temporary, new_file(temporary) as (new, _):
        _lay_out(new, attributes, wanted)
        for schema in tables:
            rooms = _samples_of_string(known, schema), _samples_of_string(wanted, schema)
            _copy(old, new, schema, path, *rooms)
        if stopped:
            _write_stopped(new, path, stopped)
        if CHECKSUMS in attributes:
            write_checksums(new)


def _lay_out(file: h5py.File, attributes: Mapping[str, Any], sizes: TableSizes) -> None:
    file.attrs.update(attributes)
    rooms = sizes.capacities()
    for schema in sizes.tables():
        capacity = rooms[schema.name]
        rows = _dataset(file, schema.name, schema.dtype, capacity)
        rows.attrs["meaning"] = schema.meaning
        rows.attrs["row"] = schema.row
        rows.attrs["field_units"] = [field.unit for field in schema.fields]
        rows.attrs["field_meanings"] = [field.meaning for field in schema.fields]
        if schema.final:
            done = _dataset(file, schema.done, np.dtype("u1"), capacity)
            done.attrs["meaning"] = f"1 where a row of /{schema.name} is final, 0 where absent"
            done.attrs["row"] = schema.row
            done.attrs["unit"] = ""


def _dataset(file: h5py.File, name: str, dtype: np.dtype, capacity: int) -> h5py.Dataset:
    """Create a dataset with a fixed place in the file, whose space stays a hole until written."""
    creation = h5p.create(h5p.DATASET_CREATE)
    creation.set_layout(h5d.CONTIGUOUS)
    creation.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    creation.set_fill_time(h5d.FILL_TIME_NEVER)
    # A modification time would be metadata, dirty after every write.
    creation.set_obj_track_times(False)
    stored, space = h5t.py_create(dtype, logical=True), h5s.create_simple((capacity,))
    return h5py.Dataset(h5d.create(file.id, name.encode(), stored, space, creation))


def _variable_rows(variables: VariableTable, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    rows = np.zeros(variables.count, variables_schema(variables).dtype)
    rows["name"] = [variable.name.encode() for variable in variables.variables]
    rows["unit"] = [variable.unit.encode() for variable in variables.variables]
    rows["lower"], rows["upper"] = lower, upper
    rows["searched"] = rows["lower"] < rows["upper"]
    return rows


def _samples_of_string(sizes: TableSizes, schema: TableSchema) -> int:
    """Return how many rows a table of samples has of each string; 0 of another table."""
    return {BY_SAMPLE: sizes.sample_room, IN_VOLUME: sizes.fresh}.get(schema.row, 0)


def _copy(
    old: h5py.File, new: h5py.File, schema: TableSchema, path: Path, before: int, after: int
) -> None:
    """Copy the final rows of a table as they are, checksums included; holes stay holes.

    Rows by string and sample keep these, whatever the room for samples before and after.
    """
    if not schema.final:
        Rows(new[schema.name], path).write(0, Rows(old[schema.name], path).read_all())
        return
    source_table, target = Table(old, schema.name, path), Table(new, schema.name, path)
    step = max(1, _COPY_BYTES // schema.dtype.itemsize)
    for first, count in source_table.runs():
        at = first
        while at < first + count:
            length = min(step, first + count - at)
            place = at
            if before != after:
                string, sample = divmod(at, before)
                length, place = min(length, before - sample), string * after + sample
            target.rows.write(place, source_table.rows.read(at, length))
            target.done.write(place, source_table.done.read(at, length))
            at += length
