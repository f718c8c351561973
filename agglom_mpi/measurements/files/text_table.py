"""Tables of numbers in text files, as instruments and spreadsheets write them.

Encoding, column separator and decimal mark follow from the content. A table that allows two
readings is refused, and the message names what to write instead. No message quotes more than the
start of one field, and none quotes a file without numbers: it may be any file of this machine.
"""

import codecs
import csv
import math
import re
from collections.abc import Collection, Sequence
from contextlib import suppress
from itertools import chain
from typing import Any, Final, NamedTuple

from agglom_mpi.declaration.spelling import NUMBER as PLAIN_NUMBER
from agglom_mpi.declaration.spelling import as_python
from agglom_mpi.declaration.units import dimensions_of
from agglom_mpi.file_kinds import SHOWN_CHARACTERS, quoted_start

MAX_OTHER_LINES: Final = 1000
"""Maximum number of lines that are not rows of numbers."""
MAX_LINE_CHARACTERS: Final = 10_000
"""Maximum length of a line of a table."""
MAGNITUDES: Final = (1e-30, 1e30)
"""Smallest and largest magnitude of a number other than 0; cubes of ratios are far from inf."""
NO_NUMBER: Final = (
    f"no number with one meaning, 0 or in size from {MAGNITUDES[0]:g} to {MAGNITUDES[1]:g}; write "
    "numbers with a decimal point and without separators of thousands"
)
"""A fault of a field, with a remedy."""

_NUMBER: Final = re.compile(PLAIN_NUMBER, re.ASCII)
_COMMA_NUMBER: Final = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
_THOUSANDS: Final = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
"""A number with a comma that can be a decimal mark or a separator of thousands."""
_BEGINS_WITH_NUMBER: Final = re.compile(r'[\s"]*[+-]?[.,]?\d', re.ASCII)
_QUOTED: Final = re.compile(r'"[^"]*"')
_LINE_ENDS: Final = re.compile(r"\r\n|\r|\n")
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]")
_BRACKETS: Final = re.compile(r"[\[(]([^\[\]()]*)[\])]")
_SPACED_HEADING: Final = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\[\]()]*[\])])?")
"""One heading in a line of headings that are separated by spaces."""
NumberedLine = tuple[int, str]
"""Number of a line in its file, from 1, and its text."""
NumberedCells = tuple[int, list[str]]
"""Number of a line, and its fields."""


class TableError(ValueError):
    """A file is no table of numbers, or allows two readings; says what to write instead."""


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
        """Return the numbers of a column, one for each row; raise a TableError as `number`."""
        return [self.number(row, column) for row in range(len(self.rows))]

    def number(self, row: int, column: int) -> float:
        """Return the number in a field; raise a TableError if it is none, or can be two."""
        cell = self.cell(row, column)
        found = self.number_of(cell)
        if found is None:
            raise TableError(f"{self.shown(row, column)} is {NO_NUMBER}")
        return found

    def number_of(self, cell: str) -> float | None:
        """Return the number of a text as the table writes them; None of others and extreme ones."""
        point = cell.replace(",", ".") if self.decimal_comma else cell
        number = float(as_python(point)) if _NUMBER.fullmatch(point) else math.nan
        return number if number == 0.0 or MAGNITUDES[0] <= abs(number) <= MAGNITUDES[1] else None

    def cell(self, row: int, column: int) -> str:
        """Return the text of a field; empty where the row is shorter."""
        cells = self.rows[row]
        return cells[column] if column < len(cells) else ""

    def shown(self, row: int, column: int) -> str:
        """Return the place of a field and its value, as a message begins."""
        return f"{self.place(row, column)}: {quoted_start(self.cell(row, column))}"

    def place(self, row: int, column: int) -> str:
        """Return the line of a field, and its column where there are several."""
        line = f"line {self.lines[row]}"
        if self.width < 2:
            return line
        name = quoted_start(self.headings[column].title) if self.headings else str(column + 1)
        return f"{line}, column {name}"


def too_many_rows(rows: int, allowed: int) -> TableError:
    """Return the error about a table with more rows than are allowed."""
    return TableError(
        f"has {rows:,} rows; allowed: {allowed:,}, so keep one in {-(-rows // allowed)} of the "
        "sorted rows"
    )


def is_number(cell: str) -> bool:
    """Return whether a field is a number with a decimal point or a decimal comma."""
    return bool(_NUMBER.fullmatch(cell) or _COMMA_NUMBER.fullmatch(cell))


def is_unit(cell: str) -> bool:
    """Return whether a field is a unit, in brackets or not; empty and `-` count as no unit."""
    text = cell.strip("[]() ")
    if text in ("", "-"):
        return True
    if is_number(text) or len(text) > SHOWN_CHARACTERS:
        return False
    try:
        dimensions_of(text)
    except ValueError:
        return False
    return True


def parse_heading(text: str) -> Heading:
    """Return title and unit of a heading: `Diameter [um]`, `Passing (%) by mass`, `% passing`."""
    text = " ".join(text.split())
    for found in _BRACKETS.finditer(text):
        if found[1] in ("%", "1") or is_unit(found[1]):
            title = f"{text[: found.start()]} {text[found.end() :]}"
            return Heading(" ".join(title.split()), found[1].strip())
    first, _, rest = text.partition(" ")
    return Heading(rest, "%") if rest and first.lower() in ("%", "percent") else Heading(text)


def read_table(
    content: bytes, titles: Collection[str], example: str, max_rows: int = 10_000
) -> TextTable:
    """Read a table of numbers.

    Empty lines, and lines that begin with `#`, are left out, and so are lines above the headings.

    Parameters
    ----------
    content
        The content of the file.
    titles
        Titles that the caller looks for, in lower case and without units. The first line without
        numbers that has one of them holds the headings; a line of units may follow it.
    example
        Heading to name in a message, like `diameter (um)`.
    max_rows
        Maximum number of rows.

    Raises
    ------
    TableError
        If the content is no such table, or allows two readings.
    """
    lines = [
        (number, line)
        for number, line in enumerate(_LINE_ENDS.split(_decoded(content)), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) > max_rows + MAX_OTHER_LINES:
        raise too_many_rows(len(lines), max_rows)
    if long := [number for number, line in lines if len(line) > MAX_LINE_CHARACTERS]:
        raise TableError(f"line {long[0]}: is longer than {MAX_LINE_CHARACTERS:,} characters")
    separator = _separator(lines)
    rows = [(number, _split(line, separator, number)) for number, line in lines]
    if not any(is_number(cell) for _, cells in rows for cell in cells):
        raise TableError("holds no number")
    headings, rows = _without_headings(rows, lines, separator, titles, example)
    rows = [(number, cells) for number, cells in rows if cells]
    if len(rows) > max_rows:
        raise too_many_rows(len(rows), max_rows)
    wanted = len(headings) or len(rows[0][1])
    for number, cells in rows:
        if len(cells) > wanted or (not headings and len(cells) != wanted):
            raise TableError(f"line {number}: has {len(cells)} fields; must have {wanted}")
    texts = [cells for _, cells in rows]
    return TextTable(headings, texts, [number for number, _ in rows], _has_decimal_comma(texts))


def _without_headings(
    rows: list[NumberedCells],
    lines: list[NumberedLine],
    separator: str | None,
    titles: Collection[str],
    example: str,
) -> tuple[tuple[Heading, ...], list[NumberedCells]]:
    """Return the headings, none if the table begins with numbers, and the rows below them."""
    for i, (_, cells) in enumerate(rows):
        if cells and all(map(is_number, cells)):
            break
        if any(map(is_number, cells)):
            continue
        own = _SPACED_HEADING.findall(lines[i][1]) if separator == " " else cells
        headings = [parse_heading(title.strip('"')) for title in own]
        if any(heading.title.lower() in titles for heading in headings):
            return _with_units(headings, rows[i + 1 :])
    number, cells = rows[0]
    first = next((cell for cell in cells if cell and not is_number(cell)), None)
    if first is None:
        return (), rows
    raise TableError(
        f"line {number}: {quoted_start(first)} is neither a number nor a heading like '{example}'"
    )


def _with_units(
    headings: list[Heading], rows: list[NumberedCells]
) -> tuple[tuple[Heading, ...], list[NumberedCells]]:
    """Return headings with the units of the line below, if it has them, and the rows without it."""
    below = rows[0][1] if rows else []
    if not below or any(each.unit for each in headings) or not all(map(is_unit, below)):
        return tuple(headings), rows
    units = [cell.strip("[]() ") for cell in below]
    units += [""] * (len(headings) - len(units))
    found = [
        each if unit in ("", "-") else each._replace(unit=unit)
        for each, unit in zip(headings, units, strict=False)
    ]
    return tuple(found), rows[1:]


def _has_decimal_comma(rows: Sequence[list[str]]) -> bool:
    """Return whether numbers have decimal commas: one is no thousand, and none has a point."""
    cells = list(chain.from_iterable(rows))
    if any("," not in cell and "." in cell and _NUMBER.fullmatch(cell) for cell in cells):
        return False
    return any(_COMMA_NUMBER.fullmatch(each) and not _THOUSANDS.fullmatch(each) for each in cells)


def _decoded(content: bytes) -> str:
    """Return a text in UTF-8, UTF-16 or Windows-1252, which has all of printed Latin-1."""
    marked = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for encoding in ("utf-16",) if marked else ("utf-8-sig", "cp1252"):
        with suppress(UnicodeDecodeError):
            text = content.decode(encoding)
            if _CONTROL.search(text) is None:
                return text
    raise TableError("is no text, but a workbook, say; export the table as text (CSV)")


def _separator(lines: list[NumberedLine]) -> str | None:
    """Return what separates columns; None for one column. A space stands for any white space.

    Raises a TableError if commas can be decimal marks and separators.
    """
    bare = [_QUOTED.sub('"', line).strip() for _, line in lines]
    for separator in ("\t", ";"):
        if 2 * sum(separator in line.rstrip(separator) for line in bare) > len(bare):
            return separator
    body = [i for i, (_, line) in enumerate(lines) if _BEGINS_WITH_NUMBER.match(line)]
    texts = [bare[i].rstrip(",; \t") for i in body] or bare
    spaced = any(re.search(r",\s", text) for text in texts)
    if not spaced and 2 * sum(len(text.split()) > 1 for text in texts) > len(texts):
        return " "
    if not any("," in text for text in texts):
        return None
    if spaced or not all(map(is_number, texts)):
        return ","
    # All lines are like `40,5`: one number, or two. The line above them may decide.
    above = lines[body[0] - 1][1].strip().rstrip(",") if body[0] > 0 else ""
    titles = next(csv.reader([above])) if above else []
    mixed = not all("," in text for text in texts)
    if (len(titles) == 1 and (mixed or len(texts) > 1)) or (not titles and mixed):
        return None
    if len(titles) > 1 and not any(is_unit(title.strip()) for title in titles[1:]):
        return ","
    number, line = lines[body[0]]
    raise TableError(
        f"line {number}: {quoted_start(line.strip())} can be one number or two; "
        "write numbers with a decimal point, or separate columns by semicolons"
    )


def _split(line: str, separator: str | None, number: int) -> list[str]:
    """Return the fields of a line, without white space around them or empty ones at the end.

    A line with one column may end with a comma or a semicolon.
    """
    if separator == " " and '"' not in line:
        cells = line.split()
    else:
        layout: Any = {"delimiter": separator or "\t", "skipinitialspace": True, "strict": True}
        try:
            [cells] = csv.reader([line.strip(" ")], **layout)
        except (csv.Error, ValueError):
            raise TableError(f"line {number}: quotation marks do not match") from None
    if separator is None and len(cells) == 1:
        cells = [cells[0].strip().rstrip(",;")]
    cells = [cell.strip() for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells
