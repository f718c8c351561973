"""A section of the page: a function that yields its blocks, the register of all sections, figures.

Figures stand in the page as inline SVG that follows the page's colours, or as PNG.
"""

import base64
import io
import re
from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial
from html import escape
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console, RenderableType

from agglom_mpi.config import describe
from agglom_mpi.declaration.components import import_modules
from agglom_mpi.display.table import Table
from agglom_mpi.report import style
from agglom_mpi.report.figures.figure import FigureOptions, figures
from agglom_mpi.report.sample_particles import FramesUnavailableError
from agglom_mpi.report.style import STRING_LINK, Drawing
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

MAX_SVG_BYTES: Final = 600_000
"""Size of an SVG beyond which the page holds the PNG instead, which opens faster."""
PIXELS_PER_INCH: Final = 120
"""Maximum resolution of a figure on the page."""
SCROLLED_PIXELS_PER_INCH: Final = 90
"""Minimum resolution of a large figure in a narrow window, where it scrolls: 8 pt are 10 pixels."""
SCROLLED: Final = 6.5
"""Minimum width of a figure that scrolls in a narrow window, inches; smaller ones stay legible."""
WIDE: Final = 7.0
"""Minimum width of a figure that takes the whole width of the page, inches."""
DARKEST: Final = 0x17
"""Level of white in dark mode, of 255: the background of the page there."""
BRIGHTEST: Final = 0xE6
"""Level of black in dark mode, of 255: the text of the page there."""

_NOT_DRAWN: Final = re.compile(r"<metadata>.*?</metadata>|<style[^>]*>.*?</style>", re.DOTALL)
_IDENTIFIER: Final = re.compile(r'(\bid="|(?:xlink:)?href="#|url\(#)(?!string-)')
_GREY: Final = re.compile(r"(fill|stroke|stop-color): (#([0-9a-f]{2})\3\3)\b")
_STRING: Final = re.compile(rf'<a xlink:href="{re.escape(STRING_LINK)}(\d+)"[^>]*>')
_OPENING: Final = re.compile(r'<svg [^>]*viewBox="([^"]*)"[^>]*>')


def embedded(directory: Path, drawing: Drawing) -> dict[str, Any]:
    """Return a figure that was written into a directory as the template of the page takes it.

    The image is `svg`, an element, or else `source`, the `data:` URI of a PNG; `width` is its
    largest width and `scrolled_width` that in a narrow window, pixels, 0 if it shrinks to the
    window; `wide` is whether it takes the whole width of the page.
    """
    content, source = (directory / f"{drawing.name}.svg").read_bytes(), ""
    svg, width = inline_svg(content.decode(), drawing), drawing.size[0]
    if len(content) > MAX_SVG_BYTES:
        image = base64.b64encode((directory / f"{drawing.name}.png").read_bytes()).decode()
        svg, source = "", f"data:image/png;base64,{image}"
    return {
        "name": drawing.name,
        "caption": drawing.caption,
        "svg": svg,
        "source": source,
        "width": round(PIXELS_PER_INCH * width),
        "scrolled_width": round(SCROLLED_PIXELS_PER_INCH * width) if width >= SCROLLED else 0,
        "wide": width >= WIDE,
    }


def inline_svg(text: str, drawing: Drawing) -> str:
    """Return an SVG file as an element of the page.

    Its identifiers are unique in the page, its greys are those of dark mode where the page is dark,
    and links to strings lead to the rows of the page's table, but not for the Tab key.
    """
    text = _NOT_DRAWN.sub("", text[text.index("<svg") :])
    text = _IDENTIFIER.sub(rf"\g<1>{drawing.name}-", text)
    text = _GREY.sub(_with_dark_grey, text)
    text = _STRING.sub(r'<a href="#string-\1" tabindex="-1">', text)
    label = escape(drawing.caption, quote=True)

    def opening(found: re.Match[str]) -> str:
        return f'<svg viewBox="{found[1]}" role="img" aria-label="{label}">'

    return _OPENING.sub(opening, text, count=1)


def _with_dark_grey(found: re.Match[str]) -> str:
    """Return a declaration of a grey followed by one for light and dark pages.

    Browsers that do not know `light-dark` ignore the second one.
    """
    kind, grey, level = found.groups()
    dark = BRIGHTEST - round((BRIGHTEST - DARKEST) * int(level, 16) / 255)
    return f"{kind}: {grey}; {kind}: light-dark({grey}, #{3 * f'{dark:02x}'})"


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
        found: list[dict[str, Any]] = []
        for figure in figures().values():
            if figure.section != section:
                continue
            try:
                drawn = figure.drawing(self.data, self.options)
            except FramesUnavailableError as error:
                self.why_no_frames = str(error)
                continue
            if drawn is not None:
                style.write_drawing(self._directory, drawn)
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
