"""Files with one grain a row: those that a law of sizes names, and lists that `data` names."""

from itertools import pairwise
from pathlib import Path
from typing import Final, TypeAlias

from agglom_mpi.declaration.bounded_reading import quoted_start, read_bounded
from agglom_mpi.declaration.units import quoted
from agglom_mpi.file_kinds import begins_as_hdf5
from agglom_mpi.measurements.files.size_columns import (
    AMOUNTS,
    RELATIVE,
    SIEVES,
    SIZES,
    CurveKeys,
    SizeColumn,
    named_columns,
    only_column,
)
from agglom_mpi.measurements.files.size_table import SizeTable, in_metres
from agglom_mpi.measurements.files.text_table import TableError, read_table

MAX_BYTES: Final = 1 << 23
"""Largest size of a file of sizes."""
MAX_ROWS: Final = 100_000
MAX_RATIO: Final = 100.0
"""Largest over smallest diameter, at most."""
GRAIN_EXAMPLE: Final = "diameter (um)"
"""Heading that messages give as an example."""

GRAINS_REMEDY: Final = (
    "a file of sizes must have one grain per row. A curve or a histogram needs "
    "its error, like {file: sieve.csv, error: 2 percent}"
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
        column, numbers = grains_of(SizeTable(table, CurveKeys()), GRAINS_REMEDY)
        check_range(min(numbers), max(numbers))
        return tuple(in_metres(numbers, column.unit)), column.unit not in RELATIVE
    except ValueError as error:
        raise ValueError(f"is {quoted(name)}: {error}") from None


def check_range(low: float, high: float) -> None:
    """Raise a TableError if diameters at the start differ too much."""
    if high > MAX_RATIO * low:
        must = f"the largest must be at most {MAX_RATIO:g} times the smallest"
        raise TableError(f"has diameters from {low:g} to {high:g}; {must}")


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


def grains_of(found: SizeTable, remedy: str) -> tuple[SizeColumn, list[float]]:
    """Return the column of sizes of a list of single grains, and its numbers.

    Raises
    ------
    FieldError
        If there are several.
    TableError
        If there is none, or something seems to be the amount of each size: a column in percent, or
        of sizes in order beside others that the entry does not name. `remedy` ends the message.
    """
    named, table = named_columns(found.columns, found.keys), found.table
    of_roles = ([c for c in named if c.role == role] for role in ("size", "area"))
    sizes = next(filter(None, of_roles), [])
    if not sizes or sizes[0].heading.title.lower() in SIEVES:
        raise TableError(f"has no column of amounts, and none of single grains; {remedy}")
    column = only_column(sizes)
    numbers = table.numbers(column.position)
    if not numbers:
        raise TableError("has no rows below its headings")
    others = [each for i, each in enumerate(table.headings) if i != column.position]
    steps = {(b > a) - (b < a) for a, b in pairwise(numbers)}
    in_order = not found.keys.column and len(numbers) > 2 and steps in ({1}, {-1})
    amounts = [each.heading for each in found.columns if each.role in AMOUNTS]
    amounts += [each for each in others if in_order or each.unit in ("%", "percent")]
    if amounts:
        title = quoted_start(amounts[0].title)
        message = f"has column {title} beside the sizes, which may be an amount of each size"
        raise TableError(f"{message}; {remedy}")
    for row, number in enumerate(numbers):
        if number <= 0.0:
            shown = table.shown(row, column.position)
            raise TableError(f"{shown}; must be greater than 0")
    return column, numbers
