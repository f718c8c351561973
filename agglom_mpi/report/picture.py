"""A figure as every report of this package draws and writes it."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    import matplotlib.figure

COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette, told apart by colour-blind readers too."""

SIZE: Final = (6.0, 3.8)
"""Inches of a figure with one panel; at 110 dots per inch it fits a page."""

DOTS_PER_INCH: Final = 110


class Picture(NamedTuple):
    """A picture, `NAME.png` and `NAME.svg`; `draw` fills an empty matplotlib figure.

    Attributes
    ----------
    name : str
        File stem.
    caption : str
        What is seen, one or two sentences.
    draw : callable
    size : tuple
        Width and height in inches.
    """

    name: str
    caption: str
    draw: "Callable[[matplotlib.figure.Figure], None]"
    size: tuple[float, float] = SIZE


def write_picture(directory: Path, picture: Picture) -> None:
    """Write a picture into a directory as PNG and SVG, each whole under its name or not there."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=picture.size, layout="constrained")
    FigureCanvasAgg(figure)
    picture.draw(figure)
    for suffix in ("png", "svg"):
        path = directory / f"{picture.name}.{suffix}"
        temporary = path.with_name(f".{path.name}.new")
        metadata: dict[str, Any] = {"Date": None} if suffix == "svg" else {}
        figure.savefig(temporary, format=suffix, dpi=DOTS_PER_INCH, metadata=metadata)
        os.replace(temporary, path)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file, which is whole under its name or what it was before."""
    temporary = path.with_name(f".{path.name}.new")
    temporary.write_bytes(content)
    os.replace(temporary, path)
