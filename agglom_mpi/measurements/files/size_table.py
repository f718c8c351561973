"""Tables of measured sizes: the columns that are read, and their rows by ascending size.

A field of a size holds one (`63`), a class (`63-125`, `<63`, `>2000`), or `pan`, what is below the
last sieve.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.declaration.bounded_reading import quoted_start
from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.measurements.files.size_columns import (
    AMOUNTS,
    RELATIVE,
    SIEVES,
    Role,
    SizeColumn,
    size_columns,
)
from agglom_mpi.measurements.files.size_curve import Numbers, ShareWeight
from agglom_mpi.measurements.files.text_table import TableError, TextTable, parse_heading

CURVE_EXAMPLE: Final = "sieve size (mm)"
"""Heading that messages give as an example."""

_SIZE: Final = r"(\d[\d.,]*|[.,]\d+)"
_RANGE: Final = re.compile(rf"{_SIZE}\s*[-–]\s*{_SIZE}", re.ASCII)
_OPEN: Final = re.compile(rf"([<>≤≥])\s*{_SIZE}", re.ASCII)
_PAN: Final = "pan"


class CurveKeys(NamedTuple):
    """Statements of an entry of `data` on its file; None and empty where it makes none.

    Attributes
    ----------
    weight
        What shares are of.
    column
        Heading of the column to read.
    unit
        Unit of sizes whose heading has none.
    error
        Standard error of each share, or of each value of a cumulative curve.
    counted
        Number of grains that were counted.
    headings
        Known headings, such as `passing (%)`, by those of the file.
    """

    weight: ShareWeight | None = None
    column: str = ""
    unit: str = ""
    error: float | None = None
    counted: int | None = None
    headings: Mapping[str, str] = {}


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
        What the entry of `data` states of the file.

    Raises
    ------
    FieldError
        If the entry gives the meaning of a heading that the file does not have, or an unknown one.
    """

    def __init__(self, table: TextTable, keys: CurveKeys) -> None:
        stated = {parse_heading(own): parse_heading(text) for own, text in keys.headings.items()}
        self.table = table
        self.keys = keys
        self.columns = size_columns(table, stated)
        if not set(stated) <= {column.heading for column in self.columns}:
            message = "must give headings of the file known ones, like `finer: passing (%)`"
            raise FieldError((("headings",), message))

    def shown(self, row: int, column: SizeColumn) -> str:
        """Return the place of a field and its value, as a message begins."""
        return self.table.shown(row, column.position)

    def numbers(self, rows: Sequence[SizeRow], column: SizeColumn) -> Numbers:
        """Return the numbers of a column in some rows, shape (n,)."""
        return np.array([self.table.number(row.position, column.position) for row in rows])

    def check(
        self, rows: Sequence[SizeRow], column: SizeColumn, fits: Iterable[Any], must: str
    ) -> None:
        """Raise a TableError with the field of the first of some rows that does not fit."""
        for row, is_right in zip(rows, fits, strict=True):
            if not is_right:
                raise TableError(f"{self.shown(row.position, column)}; must {must}")

    def amount(self) -> SizeColumn | None:
        """Return the column of amounts to read; None of a list of single grains.

        Raises
        ------
        FieldError
            If the entry must name one of several columns, names none, or states another weight.
        """
        found, weight = [each for each in self.columns if each.role in AMOUNTS], self.keys.weight
        if self.keys.column:
            found = [column for column in self._named() if column.role in AMOUNTS]
        fitting = [column for column in found if weight in (None, column.weight or weight)]
        if found and not fitting:
            titles = _titles(found)
            raise FieldError((("weight",), f"is '{weight}', but the file has the columns {titles}"))
        return self._only(fitting) if fitting else None

    def grains(self, remedy: str) -> SizeColumn:
        """Return the column of sizes of a list of single grains; `remedy` ends an error.

        Raises
        ------
        FieldError
            If there are several.
        TableError
            If there is none, or something seems to be the amount of each size: a column in percent,
            or of sizes in order beside others that the entry does not name.
        """
        named = self._named() if self.keys.column else []
        roles: list[Role] = ["size", "area"]
        of_roles = ([c for c in named or self.columns if c.role == role] for role in roles)
        sizes = next(filter(None, of_roles), [])
        if not sizes or sizes[0].heading.title.lower() in SIEVES:
            raise TableError(f"has no column of amounts, and none of single grains; {remedy}")
        column = self._only(sizes)
        numbers, headings = self.table.numbers(column.position), self.table.headings
        others = [each for i, each in enumerate(headings) if i != column.position]
        steps = {(b > a) - (b < a) for a, b in pairwise(numbers)}
        in_order = not named and len(numbers) > 2 and steps in ({1}, {-1})
        amounts = [each.heading for each in self.columns if each.role in AMOUNTS]
        amounts += [each for each in others if in_order or each.unit in ("%", "percent")]
        if amounts:
            title = quoted_start(amounts[0].title)
            message = f"has column {title} beside the sizes, which may be an amount of each size"
            raise TableError(f"{message}; {remedy}")
        for row, number in enumerate(numbers):
            if number <= 0.0:
                raise TableError(f"{self.shown(row, column)}; must be greater than 0")
        return column

    def _named(self) -> list[SizeColumn]:
        """Return the columns that the entry names, at least one."""
        title, unit = parse_heading(self.keys.column)
        named = [
            column
            for column in self.columns
            if column.heading.title.lower() == title.lower() and unit in (None, column.heading.unit)
        ]
        if not named:
            message = f"is {quoted(self.keys.column)}; the file has {_titles(self.columns)}"
            raise FieldError((("column",), message))
        return named

    def _only(self, columns: list[SizeColumn]) -> SizeColumn:
        """Return a column; raise a FieldError if the entry must name one of several."""
        if len(columns) > 1:
            headings = {(each.heading.title.lower(), each.heading.unit) for each in columns}
            which = "name one" if len(headings) == len(columns) else "keep one in the file"
            message = f"must {which} of several columns, {_titles(columns)}"
            raise FieldError((("column",), message))
        return columns[0]

    def sizes(self, roles: Sequence[Role]) -> SizeColumn:
        """Return the one column of sizes with the first of some roles that there is.

        Raises
        ------
        TableError
            If there are several, or none.
        """
        for role in roles:
            found = [column for column in self.columns if column.role == role]
            if len(found) > 1:
                raise TableError(
                    f"has several columns of sizes, {_titles(found)}; keep one of them"
                )
            if found:
                return found[0]
        raise TableError(f"has no column of sizes; must have a heading like '{CURVE_EXAMPLE}'")

    def unit(self, column: SizeColumn, kind: str = "m", example: str = "um") -> str:
        """Return the unit of a column of sizes, of the kind of an SI unit.

        Raises
        ------
        FieldError
            Unless either the heading or the entry gives a unit of this kind.
        """
        title, own, given = quoted_start(column.heading.title), column.unit, self.keys.unit
        if own and given:
            message = f"is {quoted(given)}, but the sizes in column {title} are in {quoted(own)}"
            raise FieldError((("unit",), f"{message}; leave it out"))
        if unit := own or given:
            with suppress(ValueError):
                to_si(f"1 {unit}", kind)
                return unit
        found = f"is {quoted(unit) if unit else 'missing'} for the sizes in column {title}"
        must = f"must be one like '{example}', {'in the file' if own else 'here or in the file'}"
        raise FieldError((("unit",), f"{found}; {must}"))

    def rows(self, columns: Sequence[SizeColumn]) -> list[SizeRow]:
        """Return the rows by ascending size, without one of totals.

        Parameters
        ----------
        columns
            The column of sizes, or those of the lower and the upper edge.

        Raises
        ------
        TableError
            If a field is no size, a size stands twice, or the sizes neither ascend nor descend.
        """
        table, unit = self.table, self.unit(next((c for c in columns if c.unit), columns[0]))
        found = []
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
                raise TableError(f"{self.shown(later.position, column)} {why} line {line}")
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
            raise TableError(f"{self.shown(row, column)} is not a number")
        if size < 0.0:
            raise TableError(f"{self.shown(row, column)}; must be a size of at least 0")
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
                shown, line = self.shown(high.position, column), self.table.lines[low.position]
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


def _titles(columns: Sequence[SizeColumn]) -> str:
    headings = [column.heading for column in columns[:6]]
    return ", ".join(quoted_start(h.title) + (f" ({h.unit})" if h.unit else "") for h in headings)
