"""A section of the page: a function that yields its blocks, and the register of all sections."""

import io
from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console, RenderableType

from agglom_mpi.config import describe
from agglom_mpi.declaration.components import import_modules
from agglom_mpi.display.table import Table
from agglom_mpi.report import drawing
from agglom_mpi.report.embedding import EmbeddedFigure, embedded
from agglom_mpi.report.figures.figure import FigureOptions, figures
from agglom_mpi.report.sample_particles import FramesUnavailableError
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

TEXT_WIDTHS: Final = (140, 42, 100)
"""Maximum number of characters in a line of text on a wide page, on a narrow one, and on paper."""


class Block(NamedTuple):
    """Part of a section: a macro of the template `report.html.j2`, and what it shows."""

    kind: str
    content: Any
    heading: str = ""


note, warning, bullets = (partial(Block, kind) for kind in ("note", "warning", "bullets"))


def folded(heading: str, text: str) -> Block:
    """Return a text that can be folded."""
    return Block("folded", text, heading)


def shown(content: RenderableType) -> Block:
    """Return what the terminal shows as texts for a wide page, for a narrow one, and for paper."""
    return Block("texts", [plain_text(content, width) for width in TEXT_WIDTHS])


def plain_text(content: RenderableType, width: int) -> str:
    """Return a renderable as lines of text with at most `width` characters."""
    console = Console(width=width, color_system=None, file=io.StringIO())
    with console.capture() as captured:
        console.print(content, soft_wrap=False)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())


class Page:
    """Inputs of the sections of a page, and the figures written so far.

    Attributes
    ----------
    data, options, published
        The campaign, what is asked of its figures, and a paper's `Published` tables or None.
    figure_count
        Figures written so far.
    why_no_frames
        Why there are no particles to draw; empty if there are.
    """

    def __init__(
        self,
        data: CampaignData,
        directory: Path,
        options: FigureOptions,
        published: Any = None,
    ) -> None:
        self.data = data
        self.options = options
        self.published = published
        self.figure_count = 0
        self.why_no_frames = ""
        self._directory = directory

    @cached_property
    def described(self) -> list[describe.Paragraph]:
        """The campaign in paragraphs, as `agglom check` prints it; raises a CampaignError."""
        return describe.sections(recorded_campaign(self.data))

    def figures(self, section: str) -> Block:
        """Write the figures of a section that have something to show, and return them."""
        found: list[EmbeddedFigure] = []
        for figure in figures().values():
            if figure.section != section:
                continue
            try:
                drawn = figure.drawing(self.data, self.options)
            except FramesUnavailableError as error:
                self.why_no_frames = str(error)
                continue
            if drawn is not None:
                drawing.write_drawing(self._directory, drawn)
                found.append(embedded(self._directory, drawn))
        self.figure_count += len(found)
        return Block("figures", found)

    def sections(self) -> Iterator[tuple["Section", list[Block]]]:
        """Yield the sections that have something to show, and their blocks."""
        for section in sections():
            blocks = [
                Block("table", block) if isinstance(block, Table) else block
                for block in section.blocks(self)
            ]
            if blocks:
                yield section, blocks


class Section(NamedTuple):
    """A section of the page: its identifier, its place among the others, its heading, its blocks.

    Figures of this section follow where its function yields `page.figures(name)`.
    """

    name: str
    place: int
    heading: str
    blocks: Callable[[Page], Iterator[Block | Table]]


SECTIONS: Final[list[Section]] = []


def section(place: int, heading: str, name: str = "") -> Callable[[Any], Any]:
    """Declare a function as a section of the page that has its name, or another."""

    def declare(blocks: Callable[[Page], Iterator[Block | Table]]) -> Any:
        SECTIONS.append(Section(name or blocks.__name__, place, heading, blocks))
        return blocks

    return declare


@cache
def sections() -> list[Section]:
    """Return all sections in their order."""
    import_modules(__package__)
    return sorted(SECTIONS, key=lambda each: each.place)
