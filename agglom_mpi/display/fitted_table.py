"""Tables that fit the terminal without cutting anything: what has no room beside follows below."""

from collections.abc import Iterator, Sequence
from typing import Final

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.text import Text

INDENT: Final = 2
"""Number of blanks before what belongs to a heading."""
LEAST_TEXT: Final = 30
"""Minimum width of a text beside its label; with less room the text stands below."""


class FittedTable:
    """A table whose columns stand side by side as far as the terminal is wide.

    The others follow below, in as many pieces as it takes, each with the first column again. Where
    a column has no room beside the first one, each row is a paragraph with a line for each cell. On
    a pipe, and in a file, the table has its full width.

    Parameters
    ----------
    headings
        Of the columns; the first one holds the labels of the rows.
    left
        Columns, by number, whose cells begin at the left; others end at the right.
    gap
        Blanks between columns.
    title
        Above the table.
    """

    def __init__(
        self, *headings: str, left: Sequence[int] = (0,), gap: int = 2, title: str = ""
    ) -> None:
        self.headings = headings
        self.rows: list[tuple[str, ...]] = []
        self._left = set(left)
        self._gap = gap
        self._title = title

    def add_row(self, *cells: str) -> None:
        """Add a row; cells that are missing at its end are empty."""
        self.rows.append((*cells, *[""] * (len(self.headings) - len(cells))))

    def _widths(self) -> list[int]:
        columns = zip(self.headings, *self.rows, strict=True)
        return [max(map(cell_len, column)) for column in columns]

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        widths = self._widths()
        return Measurement(1, max(1, sum(widths) + self._gap * (len(widths) - 1)))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self._title:
            yield Text(self._title, style="table.title", overflow="fold")
        widths = self._widths()
        pieces = self._pieces(widths, options.max_width)
        if pieces is None:
            yield from self._paragraphs(console, options.max_width)
            return
        for place, columns in enumerate(pieces):
            lines = self._lines(columns)
            if place and lines == [self.headings]:
                continue  # nothing stands in these columns
            if place:
                yield Text()
            for row in lines:
                cells = [self._aligned(row[i], widths[i], i) for i in columns]
                style = "table.header" if row is self.headings else ""
                yield _line((" " * self._gap).join(cells).rstrip(), style)

    def _pieces(self, widths: list[int], room: int) -> list[list[int]] | None:
        """Return the columns of each piece of the table; None if one does not fit."""
        pieces = [[0]]
        used = widths[0]
        for column, width in enumerate(widths[1:], 1):
            if used + self._gap + width > room and len(pieces[-1]) > 1:
                pieces.append([0])
                used = widths[0]
            pieces[-1].append(column)
            used += self._gap + width
            if used > room:
                return None
        return pieces

    def _lines(self, columns: list[int]) -> list[tuple[str, ...]]:
        """Return headings and rows that have something in the columns of a piece."""
        headings = [self.headings] if any(self.headings[i] for i in columns) else []
        first = columns[1:2] in ([], [1])
        return headings + [row for row in self.rows if first or any(row[i] for i in columns[1:])]

    def _aligned(self, cell: str, width: int, column: int) -> str:
        blanks = " " * (width - cell_len(cell))
        return cell + blanks if column in self._left else blanks + cell

    def _paragraphs(self, console: Console, room: int) -> RenderResult:
        """Yield for each row its label, and below it each heading with its cell."""
        if self.headings[0]:
            yield Text(self.headings[0], style="table.header", overflow="fold")
        wide = max(map(cell_len, self.headings[1:]), default=0)
        for label, *cells in self.rows:
            yield Text(label, overflow="fold")
            for heading, cell in zip(self.headings[1:], cells, strict=True):
                if not cell:
                    continue
                if INDENT + wide + self._gap + cell_len(cell) <= room:
                    yield _line(f"{' ' * INDENT}{heading:<{wide}}{' ' * self._gap}{cell}".rstrip())
                    continue
                yield from _wrapped(console, heading, room, INDENT) if heading else ()
                yield from _wrapped(console, cell, room, 2 * INDENT)


class LabelledTexts:
    """Texts beside their labels, wrapped between words; below them where there is little room."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, str]] = []

    def add_row(self, label: str, text: str) -> None:
        """Add a label with its text."""
        self.rows.append((label, text))

    def _wide(self) -> int:
        return max((cell_len(label) for label, _ in self.rows), default=0)

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        longest = max((cell_len(text) for _, text in self.rows), default=0)
        return Measurement(1, max(1, self._wide() + INDENT + longest))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        wide = self._wide() + INDENT
        beside = options.max_width - wide
        longest = max((cell_len(text) for _, text in self.rows), default=0)
        if beside < min(LEAST_TEXT, longest):
            for label, text in self.rows:
                yield from _wrapped(console, label, options.max_width, 0)
                yield from _wrapped(console, text, options.max_width, 2 * INDENT)
            return
        for label, text in self.rows:
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
