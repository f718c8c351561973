"""Rows of tables of measured sizes, by ascending size, and lists with one grain a row.

A field of a size holds one (`63`), a class (`63-125`, `<63`, `>2000`), or `pan`, what is below the
last sieve.
"""

import math
import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.file_kinds import begins_as_hdf5, quoted_start, read_bounded
from agglom_mpi.measurements.files.size_columns import (
    AMOUNTS,
    RELATIVE,
    SIEVES,
    SIZES,
    CurveKeys,
    SizeColumn,
    named_columns,
    only_column,
    size_columns,
    size_unit,
)
from agglom_mpi.measurements.files.size_curve import Numbers
from agglom_mpi.measurements.files.text_table import TableError, TextTable, read_table

_SIZE: Final = r"(\d[\d.,]*|[.,]\d+)"
_RANGE: Final = re.compile(rf"{_SIZE}\s*[-–]\s*{_SIZE}", re.ASCII)
_OPEN: Final = re.compile(rf"([<>≤≥])\s*{_SIZE}", re.ASCII)
_PAN: Final = "pan"
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


class SizeRow(NamedTuple):
    """A row of a table: its position, lower and upper size in m, which are equal of a size alone.

    The pan has the sizes 0 and 0.
    """

    position: int
    lower: float
    upper: float


class SizeTable:
    """A table of measured sizes.

    Parameters
    ----------
    table
        The text fields.
    keys
        What the entry of `data` states of the file; errors are those of `size_columns`.
    """

    def __init__(self, table: TextTable, keys: CurveKeys) -> None:
        self.table, self.keys = table, keys
        self.columns = size_columns(table, keys)

    def shown(self, row: SizeRow, column: SizeColumn) -> str:
        """Return the place of a field and its value, as a message begins."""
        return self.table.shown(row.position, column.position)

    def is_empty(self, row: SizeRow, column: SizeColumn) -> bool:
        """Return whether a field is empty."""
        return not self.table.cell(row.position, column.position)

    def numbers(self, rows: Sequence[SizeRow], column: SizeColumn) -> Numbers:
        """Return the numbers of a column in some rows, shape (n,)."""
        return np.array([self.table.number(row.position, column.position) for row in rows])

    def check(
        self, rows: Sequence[SizeRow], column: SizeColumn, fits: Iterable[Any], must: str
    ) -> None:
        """Raise a TableError with the field of the first of some rows that does not fit."""
        for row, is_right in zip(rows, fits, strict=True):
            if not is_right:
                raise TableError(f"{self.shown(row, column)}; must {must}")

    def rows(self, *columns: SizeColumn) -> list[SizeRow]:
        """Return the rows by ascending size, without one of totals.

        Parameters
        ----------
        *columns
            The column of sizes, or those of the lower and the upper edge.

        Raises
        ------
        TableError
            If a field is no size, a size stands twice, or the sizes neither ascend nor descend.
        """
        table, found = self.table, []
        unit = size_unit(next((c for c in columns if c.unit), columns[0]), self.keys)
        for index in range(len(table.rows)):
            words = [table.cell(index, column.position) for column in columns]
            if words[0].lower() == "total":
                continue
            if len(columns) == 1 or words[0].lower() == _PAN:
                sizes = self._sizes(index, columns[0], words[0])
            else:
                sizes = [self._size(index, *each) for each in zip(columns, words, strict=True)]
            lower, upper = in_metres(sizes, unit)
            if not lower <= upper or (len(columns) == 2 and 0.0 < lower == upper):
                place = table.place(index, columns[-1].position)
                raise TableError(f"{place}: the class must end above its lower edge")
            found.append(SizeRow(index, lower, upper))
        if not found:
            raise TableError("has no rows below its headings")
        return self._ascending(columns[0], found)

    def _ascending(self, column: SizeColumn, rows: list[SizeRow]) -> list[SizeRow]:
        """Return the rows by ascending size; raise a TableError if they are in no order."""
        sizes, pan = [row for row in rows if row.upper], [row for row in rows if not row.upper]
        descends = len(sizes) > 1 and sizes[-1].lower < sizes[0].lower
        ordered = sizes[::-1] if descends else sizes
        for low, high in pairwise(pan if len(pan) > 1 else ordered):
            again = low[1:] == high[1:]
            if again or not (low.lower <= high.lower and low.upper <= high.upper):
                earlier, later = (high, low) if descends else (low, high)
                line, order = self.table.lines[earlier.position], "de" if descends else "a"
                why = "repeats" if again else f"breaks the {order}scending order after"
                raise TableError(f"{self.shown(later, column)} {why} line {line}")
        return pan + ordered

    def _sizes(self, row: int, column: SizeColumn, text: str) -> list[float]:
        """Return the lower and the upper size of a field, in the unit of the column."""
        if text.lower() == _PAN:
            return [0.0, 0.0]
        if match := _RANGE.fullmatch(text):
            return [self._size(row, column, match[1]), self._size(row, column, match[2])]
        if match := _OPEN.fullmatch(text):
            size = self._size(row, column, match[2])
            return [0.0, size] if match[1] in "<≤" else [size, math.inf]
        return 2 * [self._size(row, column, text)]

    def _size(self, row: int, column: SizeColumn, text: str) -> float:
        """Return a size of at least 0 as a number."""
        size = self.table.number_of(text)
        if size is None:
            self.table.number(row, column.position)  # refuses the field
        if size is None or size < 0.0:
            raise TableError(
                f"{self.table.shown(row, column.position)}; must be a size of at least 0"
            )
        return size

    def classes(self, column: SizeColumn, rows: list[SizeRow]) -> list[SizeRow]:
        """Return rows with classes, the pan as the class below the others.

        Raises
        ------
        TableError
            If classes overlap or leave a gap.
        """
        if rows[0].upper == 0.0 and len(rows) > 1:
            rows = [rows[0]._replace(upper=rows[1].lower), *rows[1:]]
        for low, high in pairwise(rows):
            if not math.isclose(low.upper, high.lower, rel_tol=1e-6):
                shown, line = self.shown(high, column), self.table.lines[low.position]
                raise TableError(f"{shown} does not begin where the class of line {line} ends")
        return rows


def in_metres(numbers: Sequence[float], unit: str) -> list[float]:
    """Return lengths in m; unchanged of no unit. Raise a TableError if the unit is none of length.

    40 um are 40/1e6 m to the bit, as in a campaign file; 40 * 1e-6 are not.
    """
    try:
        factor = 1.0 if unit in RELATIVE else to_si(f"1 {unit}", "m")
    except ValueError:
        raise TableError(
            f"the sizes have the unit {quoted_start(unit)}; must be one of length like 'um'"
        ) from None
    whole = round(1.0 / factor)
    divides = whole > 0 and 1.0 / whole == factor
    return [number / whole if divides else number * factor for number in numbers]


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
