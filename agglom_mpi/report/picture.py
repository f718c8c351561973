"""A figure as every report of this package draws and writes it."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from agglom_mpi.storage.files import atomic_file

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
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=picture.size, dpi=DOTS_PER_INCH, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    picture.draw(figure)
    # `savefig` draws everything twice, and lays it out anew each time.
    with atomic_file(directory / f"{picture.name}.png", replace=True) as path:
        canvas.print_png(path)
    figure.set_layout_engine("none")
    with atomic_file(directory / f"{picture.name}.svg", replace=True) as path:
        FigureCanvasSVG(figure).print_svg(path, metadata={"Date": None})
