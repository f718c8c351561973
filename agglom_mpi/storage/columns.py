"""Tables of the campaign file: their columns, and the meaning of a row's number."""

from typing import Final, NamedTuple

import numpy as np


class Column(NamedTuple):
    """One column of a table: type, unit, meaning, shape of an element, and since which version."""

    name: str
    dtype: str
    unit: str
    meaning: str
    shape: tuple[int, ...] = ()
    since: int = 1


class TableSchema(NamedTuple):
    """One table: its name and meaning, what the number of a row is, and its columns."""

    name: str
    meaning: str
    row: str
    fields: tuple[Column, ...]

    @property
    def dtype(self) -> np.dtype:
        """The packed row type, texts as fixed-size UTF-8."""
        return np.dtype([(field.name, _scalar(field.dtype), field.shape) for field in self.fields])

    def at(self, version: int) -> "TableSchema":
        """Return the schema of a format version."""
        fields = tuple(field for field in self.fields if field.since <= version)
        return self._replace(fields=fields)

    @property
    def done(self) -> str:
        """Name of the dataset of done bytes."""
        return f"{self.name}_done"

    @property
    def final(self) -> bool:
        """Whether rows carry a checksum and a done byte."""
        return self.fields[-1] is CRC


def _scalar(code: str) -> np.dtype:
    if code[0] != "S":
        return np.dtype(code)
    # Imported here: the size of a file is known without HDF5.
    import h5py

    return h5py.string_dtype("utf-8", int(code[1:]))


CRC: Final = Column("crc", "u4", "", "zlib.crc32 of the bytes of this row with this field zero")
