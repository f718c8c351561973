"""What a table of a campaign file is: its columns, their types, units and meanings."""

from typing import Final, NamedTuple

import h5py
import numpy as np


class Column(NamedTuple):
    """One column of a table: storage type, unit, meaning and, for vectors, its shape.

    Files have it from the format version `since` on.
    """

    name: str
    dtype: str
    unit: str
    meaning: str
    shape: tuple[int, ...] = ()
    since: int = 1


class TableSchema(NamedTuple):
    """One table: what a row is, where it lies, and its columns."""

    name: str
    meaning: str
    row: str
    fields: tuple[Column, ...]

    @property
    def dtype(self) -> np.dtype:
        """The packed row type, texts as fixed-size UTF-8."""
        return np.dtype([(field.name, _scalar(field.dtype), field.shape) for field in self.fields])

    def at(self, version: int) -> "TableSchema":
        """Return the table as files of a format version have it."""
        fields = tuple(field for field in self.fields if field.since <= version)
        return self._replace(fields=fields)

    @property
    def done(self) -> str:
        """Name of the dataset that says which rows are final."""
        return f"{self.name}_done"

    @property
    def final(self) -> bool:
        """Whether rows carry a checksum and a done byte."""
        return self.fields[-1] is CRC


def fitted(rows: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return rows, (n,), with the columns of another row type, by name.

    What the rows lack is nan, 0 or empty.
    """
    if rows.dtype == dtype:
        return rows
    found = np.zeros(len(rows), dtype)
    for name in dtype.names or ():
        if name in (rows.dtype.names or ()):
            found[name] = rows[name]
        elif dtype[name].base.kind == "f":
            found[name] = np.nan
    return found


def _scalar(code: str) -> np.dtype:
    return h5py.string_dtype("utf-8", int(code[1:])) if code[0] == "S" else np.dtype(code)


CRC: Final = Column("crc", "u4", "", "zlib.crc32 of the bytes of this row with this field zero")
