"""The one table: columns with units and formats, written for terminal, page, Markdown and CSV.

On the terminal nothing is cut: columns without room beside the others follow below. The template of
the page writes `headings` and `cells` as HTML.
"""

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.text import Text

from agglom_mpi.formatting import csv_cell, label_of, number_or_none, value_with_error

INDENT: Final = 2
"""Number of blanks before what belongs to a heading, and between two columns."""
LEAST_TEXT: Final = 30
"""Minimum width of a text beside its label; with less room the text stands below."""


class Column(NamedTuple):
    """A column of a table.

    Attributes
    ----------
    key
        Of its values in the rows.
    label
        Heading; by default the key with blanks.
    unit
        Label of the unit in which values are shown; empty or `1` for pure numbers.
    format
        Format of a number, or a function that makes a text of a value.
    size
        The unit in that of the values in the rows.
    text
        Whether cells begin at the left; others end at the right.
    constant
        Whether all rows have the same value, which the terminal shows of the first one.
    """

    key: str
    label: str | None = None
    unit: str = ""
    format: str | Callable[[Any], str] = ""
    size: float = 1.0
    text: bool = False
    constant: bool = False

    @property
    def heading(self) -> str:
        """The label with the unit behind it: `hardness (MPa)`."""
        label = label_of(self.key) if self.label is None else self.label
        return f"{label} ({self.unit})" if self.unit not in ("", "1") else label

    def cell(self, row: Mapping[str, Any]) -> str:
        """Return the text of a value; empty without one, `none` of nan.

        A pair is a mean and its standard error.
        """
        value = row.get(self.key)
        if value is None or isinstance(value, str):
            return value or ""
        if callable(self.format):
            return self.format(value)
        if isinstance(value, tuple):
            return value_with_error(value[0] / self.size, value[1] / self.size)
        return number_or_none(value if self.size == 1.0 else value / self.size, self.format)


@dataclass(frozen=True)
class Table:
    """Rows of values by the keys of columns; a column without a single cell is left out.

    Attributes
    ----------
    columns
        The first one holds the labels of the rows.
    rows
    title
        Above the table.
    name
        File stem of the table as CSV.
    upright
        Whether the terminal and a wide page show each row as a column.
    anchor
        Key of the column whose numbers name the rows for links, as `string-107`; empty: none.
    mark
        Key of the column whose texts are CSS classes of the rows; empty: none.
    gap
        Number of blanks between two columns on the terminal.
    """

    columns: Sequence[Column]
    rows: Sequence[Mapping[str, Any]]
    title: str = ""
    name: str = "table"
    upright: bool = False
    anchor: str = ""
    mark: str = ""
    gap: int = INDENT

    @cached_property
    def shown(self) -> list[Column]:
        """The first column, and the others that have a cell."""
        first, *others = self.columns
        return [first, *(each for each in others if any(each.cell(row) for row in self.rows))]

    @cached_property
    def headings(self) -> list[str]:
        """Headings of the columns."""
        return [column.heading for column in self.shown]

    @cached_property
    def cells(self) -> list[list[str]]:
        """Texts of the rows."""
        shown = self.shown
        return [[column.cell(row) for column in shown] for row in self.rows]

    def csv(self) -> str:
        """Return the table as CSV, with the texts that are shown."""
        text = io.StringIO()
        rows = [self.headings, *self.cells]
        csv.writer(text).writerows([csv_cell(cell) for cell in row] for row in rows)
        return text.getvalue()

    def markdown(self) -> str:
        """Return the table in Markdown."""
        rules = ["---" if column.text else "---:" for column in self.shown]
        lines = [self.headings, rules, *self.cells]
        texts = ([text.replace("|", "¦") for text in line] for line in lines)
        return "\n".join(f"| {' | '.join(line)} |" for line in texts)

    @cached_property
    def _lines(self) -> list[list[str]]:
        """Headings and rows as the terminal shows them."""
        later = [self._varying(cells) for cells in self.cells[1:]]
        entries = [self.headings, *self.cells[:1], *later]
        return [list(line) for line in zip(*entries, strict=True)] if self.upright else entries

    def _varying(self, cells: Sequence[str]) -> list[str]:
        """Return the cells of a row without those of constant columns."""
        shown = zip(self.shown, cells, strict=True)
        return ["" if column.constant else cell for column, cell in shown]

    @cached_property
    def _widths(self) -> list[int]:
        return [max(map(cell_len, each)) for each in zip(*self._lines, strict=True)]

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement(1, max(1, sum(self._widths) + self.gap * (len(self._widths) - 1)))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the lines of columns side by side as far as they fit.

        The others follow below, in as many pieces as it takes, each with the first column again.
        Where a column has no room beside the first one, each row is a paragraph.
        """
        if self.title:
            yield Text(self.title, style="table.title", overflow="fold")
        pieces = self._pieces(options.max_width)
        if pieces is None:
            yield from self._paragraphs(console, options.max_width)
            return
        for place, columns in enumerate(pieces):
            headings, *rows = self._lines
            first = place == 0
            rows = [row for row in rows if first or any(row[i] for i in columns[1:])]
            if not first:
                yield Text()
            for row in [headings, *rows]:
                cells = [self._aligned(row[i], i) for i in columns]
                style = "table.header" if row is headings else ""
                yield _line((" " * self.gap).join(cells).rstrip(), style)

    def _pieces(self, room: int) -> list[list[int]] | None:
        """Return the columns of each piece of the table; None if one does not fit."""
        pieces = [[0]]
        used = self._widths[0]
        for column, width in enumerate(self._widths[1:], 1):
            if used + self.gap + width > room and len(pieces[-1]) > 1:
                pieces.append([0])
                used = self._widths[0]
            pieces[-1].append(column)
            used += self.gap + width
            if used > room:
                return None
        return pieces

    def _aligned(self, cell: str, column: int) -> str:
        blanks = " " * (self._widths[column] - cell_len(cell))
        left = column == 0 or (not self.upright and self.shown[column].text)
        return cell + blanks if left else blanks + cell

    def _paragraphs(self, console: Console, room: int) -> Iterator[Text]:
        """Yield for each row its label, and below it each heading with its cell."""
        first, *headings = self.headings
        if first:
            yield Text(first, style="table.header", overflow="fold")
        wide = max(map(cell_len, headings), default=0)
        for place, row in enumerate(self.cells):
            label, *cells = self._varying(row) if place else row
            yield Text(label, overflow="fold")
            for heading, cell in zip(headings, cells, strict=True):
                if not cell:
                    continue
                if 2 * INDENT + wide + cell_len(cell) <= room:
                    yield _line(f"{' ' * INDENT}{heading:<{wide}}{' ' * INDENT}{cell}".rstrip())
                    continue
                yield from _wrapped(console, heading, room, INDENT) if heading else ()
                yield from _wrapped(console, cell, room, 2 * INDENT)


class Facts(NamedTuple):
    """A table without headings: texts beside labels, wrapped; below them in a narrow window."""

    rows: Sequence[tuple[str, str]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        wide = max((cell_len(label) for label, _ in self.rows), default=0) + INDENT
        beside = options.max_width - wide
        longest = max((cell_len(text) for _, text in self.rows), default=0)
        for label, text in self.rows:
            if beside < min(LEAST_TEXT, longest):
                yield from _wrapped(console, label, options.max_width, 0)
                yield from _wrapped(console, text, options.max_width, 2 * INDENT)
                continue
            lines = Text(text).wrap(console, beside, overflow="fold")
            for place, line in enumerate(lines or [Text()]):
                begin = label if place == 0 else ""
                blanks = " " * (wide - cell_len(begin))
                yield _line(f"{begin}{blanks}{line.plain}".rstrip())


def _wrapped(console: Console, text: str, room: int, indent: int) -> Iterator[Text]:
    """Yield the lines of a text, broken between words, but for words that are longer than one."""
    for line in Text(text).wrap(console, max(1, room - indent), overflow="fold"):
        yield _line(f"{' ' * indent}{line.plain.rstrip()}")


def _line(text: str, style: str = "") -> Text:
    """Return a line that nothing wraps or cuts."""
    return Text(text, style=style, no_wrap=True, overflow="ignore")
