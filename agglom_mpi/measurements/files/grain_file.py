"""The file of grains that a law of sizes may name: one diameter a row."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from agglom_mpi.declaration.bounded_reading import read_bounded
from agglom_mpi.declaration.spelling import MAX_MAGNITUDE
from agglom_mpi.declaration.units import quoted
from agglom_mpi.file_kinds import begins_as_hdf5
from agglom_mpi.measurements.files.size_columns import RELATIVE, SIZES
from agglom_mpi.measurements.files.size_table import CurveKeys, SizeTable, in_metres
from agglom_mpi.measurements.files.text_table import TableError, read_table, too_many_rows

MAX_BYTES: Final = 1 << 23
"""Largest size of a file of sizes."""
MAX_ROWS: Final = 100_000
MAX_RATIO: Final = 100.0
"""Largest over smallest diameter, at most."""
GRAIN_EXAMPLE: Final = "diameter (um)"
"""Heading that messages give as an example."""

GRAINS_REMEDY: Final = (
    "a file of sizes must have one grain per row. For a curve by mass give a law, such as "
    "{law: lognormal, median: d50, spread: (d84/d16)^0.5, basis: volume}"
)
"""Advice on a file that is neither a curve nor a histogram."""


Diameters: TypeAlias = tuple[tuple[float, ...], bool]
"""Diameters of grains, and whether they are in m; otherwise they are relative to each other."""


def read_diameters(folder: Path, name: str) -> Diameters:
    """Read the diameters of a table with one grain a row, under a heading like `diameter (um)`.

    Without a heading, or a unit in it, they are relative to each other. Other columns are left out,
    but for amounts: a histogram is refused.

    Raises
    ------
    ValueError
        If it cannot be read, or holds something else.
    """
    content = read_content(folder, name)
    try:
        table = read_table(content, SIZES, GRAIN_EXAMPLE, MAX_ROWS)
        if not table.headings and table.width > 1:
            raise TableError(
                f"has {table.width} columns without headings; must have a heading like "
                f"'{GRAIN_EXAMPLE}' above the diameters"
            )
        column = SizeTable(table, CurveKeys()).grains(GRAINS_REMEDY)
        numbers = table.numbers(column.position)
        check_diameters(numbers, lambda row: table.shown(row, column.position))
        return tuple(in_metres(numbers, column.unit)), column.unit not in RELATIVE
    except ValueError as error:
        raise ValueError(f"is {quoted(name)}: {error}") from None


def read_content(folder: Path, name: str) -> bytes:
    """Return the bytes of a file that a campaign names; raise a ValueError if it is no text."""
    if not name.isprintable():
        raise ValueError(f"is {quoted(name)}, which holds a character that cannot be printed")
    path = folder / name
    if begins_as_hdf5(path):
        raise ValueError(f"is {quoted(name)}, an HDF5 file; must be a text file with a table")
    try:
        return read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise ValueError(
            f"is {quoted(name)}, but {path} cannot be read: {error.strerror}"
        ) from None


def check_diameters(numbers: Sequence[float], place: Callable[[int], str]) -> None:
    """Raise a ValueError unless numbers can be diameters; `place` names the field of a row."""
    if not numbers:
        raise TableError("has no rows below its headings")
    if len(numbers) > MAX_ROWS:
        raise too_many_rows(len(numbers), MAX_ROWS)
    for row, number in enumerate(numbers):
        if not 0.0 < number < MAX_MAGNITUDE:
            raise TableError(f"{place(row)}; must be a number greater than 0")
    low, high = min(numbers), max(numbers)
    if high > MAX_RATIO * low:
        raise TableError(
            f"has diameters from {low:g} to {high:g}; the largest must be at most {MAX_RATIO:g} "
            "times the smallest"
        )
