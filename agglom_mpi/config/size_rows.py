"""Rows of tables of measured sizes: the sizes in their fields, in ascending order.

A field holds a size (`63`), a class (`63-125`, `<63`, `>2000`), or a word for the pan below the
last sieve.
"""

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from agglom_mpi.config.bounded_reading import quoted_start
from agglom_mpi.config.size_file import in_metres
from agglom_mpi.config.table_layout import TableError
from agglom_mpi.config.text_table import TextTable

PAN: Final = {"pan", "tray", "receiver", "boden", "siebboden", "schale", "pfanne", "fond"}
"""Words for what collects the grains that pass all sieves."""
_TOTAL: Final = {"total", "totals", "sum", "summe", "gesamt", "somme"}
"""Words at the beginning of a row with sums, which is left out."""
_SIZE: Final = r"(\d[\d.,]*|[.,]\d+)"
_RANGE: Final = re.compile(rf"{_SIZE}\s*(?:-|–|—|\.{{2,3}}|…|to|bis)\s*{_SIZE}", re.ASCII)
_OPEN: Final = re.compile(rf"([<>≤≥])\s*=?\s*{_SIZE}", re.ASCII)


class SizeRow(NamedTuple):
    """A row of a table: its position, lower and upper size in m, which are equal of a size alone.

    The pan has the sizes 0 and 0.
    """

    position: int
    lower: float
    upper: float

    @property
    def is_class(self) -> bool:
        """Whether the row has two sizes."""
        return self.lower < self.upper


def size_rows(table: TextTable, columns: Sequence[int], unit: str) -> list[SizeRow]:
    """Return the rows by ascending size.

    Parameters
    ----------
    table
    columns
        Indices of the columns of sizes: one, or those of the lower and the upper edge.
    unit
        Unit of the sizes.

    Raises
    ------
    TableError
        If a field is no size, a size stands twice, or the sizes neither ascend nor descend.
    """
    first = columns[0]
    found = []
    for index in range(len(table.rows)):
        word = table.cell(index, first).lower().strip(" .:")
        if word in _TOTAL:
            continue
        if len(columns) == 2 and word not in PAN:
            sizes = [_size(table, index, column, table.cell(index, column)) for column in columns]
        else:
            sizes = list(_sizes(table, index, first, word))
        lower, upper = in_metres(sizes, unit)
        if not lower <= upper or (len(columns) == 2 and lower == upper and word not in PAN):
            raise TableError(
                f"{table.place(index, columns[-1])}: the class must end above its lower edge"
            )
        found.append(SizeRow(index, lower, upper))
    if not found:
        raise TableError("has no rows below its headings")
    return _ascending(table, first, found)


def _ascending(table: TextTable, column: int, rows: list[SizeRow]) -> list[SizeRow]:
    """Return the rows by ascending size; raise a TableError if they are in no order."""
    sizes = [row for row in rows if row.upper > 0.0]
    pan = [row for row in rows if row.upper == 0.0]
    if len(pan) > 1:
        raise _twice(table, column, pan[1], pan[0])
    descends = len(sizes) > 1 and sizes[-1].lower < sizes[0].lower
    ordered = sizes[::-1] if descends else sizes
    for low, high in pairwise(ordered):
        earlier, later = (high, low) if descends else (low, high)
        if (low.lower, low.upper) == (high.lower, high.upper):
            raise _twice(table, column, later, earlier)
        if not low.lower <= high.lower or not low.upper <= high.upper:
            order = "descending" if descends else "ascending"
            shown = table.shown(later.position, column)
            raise TableError(f"{shown} breaks the {order} order of the sizes")
    return pan + ordered


def _twice(table: TextTable, column: int, row: SizeRow, earlier: SizeRow) -> TableError:
    line = table.lines[earlier.position]
    return TableError(f"{table.shown(row.position, column)} stands in line {line}, too")


def _sizes(table: TextTable, row: int, column: int, word: str) -> tuple[float, float]:
    """Return the lower and the upper size of a field, in the unit of the column."""
    if word in PAN:
        return 0.0, 0.0
    if match := _RANGE.fullmatch(word):
        return _size(table, row, column, match[1]), _size(table, row, column, match[2])
    if match := _OPEN.fullmatch(word):
        size = _size(table, row, column, match[2])
        return (0.0, size) if match[1] in "<≤" else (size, math.inf)
    size = _size(table, row, column, table.cell(row, column))
    return size, size


def _size(table: TextTable, row: int, column: int, text: str) -> float:
    """Return a size of at least 0 as a number."""
    size = table.number_of(text)
    if size is None and text != table.cell(row, column):
        raise TableError(f"{table.place(row, column)}: {quoted_start(text)} is not a number")
    size = table.number(row, column) if size is None else size
    if size < 0.0:
        raise TableError(f"{table.shown(row, column)}; must be a size of at least 0")
    return size


def classes_between(table: TextTable, column: int, rows: list[SizeRow]) -> list[SizeRow]:
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
            shown, line = table.shown(high.position, column), table.lines[low.position]
            raise TableError(f"{shown} does not begin where the class of line {line} ends")
    return rows
