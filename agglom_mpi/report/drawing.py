"""How a figure is written as PNG and SVG, and the parts that several figures have.

`style.py` decides how they look.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from agglom_mpi.formatting import ROUNDING
from agglom_mpi.report.style import DOTS_PER_INCH, SIZE, finish, styled
from agglom_mpi.storage.files import atomic_file

if TYPE_CHECKING:
    import matplotlib.figure
    import numpy as np
    import numpy.typing as npt

LEGEND_DISTANCE: Final = 5.0
"""Room between the axes and a legend below, for ticks and a label, in sizes of its letters."""
STRING_LINK: Final = "report.html#string-"
"""Address of a string's row in the page, without its number; marks of strings link to it."""


class Drawing(NamedTuple):
    """A figure that is ready to be drawn and written as `NAME.png` and `NAME.svg`.

    Attributes
    ----------
    name : str
        File stem.
    caption : str
        What is seen, in one or two sentences.
    draw : callable
        Fills an empty matplotlib figure.
    size : tuple
        Width and height, inches.
    """

    name: str
    caption: str
    draw: "Callable[[matplotlib.figure.Figure], Any]"
    size: tuple[float, float] = SIZE


def write_drawing(directory: Path, drawing: Drawing) -> None:
    """Write a figure into a directory as PNG and SVG, each complete under its name or absent."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with styled():
        figure = Figure(figsize=drawing.size, dpi=DOTS_PER_INCH, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        axes = drawing.draw(figure)
        finish(figure.axes if axes is None else axes)
        # `savefig` draws everything twice, and lays it out anew each time.
        with atomic_file(directory / f"{drawing.name}.png", replace=True) as path:
            canvas.print_png(path)
        figure.set_layout_engine("none")
        with atomic_file(directory / f"{drawing.name}.svg", replace=True) as path:
            FigureCanvasSVG(figure).print_svg(path, metadata={"Date": None})


def note(ax: Any, text: str) -> None:
    """Write into empty axes why they are empty."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color="0.35")
    ax.set_xticks([])
    ax.set_yticks([])


def histogram_range(values: "npt.NDArray[np.float64]") -> tuple[float, float] | None:
    """Return the range of a histogram of values, (n,), that are equal but for rounding; else None.

    NumPy widens the range of values that are exactly equal, and fails for others.
    """
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    size = max(abs(low), abs(high))
    return None if high - low > ROUNDING * size else (low - 0.5, high + 0.5)


def legend_below(ax: Any, columns: int = 2) -> None:
    """Put the legend under the axes, where it hides nothing."""
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        borderaxespad=LEGEND_DISTANCE,
        ncols=columns,
    )


def figure_legend(figure: Any, axes: Any, columns: int) -> None:
    """Put a legend of all axes under a figure, each label once."""
    entries: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    style = {"loc": "outside lower center"}
    figure.legend(entries.values(), entries.keys(), ncols=columns, **style)


def panels(figure: Any, count: int, columns: int, label: str = "") -> Any:
    """Return the axes of a number of panels in rows, (count,), below which a `label` stands once.

    Axes with a label share their abscissa.
    """
    columns = min(count, columns)
    shape = -(-count // columns), columns
    axes = figure.subplots(*shape, sharex=bool(label), squeeze=False).ravel()
    for unused in axes[count:]:
        unused.remove()
    for ax in axes[max(0, count - columns) : count] if label else ():
        ax.set_xlabel(label)
        ax.xaxis.set_tick_params(labelbottom=True)
    return axes[:count]


def draw_band(ax: Any, x: Any, middle: Any, ends: Any, colour: str, **line: Any) -> None:
    """Draw a curve, (n,), and the band between its two `ends`, (2, n)."""
    ax.plot(x, middle, color=colour, **line)
    ax.fill_between(x, *ends, color=colour, alpha=0.18, linewidth=0)


def draw_estimate(ax: Any, x: float, estimate: Any, colour: str, label: str | None) -> None:
    """Draw the `Estimate` of a string on fresh samples with its 95 % interval."""
    value = estimate.objective
    style = {"marker": "D", "markersize": 4, "capsize": 3, "linestyle": "none"}
    bars = [[value - estimate.lower], [estimate.upper - value]]
    ax.errorbar(x, value, bars, color=colour, label=label, **style)
