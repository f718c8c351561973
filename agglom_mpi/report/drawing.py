"""How every figure of the package looks, and how it is written as PNG and SVG."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from agglom_mpi.formatting import ROUNDING
from agglom_mpi.storage.files import atomic_file

if TYPE_CHECKING:
    import matplotlib.figure
    import numpy as np
    import numpy.typing as npt

COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette, which colour-blind readers distinguish too."""

SIZE: Final = (6.0, 3.8)
"""Width and height of a figure with one panel, inches; at 110 dots per inch it fits a page."""

LEGEND_DISTANCE: Final = 5.0
"""Room between the axes and a legend below, for ticks and a label, in sizes of its letters."""
DOTS_PER_INCH: Final = 110
MANY_DECADES: Final = 200.0
"""Minimum ratio of the ends of a logarithmic axis for powers of ten alone as labels."""
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

    figure = Figure(figsize=drawing.size, dpi=DOTS_PER_INCH, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    drawing.draw(figure)
    # `savefig` draws everything twice, and lays it out anew each time.
    with atomic_file(directory / f"{drawing.name}.png", replace=True) as path:
        canvas.print_png(path)
    figure.set_layout_engine("none")
    with atomic_file(directory / f"{drawing.name}.svg", replace=True) as path:
        FigureCanvasSVG(figure).print_svg(path, metadata={"Date": None})


def style_axes(ax: Any) -> None:
    """Draw a faint grid behind everything, and no frame at the top and right."""
    ax.grid(True, which="major", color="0.9", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


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


def integer_ticks(axis: Any) -> None:
    """Put the ticks of an axis at integers only."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(integer=True, nbins="auto", min_n_ticks=1))


def log_ticks(axis: Any) -> None:
    """Label a logarithmic axis that is drawn already so that its labels do not overlap.

    Over few decades matplotlib labels every digit, as wide as powers of ten.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    axis.set_minor_formatter(NullFormatter())
    lower, upper = axis.get_data_interval()
    if 0.0 < lower < upper < MANY_DECADES * lower:
        narrow = upper < 10.0 * lower
        axis.set_major_locator(MaxNLocator(5) if narrow else LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))


def few_ticks(first: float, last: float, logarithmic: bool) -> "npt.NDArray[np.float64]":
    """Return at most five places from first to last that have room for labels, ascending, (t,)."""
    import numpy as np
    from matplotlib.ticker import LogLocator, MaxNLocator

    decades = math.log10(last / first) if logarithmic else 0.0
    subs = (1.0, 3.0) if decades < 2.0 else (1.0,)
    locator = LogLocator(subs=subs) if decades >= 1.0 else MaxNLocator(4)
    ticks = np.asarray(locator.tick_values(first, last))
    ticks = ticks[(ticks >= first * (1 - 1e-9)) & (ticks <= last * (1 + 1e-9))]
    return np.asarray(ticks[:: math.ceil(len(ticks) / 5)] if len(ticks) else ticks)


def log_scale_from_zero(ax: Any, lowest: float) -> None:
    """Make the vertical axis logarithmic down to the decade of `lowest`, and linear below, to 0.

    So it shows an interval that ends at 0, which on a logarithmic axis has no end.
    """
    ax.set_yscale("symlog", linthresh=10.0 ** math.floor(math.log10(lowest)), linscale=0.5)
    ax.set_ylim(bottom=0.0)


def legend_below(ax: Any, columns: int = 2) -> None:
    """Put the legend under the axes, where it hides nothing."""
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        borderaxespad=LEGEND_DISTANCE,
        ncols=columns,
        frameon=False,
        fontsize="small",
    )


def figure_legend(figure: Any, axes: Any, columns: int) -> None:
    """Put a legend of all axes under a figure, each label once."""
    entries: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    style = {"loc": "outside lower center", "frameon": False, "fontsize": "small"}
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
