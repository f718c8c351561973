"""Tables of the campaign file: their columns, also of censuses; the meaning of a row's number."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.measurements.layout import (
    COUNTS,
    LARGEST,
    MASSES,
    TEMPERATURES,
    CensusLayout,
    Layouts,
    prefix_of,
)
from agglom_mpi.outcome import COLUMNS


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
    def datasets(self) -> tuple[str, ...]:
        """Names of the dataset of rows and, if there is one, that of done bytes."""
        return (self.name, self.done)[: 1 + self.final]

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


def layouts_of(layout: Layouts) -> Mapping[str, CensusLayout]:
    """Return layouts by the name of the experiment, which is empty where a campaign has none."""
    return {"": layout} if isinstance(layout, CensusLayout) else layout


def census_columns(layout: Layouts | None) -> tuple[Column, ...]:
    """Return the columns of the censuses of a sample; none without a layout.

    Those of an experiment follow the results of its simulation, and all begin with its name.
    """
    if layout is None:
        return ()
    found: list[Column] = []
    for experiment, own in layouts_of(layout).items():
        columns, prefix = _columns_of(own), ""
        if experiment:
            prefix = prefix_of(experiment)
            results = (Column(c.name, c.dtype, c.unit, c.meaning) for c in COLUMNS)
            columns = (*results, *columns)
        found += (each._replace(name=f"{prefix}{each.name}") for each in columns)
    return tuple(found)


def _columns_of(layout: CensusLayout) -> tuple[Column, ...]:
    """Return the columns of the censuses of one experiment."""
    times, shape = (len(layout.times),), (len(layout.times), layout.classes)
    where = "by time and class; see the attribute census; 0 if it failed"
    return (
        Column(COUNTS, "u4", "1", f"particles, {where}", shape, since=5),
        Column(MASSES, "f8", "kg", f"their mass, {where}", shape, since=5),
        Column(LARGEST, "f8", "kg", "mass of the largest particle, by time", times, since=5),
        Column(TEMPERATURES, "f8", "K", "mass-weighted mean temperature, by time", times, since=5),
    )
