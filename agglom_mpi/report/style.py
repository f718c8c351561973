"""How every figure looks and is written: lettering at print width, colours, ticks, labels, parts.

A figure is as wide as a column, a column and a half or a page of a journal, and its lettering has
7 to 9 points there. Axes that a caller hands in keep the caller's own style.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from agglom_mpi.formatting import ROUNDING, axis_label, label_of
from agglom_mpi.storage.files import atomic_file
from agglom_mpi.variables import Variable

if TYPE_CHECKING:
    import matplotlib.figure
    import numpy as np
    import numpy.typing as npt


COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette, which colour-blind readers distinguish too."""
POINT_MAP: Final = "viridis"
"""Colours of points and spheres, all of which stand out from white."""
MIDDLE, PAGE = 5.5, 7.48
"""Widths of a figure over a column and a half, and over a page, inches: 140 and 190 mm."""
SIZE: Final = (MIDDLE, 3.5)
"""Width and height of a figure with one panel, inches."""
DOTS_PER_INCH: Final = 200
STYLE: Final[dict[str, Any]] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "figure.titlesize": 8.0,
    "figure.labelsize": 8.0,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.frameon": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.0,
    "errorbar.capsize": 2.0,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "hatch.linewidth": 0.5,
}
"""Settings of matplotlib while a figure is made."""
LABEL_ROOM: Final = {"x": 0.42, "y": 0.24}
"""Room that a label of a tick takes along an axis, inches."""
PLAIN: Final = (1e-4, 1e5)
"""Numbers from the first and below the second are written without a power of ten."""
SUBSCRIPTS: Final = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
GREEK: Final = {"rho": "ρ", "mu": "μ", "theta": "θ", "kappa": "κ", "gamma": "γ", "phi": "φ"}
"""Greek letters of symbols, by their names."""


@contextmanager
def styled() -> Iterator[None]:
    """Make figures in the package's style."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        yield


def field_map() -> Any:
    """Return the colours of a field: light blue to blue, on which dark and red lines stand out."""
    import matplotlib as mpl
    import numpy as np
    from matplotlib.colors import ListedColormap

    return ListedColormap(mpl.colormaps["Blues"](np.linspace(0.06, 0.8, 256)))


def finish(axes: Any) -> None:
    """Label the logarithmic axes of a drawn figure, and letter its panels if they are a row.

    Parameters
    ----------
    axes
        Axes or an array of them; panels of a matrix, (m, m), are named by their axes alone.
    """
    import numpy as np
    from matplotlib.axes import Axes
    from matplotlib.ticker import LogLocator

    shown = [ax for ax in np.ravel(axes) if isinstance(ax, Axes) and ax.figure is not None]
    for ax in shown:
        for axis in (ax.xaxis, ax.yaxis):
            if isinstance(axis.get_major_locator(), LogLocator):
                log_ticks(axis)
    if len(shown) > 1 and np.ndim(axes) == 1:
        for ax, letter in zip(shown, ascii_lowercase, strict=False):
            title = ax.get_title()
            ax.set_title(f"({letter}) {title}".rstrip(), loc="center" if title else "left")


def variable_label(variable: Variable, unit: str) -> str:
    """Return the label of a variable on an axis: `hardness H₀ (MPa)`, `sizes: spread`."""
    name, symbol = label_of(variable.name.replace(".", ": ")), variable.symbol
    letters = symbol.rstrip("0123456789")
    index = symbol[len(letters) :].translate(SUBSCRIPTS)
    is_named = symbol in (variable.name, "")
    return axis_label(name if is_named else f"{name} {GREEK.get(letters, letters)}{index}", unit)


def integer_ticks(axis: Any) -> None:
    """Put the ticks of an axis at integers only."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(integer=True, nbins="auto", min_n_ticks=1))


def tick_text(value: float, _: object = None) -> str:
    """Return the label of a tick: `0.05`, `5000`, `2×10⁻⁵`."""
    if value == 0.0 or PLAIN[0] <= abs(value) < PLAIN[1]:
        return f"{value:.6g}"
    power = math.floor(math.log10(abs(value)) + 1e-9)
    digits = f"{value / 10.0**power:.3g}"
    return f"$10^{{{power}}}$" if digits == "1" else rf"${digits}\times10^{{{power}}}$"


def log_ticks(axis: Any) -> None:
    """Label a logarithmic axis that is drawn already so that its labels do not overlap.

    It has 1, 2 and 5 of each decade where they have room, otherwise decades, or some of them.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    low, high = sorted(axis.get_view_interval())
    decades = math.log10(high / low) if low > 0.0 else 0.0
    ax, name = axis.axes, axis.axis_name
    side = 0 if name == "x" else 1
    length = ax.get_position().size[side] * ax.get_figure(root=True).get_size_inches()[side]
    room = max(2, int(length / LABEL_ROOM[name]))
    if 0.0 < decades < 1.0:
        axis.set_major_locator(MaxNLocator(min(room, 5)))
    elif 3.0 * decades <= room:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=99))
    else:
        axis.set_major_locator(LogLocator(numticks=room))
    is_plain = (PLAIN[0] <= low and high < PLAIN[1]) or decades < 1.0
    is_plain = is_plain or 3.0 * decades <= room
    axis.set_major_formatter(FuncFormatter(tick_text if is_plain else _power_text))
    axis.set_minor_formatter(NullFormatter())
    if decades > 4.0 or 3.0 * decades <= room:
        axis.set_minor_locator(NullLocator())


def _power_text(value: float, _: object) -> str:
    return f"$10^{{{round(math.log10(value))}}}$"


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

    So it shows an interval that ends at 0, which on a logarithmic axis has no end. Two strokes
    mark where the scale changes.
    """
    from matplotlib.ticker import FuncFormatter, NullLocator

    change = 10.0 ** math.floor(math.log10(lowest))
    ax.set_yscale("symlog", linthresh=change, linscale=0.5)
    ax.set_ylim(bottom=0.0)
    ax.yaxis.set_major_formatter(FuncFormatter(tick_text))
    ax.yaxis.set_minor_locator(NullLocator())
    stroke = {"marker": [(-1.0, -0.5), (1.0, 0.5)], "markersize": 7, "color": "black"}
    where = ax.get_yaxis_transform()
    heights = [0.45 * change, 0.6 * change]
    ax.plot([0.0, 0.0], heights, ls="none", transform=where, clip_on=False, **stroke)


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
