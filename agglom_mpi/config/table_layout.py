"""Layout of tables in text files: encoding, lines, what separates columns, and fields."""

import codecs
import csv
import re
from typing import Final

from agglom_mpi.config.bounded_reading import SHOWN_CHARACTERS, quoted_start
from agglom_mpi.declaration.spelling import NUMBER as PLAIN_NUMBER
from agglom_mpi.declaration.units import dimensions_of

MAX_OTHER_LINES: Final = 1000
"""Maximum number of lines that are not rows of numbers."""
MAX_LINE_CHARACTERS: Final = 10_000
"""Maximum length of a line of a table."""

NUMBER: Final = re.compile(PLAIN_NUMBER, re.ASCII)
COMMA_NUMBER: Final = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
_BEGINS_WITH_NUMBER: Final = re.compile(r'[\s"]*[+-]?[.,]?\d', re.ASCII)
_QUOTED: Final = re.compile(r'"[^"]*"')
_LINE_ENDS: Final = re.compile(r"\r\n|\r|\n")
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]")

_BYTE_ORDER_MARKS: Final = (
    *((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32")),
    *((codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16")),
)
_WORKBOOKS: Final = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
"""First bytes of .xlsx and .ods files, and of .xls files."""

NumberedLine = tuple[int, str]
"""Number of a line in its file, from 1, and its text."""


class TableError(ValueError):
    """A file is no table of numbers, or allows two readings; says what to write instead."""


def too_many_rows(rows: int, allowed: int) -> TableError:
    """Return the error about a table with more rows than are allowed."""
    return TableError(
        f"has {rows:,} rows; allowed: {allowed:,}, so keep one in {-(-rows // allowed)} of the "
        "sorted rows"
    )


def is_number(cell: str) -> bool:
    """Return whether a field is a number with a decimal point or a decimal comma."""
    return bool(NUMBER.fullmatch(cell) or COMMA_NUMBER.fullmatch(cell))


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


def split_lines(content: bytes, max_rows: int) -> tuple[str | None, list[NumberedLine]]:
    """Return what separates the columns of a table of at most `max_rows` rows, and its lines.

    Returns
    -------
    separator
        None for one column; a space stands for any white space.
    lines
        Without empty ones, and without those that begin with `#`.

    Raises
    ------
    TableError
        If the content is no text, it has too many or too long lines, or its commas can be decimal
        marks and separators.
    """
    lines = [
        (number, line)
        for number, line in enumerate(_LINE_ENDS.split(decode_text(content)), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) > max_rows + MAX_OTHER_LINES:
        raise too_many_rows(len(lines), max_rows)
    for number, line in lines:
        if len(line) > MAX_LINE_CHARACTERS:
            raise TableError(f"line {number}: is longer than {MAX_LINE_CHARACTERS:,} characters")
    if lines and re.fullmatch(r'"?sep=.?"?\s*', lines[0][1], re.IGNORECASE):  # Excel's own line
        return lines[0][1].strip().strip('"')[4:] or "\t", lines[1:]
    return _separator(lines), lines


def decode_text(content: bytes) -> str:
    """Return a text in UTF-8, UTF-16, UTF-32 or Windows-1252, which has all of printed Latin-1.

    Raises
    ------
    TableError
        If the content is no text.
    """
    if content.startswith(_WORKBOOKS):
        raise TableError("is a workbook or an archive; export the table as text (CSV)")
    encoding = next((name for mark, name in _BYTE_ORDER_MARKS if content.startswith(mark)), None)
    if encoding is None and 3 * content.count(0) > len(content):  # UTF-16 without its mark
        little = content[1::2].count(0) > content[::2].count(0)
        encoding = "utf-16-le" if little else "utf-16-be"
    for tried in (encoding,) if encoding else ("utf-8", "cp1252"):
        try:
            text = content.decode(tried).rstrip("\x1a")  # the end of a text under DOS
        except UnicodeDecodeError:
            continue
        if _CONTROL.search(text) is None:
            return text
    raise TableError("is no text; export the table as text (CSV)")


def _separator(lines: list[NumberedLine]) -> str | None:
    """Return what separates columns, as `split_lines` does."""
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
    return _comma_meaning(lines, body, texts)


def _comma_meaning(lines: list[NumberedLine], body: list[int], texts: list[str]) -> str | None:
    """Return whether commas of lines like `40,5` separate two columns, or None for one column.

    Raises a TableError if they can be both.
    """
    above = lines[body[0] - 1][1].strip().rstrip(",") if body[0] > 0 else ""
    titles = next(csv.reader([above])) if above else []
    mixed = not all("," in text for text in texts)
    if len(titles) == 1 and (mixed or len(texts) > 1):
        return None
    if len(titles) > 1 and not any(is_unit(title.strip()) for title in titles[1:]):
        return ","
    if not titles and mixed:
        return None
    number, line = lines[body[0]]
    raise TableError(
        f"line {number}: {quoted_start(line.strip())} can be one number or two; "
        "write numbers with a decimal point, or separate columns by semicolons"
    )


def split_cells(line: str, separator: str | None, number: int) -> list[str]:
    """Return the fields of a line, without white space around them or empty ones at the end.

    A line with one column may end with a comma or a semicolon.
    """
    if '"' in line:
        try:
            found = next(
                csv.reader(
                    [line.strip(" ")],
                    delimiter=separator or "\t",
                    skipinitialspace=True,
                    strict=True,
                )
            )
        except csv.Error:
            raise TableError(f"line {number}: quotation marks do not match") from None
    elif separator == " ":
        found = line.split()
    else:
        found = line.split(separator) if separator else [line]
    cells = [cell.strip() for cell in found]
    if separator is None:
        cells = [cells[0].rstrip(",;").strip()] if len(cells) == 1 else cells
    while cells and not cells[-1]:
        cells.pop()
    return cells
