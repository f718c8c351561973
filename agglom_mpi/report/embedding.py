"""Figures as the page holds them: inline SVG that follows the page's colours, or PNG."""

import base64
import re
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

from agglom_mpi.report.drawing import STRING_LINK, Drawing

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


class EmbeddedFigure(NamedTuple):
    """A figure in the page.

    Attributes
    ----------
    name, caption
    svg
        The image as an `svg` element; empty if `source` holds it.
    source
        The image as a `data:` URI of a PNG; empty if `svg` holds it.
    width
        Largest width on the page, pixels.
    scrolled_width
        Width in a narrow window, pixels; 0 if the figure shrinks to the window.
    wide
        Whether it takes the whole width of the page.
    """

    name: str
    caption: str
    svg: str
    source: str
    width: int
    scrolled_width: int
    wide: bool


def embedded(directory: Path, drawing: Drawing) -> EmbeddedFigure:
    """Return a figure that was written into a directory as the page holds it."""
    content, source = (directory / f"{drawing.name}.svg").read_bytes(), ""
    svg, width = inline_svg(content.decode(), drawing), drawing.size[0]
    if len(content) > MAX_SVG_BYTES:
        image = base64.b64encode((directory / f"{drawing.name}.png").read_bytes()).decode()
        svg, source = "", f"data:image/png;base64,{image}"
    scrolled = round(SCROLLED_PIXELS_PER_INCH * width) if width >= SCROLLED else 0
    pixels = round(PIXELS_PER_INCH * width), scrolled
    return EmbeddedFigure(drawing.name, drawing.caption, svg, source, *pixels, width >= WIDE)


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
