"""What a table of a campaign file is: its columns, their types, units and meanings."""

from typing import Final, NamedTuple

import h5py
import numpy as np


class Field(NamedTuple):
    """One column of a table: storage type, unit, meaning and, for vectors, its shape."""

    name: str
    dtype: str
    unit: str
    meaning: str
    shape: tuple[int, ...] = ()


class Layout(NamedTuple):
    """One table: what a row is, where it lies, and its columns."""

    name: str
    meaning: str
    row: str
    fields: tuple[Field, ...]

    @property
    def dtype(self) -> np.dtype:
        """The packed row type, texts as fixed-size UTF-8."""
        return np.dtype([(field.name, _scalar(field.dtype), field.shape) for field in self.fields])

    @property
    def done(self) -> str:
        """Name of the dataset that says which rows are final."""
        return f"{self.name}_done"

    @property
    def final(self) -> bool:
        """Whether rows carry a checksum and a done byte."""
        return self.fields[-1] is CRC


def _scalar(code: str) -> np.dtype:
    return h5py.string_dtype("utf-8", int(code[1:])) if code[0] == "S" else np.dtype(code)


CRC: Final = Field("crc", "u4", "", "zlib.crc32 of the bytes of this row with this field zero")
