"""Tables of the campaign file: their columns, also of censuses; the meaning of a row's number."""

import json
import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.measurements.layout import COUNTS, LARGEST, MASSES, TEMPERATURES, CensusLayout


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


CENSUS: Final = "census"
"""Attribute with times and classes of the censuses of a file; absent without any."""

MAX_CLASSES: Final = 100_000
"""Maximum number of times and classes that an attribute may name."""


def census_columns(layout: CensusLayout | None) -> tuple[Column, ...]:
    """Return the columns of the censuses of a sample; none without a layout."""
    if layout is None:
        return ()
    times, shape = (len(layout.times),), (len(layout.times), layout.classes)
    where = "by time and class; see the attribute census; 0 if it failed"
    return (
        Column(COUNTS, "u4", "1", f"particles, {where}", shape, since=5),
        Column(MASSES, "f8", "kg", f"their mass, {where}", shape, since=5),
        Column(LARGEST, "f8", "kg", "mass of the largest particle, by time", times, since=5),
        Column(TEMPERATURES, "f8", "K", "mass-weighted mean temperature, by time", times, since=5),
    )


def census_attributes(layout: CensusLayout | None) -> dict[str, str]:
    """Return the attribute with the layout of the censuses of a file; none without any.

    Times are in s, null stands for the end of a sample; `edges` are diameters over twice b0.
    """
    if layout is None:
        return {}
    times = [time if math.isfinite(time) else None for time in layout.times]
    entries = {"times": times, "lower": layout.lower, "classes": layout.classes}
    return {CENSUS: json.dumps(entries | {"edges": layout.edges.tolist()})}


def census_of(attributes: Mapping[str, Any]) -> CensusLayout | None:
    """Return the layout of the censuses of a file; None without any.

    Raises
    ------
    ValueError
        If the attribute `census` is none that a run writes.
    """
    text = attributes.get(CENSUS, "")
    if not text:
        return None
    try:
        entries = json.loads(text)
        times = tuple(math.inf if time is None else float(time) for time in entries["times"])
        layout = CensusLayout(times, float(entries["lower"]), int(entries["classes"]))
    except (KeyError, TypeError, ValueError):
        raise ValueError("attribute census is no JSON object of times and classes") from None
    whole = 0 < layout.classes <= MAX_CLASSES and 0 < len(times) <= MAX_CLASSES
    if not whole or not math.isfinite(layout.lower) or list(times) != sorted(set(times)):
        raise ValueError("attribute census has impossible times or classes")
    return layout
