"""Pieces of a web page that needs nothing but itself: no scripts, no other files."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

from agglom_mpi.report.picture import Picture

LARGEST_DRAWING: Final = 400_000
"""Bytes of an SVG beyond which a page holds the PNG instead, which opens faster."""
PIXELS: Final = 120
"""Of an inch of a picture, at most."""
WIDE: Final = 8.0
"""Inches from which a picture gets the whole width of the page."""

STYLE: Final = """
:root { color: #1b1b1b; background: #fff; font: 16px/1.5 system-ui, sans-serif; }
body { max-width: 1560px; margin: 0 auto; padding: 0 2rem 4rem; }
h1 { line-height: 1.2; margin: 2rem 0 .3rem; } h2 { margin: 3rem 0 .6rem; }
h2 { border-bottom: 1px solid #ccc; } h3 { margin: 1.6rem 0 .4rem; }
nav a { margin-right: 1.2rem; white-space: nowrap; } a { color: #0072B2; }
.state { color: #555; margin: 0 0 1rem; } .note { max-width: 62rem; }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(560px, 1fr)); gap: 2rem;
  grid-auto-flow: dense; }
figure { margin: 0; } figure.wide { grid-column: 1 / -1; }
figure img { display: block; width: 100%; height: auto; }
figcaption { color: #444; font-size: .875rem; max-width: 46rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .875rem; }
caption { text-align: left; font-weight: 600; padding: .6rem 0 .3rem; }
th, td { padding: .2rem .7rem; text-align: right; white-space: nowrap; vertical-align: top; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
thead th { border-bottom: 1px solid #888; border-top: 1px solid #888; }
tbody tr:last-child td { border-bottom: 1px solid #888; } tr.published td { color: #666; }
tr.first td { border-top: 1px solid #e2e2e2; }
pre { background: #f5f5f5; padding: .8rem; overflow-x: auto; font-size: .8125rem; }
code { background: #f5f5f5; padding: 0 .2rem; } li { margin: .15rem 0; }
.warning { border-left: 4px solid #D55E00; padding: .2rem .8rem; background: #fdf3ec; }
@media (max-width: 700px) { .figures { grid-template-columns: 1fr; } body { padding: 0 1rem; } }
@media print { .figures { display: block; } figure { break-inside: avoid; } }
"""


class Section(NamedTuple):
    """A part of a page: the name that links lead to, its heading and its HTML."""

    name: str
    heading: str
    body: str


def page(title: str, head: str, sections: Sequence[Section]) -> str:
    """Return a whole page; `head` is HTML under the title."""
    links = "".join(f'<a href="#{s.name}">{escape(s.heading)}</a> ' for s in sections)
    body = "\n".join(
        f'<section id="{s.name}"><h2>{escape(s.heading)}</h2>\n{s.body}</section>' for s in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n{head}\n<nav>{links}</nav>\n{body}\n</body>\n</html>\n"
    )


def figure(directory: Path, picture: Picture) -> str:
    """Return a picture that was written into a directory, embedded, with its caption."""
    drawing = (directory / f"{picture.name}.svg").read_bytes()
    kind, content = "svg+xml", drawing
    if len(drawing) > LARGEST_DRAWING:
        kind, content = "png", (directory / f"{picture.name}.png").read_bytes()
    data = base64.b64encode(content).decode()
    kind_of_figure = ' class="wide"' if picture.size[0] >= WIDE else ""
    width = round(PIXELS * picture.size[0])
    caption = escape(picture.caption)
    return (
        f'<figure{kind_of_figure}><img alt="{escape(picture.caption, quote=True)}" '
        f'style="max-width: {width}px" src="data:image/{kind};base64,{data}"><figcaption>{caption} '
        f"<code>{picture.name}.png</code> <code>{picture.name}.svg</code></figcaption></figure>\n"
    )


def figures(parts: Iterable[str]) -> str:
    """Return pictures side by side where there is room."""
    joined = "".join(parts)
    return f'<div class="figures">\n{joined}</div>\n' if joined else ""


def table(
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    caption: str = "",
    classes: Sequence[str] = (),
    texts: Sequence[int] = (),
) -> str:
    """Return a table.

    Parameters
    ----------
    classes
        Class of each row, if they have any.
    texts
        Columns of text, which is not set to the right.
    """

    def cell(tag: str, place: int, text: str) -> str:
        kind = ' class="text"' if place in texts else ""
        return f"<{tag}{kind}>{escape(text)}</{tag}>"

    head = "".join(cell("th", i, text) for i, text in enumerate(headings))
    lines = []
    for number, row in enumerate(rows):
        kind = f' class="{classes[number]}"' if classes else ""
        lines.append(f"<tr{kind}>" + "".join(cell("td", i, t) for i, t in enumerate(row)) + "</tr>")
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    body = "\n".join(lines)
    return (
        f'<div class="scroll"><table>{title}<thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>\n"
    )


def paragraph(text: str, kind: str = "note") -> str:
    """Return plain text as a paragraph."""
    return f'<p class="{kind}">{escape(text)}</p>\n'


def listed(lines: Iterable[str]) -> str:
    """Return lines of plain text as a list."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>\n"


def folded(heading: str, text: str) -> str:
    """Return preformatted text under a heading that opens it."""
    return f"<details><summary>{escape(heading)}</summary><pre>{escape(text)}</pre></details>\n"
