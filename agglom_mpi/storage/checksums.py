"""Checksums of a campaign file: of each row, of each attribute, and of the box."""

import json
import zlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.storage.schema import CHECKED_SINCE, VARIABLE_TABLE

if TYPE_CHECKING:
    import h5py

CHECKSUMS: Final = "checksums"
"""Attribute with the checksums of the others, and of `/variables`, by name."""
_ROWS_AT_ONCE: Final = 1 << 14
"""Number of rows that are copied at once to compute their checksums."""
_BOX: Final = f"/{VARIABLE_TABLE.name}"
"""Name of the checksum of the rows of `/variables`."""


def checksum_ok(rows: np.ndarray) -> np.ndarray:
    """Return whether each row has the right checksum, or its table has none, (n,) bool."""
    if "crc" not in (rows.dtype.names or ()):
        return np.ones(len(rows), bool)
    return checksums(rows) == rows["crc"]


def checksums(rows: np.ndarray) -> np.ndarray:
    """Return the CRC-32 of the bytes of each row with its `crc` zero, (n,) uint32."""
    if len(rows) > _ROWS_AT_ONCE:
        parts = range(0, len(rows), _ROWS_AT_ONCE)
        return np.concatenate([checksums(rows[at : at + _ROWS_AT_ONCE]) for at in parts])
    blank = rows.copy()
    blank["crc"] = 0
    raw = memoryview(blank.tobytes())
    size = rows.dtype.itemsize
    return np.array(
        [zlib.crc32(raw[at : at + size]) for at in range(0, len(raw), size)], dtype=np.uint32
    )


def write_checksums(file: "h5py.File", changed: Iterable[str] | None = None) -> None:
    """Write the attribute `checksums` of a file: those that have `changed`, by default all.

    So the checksum of an altered attribute that is copied still does not fit.
    """
    known = {} if changed is None else json.loads(file.attrs[CHECKSUMS])
    every = [_BOX, *(f"{name}/{key}" for name, part in file.items() for key in part.attrs)]
    names = [*every, *(file.attrs.keys() - {CHECKSUMS})] if changed is None else changed
    file.attrs[CHECKSUMS] = json.dumps(known | {name: _checksum(file, name) for name in names})


def altered_parts(file: "h5py.File") -> list[str]:
    """Return the names of attributes and tables that differ from their checksums, or are absent.

    Files of versions before `CHECKED_SINCE` have none. Attributes that others have added do not
    count.
    """
    if CHECKSUMS not in file.attrs:
        return [CHECKSUMS] if file.attrs["format_version"] >= CHECKED_SINCE else []
    try:
        known = dict(json.loads(file.attrs[CHECKSUMS]))
    except (RecursionError, TypeError, ValueError):
        return [CHECKSUMS]
    return [name for name, checksum in known.items() if _checksum(file, name) != checksum]


def _checksum(file: "h5py.File", name: str) -> int | None:
    """Return the CRC-32 of an attribute, as JSON, or of the rows of `/variables`; None: absent."""
    if name == _BOX:
        return zlib.crc32(file[name][...].tobytes())
    table, _, key = name.rpartition("/")
    if (table and table not in file) or key not in file[table or "/"].attrs:
        return None
    value = np.asarray(file[table or "/"].attrs[key], object).tolist()
    return zlib.crc32(json.dumps(value, default=repr).encode())
