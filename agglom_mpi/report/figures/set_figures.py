"""The feasible set: pairs of variables, marginals, what decides, and how reliable it is."""

import re
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.formatting import label_of
from agglom_mpi.inference.emulated_set import BOX_POINTS
from agglom_mpi.inference.set_points import OUTER_PROBABILITY
from agglom_mpi.report.figures.box_panels import (
    MAX_PLOTTED_VARIABLES,
    BoxPoints,
    contour_handle,
    corner_legend,
    corner_size,
    draw_contour,
    draw_corner,
    draw_field,
    draw_marginal,
    pair_edges,
    scale_axis,
)
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.set_summary import shown_directions
from agglom_mpi.report.style import COLOURS, PAGE, POINT_MAP, histogram_range, legend_below
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.inference.feasible_set import FeasibleSet
    from agglom_mpi.inference.set_directions import SetVariable

Floats = NDArray[np.float64]

PLOTTED_POINTS: Final = 1 << 15
"""Number of points that panels are made of."""
PAIR_CELLS: Final = 32
"""Number of cells of a pair's panel along each side."""
SMOOTHING: Final = 0.8
"""Standard deviation of the smoothing of a pair's panel, in its cells."""
FRACTION: Final = "fraction of strings in the set"
DENSITY: Final = "density over prior"
REACH_BARS: Final = 40
"""Number of bars of a distribution over the box."""
AXIS_NAMES: Final = {"mean_radius_ratio": "mean b/b⁰", "objective": "value of the function"}
"""Labels of the axes of quantities, where the name of the column is not one."""


class PlottedSet(NamedTuple):
    """A set with points of the box, whose weights are their probabilities, to draw it by.

    `variables` are the searched ones, the decided ones first.
    """

    of: "FeasibleSet"
    variables: "dict[str, SetVariable]"
    points: BoxPoints


def plotted(_: CampaignData, options: FigureOptions) -> PlottedSet | None:
    """Return the set of a campaign with points to draw it by; None where it is empty."""
    of = _calibrated(options)
    if of is None or of.empty or of.volume <= 0.0:
        return None
    return _plotted(of)


def _calibrated(options: FigureOptions) -> "FeasibleSet | None":
    of = options.feasible_set
    return of if of is not None and of.calibration.passed else None


@lru_cache(maxsize=1)  # several figures show it
def _plotted(of: "FeasibleSet") -> PlottedSet:
    box, lower, upper = of.emulated.box, of.points.lower, of.points.upper
    strings = box.even_strings(PLOTTED_POINTS, lower, upper)
    ordered = sorted(of.variables, key=lambda each: (each.free, each.kept))
    names = [each.name for each in ordered]
    units, probability = box.space.to_unit(strings), of.emulated.probability(strings)
    points = BoxPoints(box, names, units, probability, lower, upper)
    return PlottedSet(of, dict(zip(names, ordered, strict=True)), points)


def draw_pairs(figure: "matplotlib.figure.Figure", shown: PlottedSet) -> Any:
    """Draw a panel for each pair of variables, and return the axes, shape (m, m)."""
    points = shown.points
    names = points.names[:MAX_PLOTTED_VARIABLES]
    fields = {pair: _pair_field(points, *pair) for pair in combinations(names, 2)}
    most = max((float(field.max()) for _, field in fields.values()), default=1.0)
    images = []
    axes = draw_corner(
        figure,
        points,
        lambda ax, name: _draw_marginal(ax, shown, name),
        lambda ax, x, y: images.append(_draw_pair(ax, points, (x, y), fields[x, y], most)),
    )
    if images:
        # The upper right half is empty.
        place = figure.add_axes((0.62, 0.92, 0.3, 0.025))
        place.set_in_layout(False)
        figure.colorbar(images[0], cax=place, orientation="horizontal", label=FRACTION)
        corner_legend(figure, _pair_handles())
    return axes


def _pair_field(points: BoxPoints, column: str, row: str) -> tuple[list[Floats], Floats]:
    """Return the edges of a pair's cells, and the fraction of strings in the set, smoothed."""
    from scipy.ndimage import gaussian_filter

    edges = pair_edges(points, column, row, PAIR_CELLS)
    x, y = points.column(column), points.column(row)
    mass, count = (
        gaussian_filter(np.histogram2d(x, y, edges, weights=each)[0], SMOOTHING, mode="nearest")
        for each in (points.weights, None)
    )
    return edges, mass / np.maximum(count, 1e-9)


def _draw_pair(
    ax: Any,
    points: BoxPoints,
    pair: tuple[str, str],
    field: tuple[list[Floats], Floats],
    most: float,
) -> Any:
    """Draw the fraction of strings with a pair of values that is in the set."""
    from scipy.ndimage import gaussian_filter

    edges, fraction = field
    image = draw_field(ax, edges, fraction, most)
    draw_contour(ax, edges, fraction, 0.5 * most, "solid")
    some = points.weights >= OUTER_PROBABILITY
    x, y = (points.column(each)[some] for each in pair)
    there = np.histogram2d(x, y, edges)[0] > 0
    outline = gaussian_filter(there.astype(np.float64), SMOOTHING, mode="nearest")
    draw_contour(ax, edges, outline, 0.5, "dashed")
    return image


def _pair_handles() -> list[Any]:
    possible = f"possible (P ≥ {OUTER_PROBABILITY:g})"
    half = "half of the largest fraction"
    return [contour_handle("dashed", possible), contour_handle("solid", half)]


SetPanel = tuple[PlottedSet, str, str | None]
"""A set, and one or two of its variables."""


def draw_panel(ax: Any, panel: SetPanel) -> Any:
    """Draw the marginal of a variable, or a pair of them, into axes, and return these."""
    shown, x, y = panel
    scale_axis(ax.xaxis, shown.points, x, label=True)
    if y is None:
        _draw_marginal(ax, shown, x)
        ax.set_ylabel(DENSITY)
        return ax
    field = _pair_field(shown.points, x, y)
    image = _draw_pair(ax, shown.points, (x, y), field, float(field[1].max()))
    ax.set(xlim=shown.points.ends(x), ylim=shown.points.ends(y))
    scale_axis(ax.yaxis, shown.points, y, label=True)
    ax.figure.colorbar(image, ax=ax, label=FRACTION)
    ax.legend(handles=_pair_handles(), loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return ax


def _panel(data: CampaignData, options: FigureOptions) -> SetPanel | None:
    """Return the set with the variables of a panel, the first of which decides most.

    Raises
    ------
    CampaignError
        If one is no searched variable.
    """
    if not options.plotted or (shown := plotted(data, options)) is None:
        return None
    names, box = shown.points.names, shown.points.box
    for name in filter(None, (options.x, options.y)):
        if name not in names:
            raise box.mistaken(name, f"is no searched variable; {suggestion(name, names)}")
    return shown, options.x or names[0], options.y


def _draw_marginal(ax: Any, shown: PlottedSet, name: str) -> None:
    free = shown.variables[name].free
    draw_marginal(ax, shown.points, name, "0.75" if free else COLOURS[0])
    ax.set_title("free" if free else "decided", color="0.4", pad=2)


def draw_group(ax: Any, shown: PlottedSet) -> Any:
    """Draw the mean against the combination that decides most, and return the axes."""
    of = shown.of
    [row, *_] = shown_directions(of)
    emulated = of.emulated
    strings = emulated.box.space.from_unit(shown.points.units[:BOX_POINTS])
    x = _combination(of, row, strings)
    mean, deviation = emulated.mean(strings)[:, 0], emulated.deviation(strings)[:, 0]
    ax.vlines(
        x,
        mean - 1.645 * deviation,
        mean + 1.645 * deviation,
        color="0.65",  # pixels keep their grey on a dark page
        linewidth=0.6,
        zorder=1,
        rasterized=True,
        label="90 % interval",
    )
    image = ax.scatter(
        x,
        mean,
        s=5,
        c=shown.points.weights[: len(x)],
        cmap=POINT_MAP,
        vmin=0,
        vmax=1,
        rasterized=True,
        zorder=3,
    )
    ax.figure.colorbar(image, ax=ax, label="probability of being in the set")
    lower, upper = of.bounds
    if np.isfinite(lower) or np.isfinite(upper):
        bottom, top = ax.get_ylim()
        ax.axhspan(
            max(lower, bottom),
            min(upper, top),
            color=COLOURS[4],
            alpha=0.35,
            zorder=0,
            label="target",
        )
    legend_below(ax)
    ax.set_xscale("log")
    name = f"{row['group']}" if row["group"] else _product_label(row["product"])
    constant = " (without constants)" if row["group"] else " (SI units)"
    ax.set_xlabel(f"{name}{constant}")
    ax.set_ylabel(AXIS_NAMES.get(of.criterion.quantities[0], label_of(of.criterion.quantities[0])))
    return ax


def _product_label(product: str) -> str:
    """Return a product of powers of variables with its exponents raised."""
    return " · ".join(
        re.sub(r"\^(-?[\d.]+)$", r"$^{\1}$", label_of(factor) if "." not in factor else factor)
        for factor in product.split()
    ).replace("_", " ")


def draw_reach(figure: "matplotlib.figure.Figure", of: "FeasibleSet") -> Any:
    """Draw how each compared quantity is spread over the box, and return the axes, (q,)."""
    values = of.emulated.mean_only(of.emulated.box.even_strings(BOX_POINTS))
    bands = of.criterion.bands()
    nearest = of.nearest
    axes = figure.subplots(1, len(bands), squeeze=False)[0]
    for ax, name, column, (lower, upper) in zip(
        axes, of.criterion.quantities, values.T, bands, strict=True
    ):
        finite = column[np.isfinite(column)]
        weights = np.full(len(finite), 100.0 / max(len(column), 1))
        shown = histogram_range(finite)
        ax.hist(finite, REACH_BARS, range=shown, weights=weights, color=COLOURS[0])
        ax.axvline(nearest.mean[name], color="black", label=f"nearest, {nearest.mean[name]:.4g}")
        left, right = ax.get_xlim()
        first = lower if np.isfinite(lower) else min(left, upper)
        last = upper if np.isfinite(upper) else max(right, lower)
        ax.axvspan(first, last, color=COLOURS[4], alpha=0.35, label="target")
        ax.set_xlabel(AXIS_NAMES.get(name, label_of(name)))
        legend_below(ax)
    axes[0].set_ylabel("share of the box (%)")
    return axes


def _combination(of: "FeasibleSet", row: dict[str, Any], strings: Floats) -> Floats:
    """Return the group that a direction is near, or else its product of powers, (n,)."""
    for group in of.emulated.coordinates.groups:
        if group.symbol == row["group"]:
            return of.emulated.coordinates.group_values(strings, group)
    powers = [row["exponents"][name] for name in of.emulated.box.names]
    columns = [each.values(strings) for each in of.emulated.box.own]
    values = np.maximum(np.column_stack(columns), 1e-300)
    return np.asarray(np.prod(values ** np.array(powers), axis=1))


def _pairs_caption(shown: PlottedSet) -> str:
    left = len(shown.variables) - MAX_PLOTTED_VARIABLES
    deviations = f" The set: {shown.of.criterion.text}." if shown.of.robust else ""
    more = f" The {left} freest variables are left out." if left > 0 else ""
    return (
        "The set in pairs of variables. The colour of a pair of values is the fraction of strings "
        "with it, over all values of the other variables, that is in the set. Lines enclose where "
        "it is more than half of its largest value (solid), and all pairs for which "
        f"some strings are possible (P ≥ {OUTER_PROBABILITY:g}, dashed). On the diagonal, "
        "each variable in the set against the prior, which is uniform as the campaign searches "
        f"(line at 1); free variables, which decide nothing, are grey.{more}{deviations}"
    )


def _group(data: CampaignData, options: FigureOptions) -> PlottedSet | None:
    """Return the set if it has directions: there are none where the mean is the same everywhere."""
    shown = plotted(data, options)
    return shown if shown is not None and len(shown.of.directions) else None


def _empty(_: CampaignData, options: FigureOptions) -> "FeasibleSet | None":
    of = _calibrated(options)
    return of if of is not None and of.empty else None


Figure(
    "set_reach",
    "set",
    0,
    _empty,
    draw_reach,
    "The set is empty. How the emulated mean is spread over the box, by points that "
    "fill it evenly; the band is what is asked for, the line what comes nearest to it.",
    lambda of: (min(PAGE, 3.5 * len(of.criterion.quantities)), 3.0),
    panels=True,
)
Figure(
    "set_pairs",
    "set",
    1,
    plotted,
    draw_pairs,
    _pairs_caption,
    lambda shown: corner_size(len(shown.variables)),
    panels=True,
)
Figure(
    "set_panel",
    "set",
    1,
    _panel,
    draw_panel,
    "",
    empty="the set is empty, or its emulator is not calibrated",
    method="plot_set",
    meaning="Draw the feasible set as one panel: over the variables `x` and `y`, or the marginal "
    "of `x` alone. `feasible_set` is what `feasible_set(tolerance)` returned; takes seconds "
    "otherwise, with its default tolerance.",
    takes=("x", "y", "ax", "feasible_set"),
)
Figure(
    "set_group",
    "set",
    3,
    _group,
    draw_group,
    "The emulated mean of points of the box against the combination of variables that decides "
    "most, with its 90 % interval; the band is the target.",
)
