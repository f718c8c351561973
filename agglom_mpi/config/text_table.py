"""Tables of numbers in text files, as instruments and spreadsheets write them.

Encoding, column separator and decimal mark follow from the content (`table_layout`). A table that
allows two readings is refused, and the message names what to write instead. No message quotes more
than the start of one field, and none quotes a file without numbers: it may be any file of this
machine.
"""

import math
import re
from collections.abc import Callable, Sequence
from itertools import chain
from typing import Final, NamedTuple

from agglom_mpi.config.bounded_reading import quoted_start
from agglom_mpi.config.table_layout import (
    COMMA_NUMBER,
    NUMBER,
    NumberedLine,
    TableError,
    is_number,
    is_unit,
    split_cells,
    split_lines,
    too_many_rows,
)
from agglom_mpi.declaration.spelling import as_python

_THOUSANDS: Final = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
"""A number with a comma that can be a decimal mark or a separator of thousands."""
MAX_HEADING: Final = 200
"""Maximum number of characters of a heading that are read."""
_BRACKETS: Final = re.compile(r"[\[(]([^\[\]()]*)[\])]")
_BARE_UNIT: Final = re.compile(
    r"(?: ?/ ?| ?, ?|[ _](?:in )?)(mm|cm|um|µm|μm|nm|m|microns?|%|percent|mg|kg|g)$", re.IGNORECASE
)
"""A unit at the end of a heading without brackets: `Diameter / um`, `diameter_um`."""
_SPACED_HEADING: Final = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\[\]()]*[\])])?")
"""One heading in a line of headings that are separated by spaces."""

MAGNITUDES: Final = (1e-30, 1e30)
"""Smallest and largest magnitude of a number other than 0; cubes of ratios are far from inf."""
POINT_REMEDY: Final = "write numbers with a decimal point and without separators of thousands"


class Heading(NamedTuple):
    """Title of a column, and its unit as the file writes it; None if it gives no unit."""

    title: str
    unit: str | None = None


class TextTable(NamedTuple):
    """A table of text fields.

    Attributes
    ----------
    headings
        One for each column; empty if the table has none.
    rows
        Fields of each row; missing fields at the end of a row are left out.
    lines
        Line in the file of each row, from 1.
    decimal_comma
        Whether numbers are written as `40,5`.
    """

    headings: tuple[Heading, ...]
    rows: list[list[str]]
    lines: list[int]
    decimal_comma: bool

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.headings) or max(map(len, self.rows), default=0)

    def numbers(self, column: int) -> list[float]:
        """Return the numbers of a column, one for each row.

        Raises
        ------
        TableError
            If a field is not a number, or can be two.
        """
        return [self.number(row, column) for row in range(len(self.rows))]

    def number(self, row: int, column: int) -> float:
        """Return the number in a field; raise a TableError if it is none, or can be two."""
        cell = self.cell(row, column)
        found = self.number_of(cell)
        if found is None:
            raise TableError(f"{self.place(row, column)}: {_no_number(cell)}")
        return found

    def number_of(self, cell: str) -> float | None:
        """Return the number of a text as the table writes them; None of others and extreme ones."""
        point = cell.replace(",", ".") if self.decimal_comma else cell
        number = float(as_python(point)) if NUMBER.fullmatch(point) else math.nan
        return number if number == 0.0 or MAGNITUDES[0] <= abs(number) <= MAGNITUDES[1] else None

    def cell(self, row: int, column: int) -> str:
        """Return the text of a field; empty where the row is shorter."""
        cells = self.rows[row]
        return cells[column] if column < len(cells) else ""

    def field(self, row: int, column: int) -> str:
        """Return a field as a message quotes it."""
        return quoted_start(self.cell(row, column))

    def shown(self, row: int, column: int) -> str:
        """Return the place of a field and its value, as a message begins."""
        return f"{self.place(row, column)}: {self.field(row, column)}"

    def place(self, row: int, column: int) -> str:
        """Return the line of a field, and its column where there are several."""
        line = f"line {self.lines[row]}"
        if self.width < 2:
            return line
        name = quoted_start(self.headings[column].title) if self.headings else str(column + 1)
        return f"{line}, column {name}"


def _no_number(cell: str) -> str:
    """Return why a field is not a number, and what to write."""
    if is_number(cell) and not _THOUSANDS.fullmatch(cell) and "e" in cell.lower():
        low, high = MAGNITUDES
        return f"{quoted_start(cell)} must be 0 or have a magnitude from {low:g} to {high:g}"
    if _THOUSANDS.fullmatch(cell):
        own, point = cell.replace(",", ""), cell.replace(",", ".")
        return f"{quoted_start(cell)} can be {own} or {point}; {POINT_REMEDY}"
    if cell and set(cell) <= set("+-0123456789.,'  \u202f"):
        return f"{quoted_start(cell)} is not a number; {POINT_REMEDY}"
    return (
        f"{quoted_start(cell)} is not a number" if cell else "the field is empty; must be a number"
    )


def read_table(
    content: bytes, is_title: Callable[[str], bool], example: str, max_rows: int = 10_000
) -> TextTable:
    """Read a table of numbers.

    Empty lines, and lines that begin with `#`, are left out, and so are lines above the headings.

    Parameters
    ----------
    content
        The content of the file.
    is_title
        Whether a title, in lower case and without its unit, is one that the caller looks for. The
        first line without numbers that has such a title holds the headings; a line of units may
        follow it.
    example
        Heading to name in a message, like `diameter (um)`.
    max_rows
        Maximum number of rows.

    Raises
    ------
    TableError
        If the content is no such table, or allows two readings.
    """
    separator, lines = split_lines(content, max_rows)
    rows = [(number, split_cells(line, separator, number)) for number, line in lines]
    if not any(is_number(cell) for _, cells in rows for cell in cells):
        raise TableError("holds no number")
    start = _heading_row(rows, lines, separator, is_title, example)
    headings: tuple[Heading, ...] = ()
    if start is not None:
        width = _width_below(rows, start)
        titles = _titles(*lines[start], separator, width)
        units = rows[start + 1][1] if start + 1 < len(rows) else []
        has_units = bool(units) and all(map(is_unit, units))
        headings = _headings(titles, units if has_units else [], lines[start][0])
        rows = rows[start + (2 if has_units else 1) :]
    rows = [(number, cells) for number, cells in rows if cells]
    if len(rows) > max_rows:
        raise too_many_rows(len(rows), max_rows)
    _check_widths(rows, len(headings))
    texts = [cells for _, cells in rows]
    return TextTable(headings, texts, [number for number, _ in rows], _has_decimal_comma(texts))


def _heading_row(
    rows: list[tuple[int, list[str]]],
    lines: list[NumberedLine],
    separator: str | None,
    is_title: Callable[[str], bool],
    example: str,
) -> int | None:
    """Return the index of the row of headings; None if the table begins with numbers."""
    for i, (_, cells) in enumerate(rows):
        if cells and all(map(is_number, cells)):
            break
        if not any(map(is_number, cells)):
            titles = _SPACED_HEADING.findall(lines[i][1]) if separator == " " else cells
            if any(is_title(parse_heading(title).title.lower()) for title in titles):
                return i
    number, cells = rows[0]
    first = next((cell for cell in cells if cell and not is_number(cell)), None)
    if first is None:
        return None
    raise TableError(
        f"line {number}: {quoted_start(first)} is neither a number nor a heading like '{example}'"
    )


def _width_below(rows: list[tuple[int, list[str]]], start: int) -> int:
    """Return the number of fields in the first row with numbers below the headings."""
    below = (len(cells) for _, cells in rows[start + 1 :] if any(map(is_number, cells)))
    return next(below, len(rows[start][1]))


def _titles(number: int, line: str, separator: str | None, width: int) -> list[str]:
    """Return the headings in a line; where spaces separate columns they may hold spaces, too."""
    if separator != " ":
        return split_cells(line, separator, number)
    for found in (re.split(r"\s{2,}", line.strip()), _SPACED_HEADING.findall(line)):
        if len(found) == width:
            return [title.strip().strip('"') for title in found]
    raise TableError(
        f"line {number}: the headings of {width} columns run into each other; separate columns by "
        "semicolons"
    )


def parse_heading(text: str) -> Heading:
    """Return title and unit of `Diameter [um]`, `Diameter (um)`, `Diameter / um`, `diameter_um`."""
    text = " ".join(text[:MAX_HEADING].split())
    units = (
        found for found in _BRACKETS.finditer(text) if found[1] in ("%", "1") or is_unit(found[1])
    )
    if bracket := next(units, None):
        title = f"{text[: bracket.start()]} {text[bracket.end() :]}"
        unit: str | None = bracket[1].strip()
    else:  # `Diameter (lower) um`
        title, unit = _BRACKETS.sub(r" \1 ", text).strip(), None
        if bare := _BARE_UNIT.search(title):
            title, unit = title[: bare.start()], bare[1]
    return Heading(" ".join(title.replace("_", " ").split()).strip("/,:- "), unit)


def _headings(titles: Sequence[str], units: Sequence[str], number: int) -> tuple[Heading, ...]:
    """Return the headings of a line, with the units of the line below it."""
    found = []
    for i, text in enumerate(titles):
        heading = parse_heading(text)
        below = units[i].strip("[]() ") if i < len(units) else ""
        if below and below != "-":
            if heading.unit not in (None, below):
                raise TableError(
                    f"line {number}: column {quoted_start(heading.title)} has the units "
                    f"{quoted_start(heading.unit or '')} and {quoted_start(below)}; must be one"
                )
            heading = heading._replace(unit=below)
        found.append(heading)
    return tuple(found)


def _check_widths(rows: list[tuple[int, list[str]]], headings: int) -> None:
    """Raise a TableError if a row has more fields than headings, or another number than the first.

    Without headings, all rows must have the same number of fields.
    """
    for number, cells in rows:
        wanted = headings or len(rows[0][1])
        if len(cells) > wanted or (not headings and len(cells) != wanted):
            fields = "field" if len(cells) == 1 else "fields"
            of = f"{headings} heading" if headings else f"{wanted} in the first row"
            plural = "s" if headings > 1 else ""
            raise TableError(f"line {number}: has {len(cells)} {fields}, but {of}{plural}")


def _has_decimal_comma(rows: list[list[str]]) -> bool:
    """Return whether numbers have decimal commas: one is no thousand, and none has a point."""
    clear = False
    for cell in chain.from_iterable(rows):
        if "," in cell:
            comma = COMMA_NUMBER.fullmatch(cell) and not _THOUSANDS.fullmatch(cell)
            clear = clear or bool(comma)
        elif "." in cell and NUMBER.fullmatch(cell):
            return False
    return clear
