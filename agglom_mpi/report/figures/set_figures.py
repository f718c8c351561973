"""The feasible set: pairs of variables, marginals, what decides, and how reliable it is."""

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import label_of
from agglom_mpi.inference.emulated_set import BOX_POINTS
from agglom_mpi.inference.set_points import INNER_PROBABILITY, OUTER_PROBABILITY
from agglom_mpi.report.drawing import (
    COLOURS,
    histogram_range,
    legend_below,
    note,
    style_axes,
)
from agglom_mpi.report.figures.box_panels import (
    MAX_PLOTTED_VARIABLES,
    BoxPoints,
    contour_handle,
    corner_legend,
    corner_size,
    draw_contour,
    draw_corner,
    draw_marginal,
    pair_edges,
    scale_axis,
    smoothed,
)
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.set_summary import shown_directions
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.inference.feasible_set import FeasibleSet
    from agglom_mpi.inference.set_directions import SetVariable

Floats = NDArray[np.float64]

PLOTTED_POINTS: Final = 1 << 15
"""Number of points that panels are made of."""
MARGINAL_COLUMNS: Final = 3
"""Maximum number of marginals side by side."""
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
    images = []
    axes = draw_corner(
        figure,
        shown.points,
        lambda ax, name: _draw_marginal(ax, shown, name),
        lambda ax, column, row: images.append(_draw_pair(ax, shown.points, column, row)),
    )
    if images:
        # The upper right half is empty.
        place = figure.add_axes((0.62, 0.9, 0.3, 0.025))
        place.set_in_layout(False)
        bar = figure.colorbar(images[-1], cax=place, orientation="horizontal")
        bar.set_label("share of all other values in the set", fontsize=8)
        bar.ax.tick_params(labelsize=7)
        handles = [
            contour_handle("dashed", f"possible (P ≥ {OUTER_PROBABILITY:g})"),
            contour_handle("solid", f"sure (P ≥ {INNER_PROBABILITY:g})"),
        ]
        corner_legend(figure, handles)
    return axes


def _draw_pair(ax: Any, points: BoxPoints, column: str, row: str) -> Any:
    """Draw the share of the other variables' values that is in the set, for pairs of values."""
    x, y, probability = points.column(column), points.column(row), points.weights
    edges = pair_edges(points, column, row)
    count = np.histogram2d(x, y, bins=edges)[0]
    mass = np.histogram2d(x, y, bins=edges, weights=probability)[0]
    with np.errstate(invalid="ignore"):
        share = mass / count
    image = ax.pcolormesh(*edges, share.T, cmap="cividis", rasterized=True)
    styles: tuple[tuple[float, Literal["dashed", "solid"]], ...]
    styles = (OUTER_PROBABILITY, "dashed"), (INNER_PROBABILITY, "solid")
    for bound, style in styles:
        some = probability >= bound
        there = np.histogram2d(x[some], y[some], bins=edges)[0] > 0
        draw_contour(ax, edges, smoothed(there), 0.5, style)
    return image


def _marginals_size(count: int) -> tuple[float, float]:
    """Return width and height of the marginals of some variables, inches."""
    columns = min(count, MARGINAL_COLUMNS)
    return max(4.0, 3.0 * columns), 2.4 * -(-count // columns) + 0.4


def draw_marginals(figure: "matplotlib.figure.Figure", shown: PlottedSet) -> Any:
    """Draw a panel for each variable, and return their axes, shape (d,)."""
    count = len(shown.variables)
    columns = min(count, MARGINAL_COLUMNS)
    rows = -(-count // columns)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for unused in axes[count:]:
        unused.remove()
    for place, (ax, name) in enumerate(zip(axes[:count], shown.variables, strict=True)):
        _draw_marginal(ax, shown, name)
        scale_axis(ax.xaxis, shown.points, name, label=True)
        if place % columns == 0:
            ax.set_ylabel("density over prior")
    return axes[:count]


def _draw_marginal(ax: Any, shown: PlottedSet, name: str) -> None:
    free = shown.variables[name].free
    draw_marginal(ax, shown.points, name, "0.75" if free else COLOURS[0])
    ax.set_title("free" if free else "decided", fontsize=8, color="0.4", pad=2)


def draw_group(ax: Any, shown: PlottedSet) -> Any:
    """Draw the mean against the combination that decides most, and return the axes."""
    of = shown.of
    style_axes(ax)
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
    )
    image = ax.scatter(
        x,
        mean,
        s=5,
        c=shown.points.weights[: len(x)],
        cmap="cividis",
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
        style_axes(ax)
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


def draw_reliability(ax: Any, of: "FeasibleSet") -> Any:
    """Draw observed shares against predicted probabilities, and return the axes."""
    from scipy.stats import beta

    style_axes(ax)
    bins = of.calibration.reliability
    ax.plot([0, 1], [0, 1], color="0.5", linewidth=0.8)
    if not bins:
        note(ax, "too few strings")
        return ax
    predicted, observed, strings = (np.array(column) for column in zip(*bins, strict=True))
    happened = observed * strings
    lower = np.nan_to_num(beta.ppf(0.025, happened, strings - happened + 1), nan=0.0)
    upper = np.nan_to_num(beta.ppf(0.975, happened + 1, strings - happened), nan=1.0)
    ax.errorbar(
        predicted,
        observed,
        np.maximum([observed - lower, upper - observed], 0.0),
        fmt="o",
        color=COLOURS[0],
        markersize=4,
        capsize=2,
    )
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(0.0, 1.0)
    ax.set_aspect("equal")
    ax.set_xlabel("predicted probability")
    ax.set_ylabel("share of held-out strings")
    return ax


def _pairs_caption(shown: PlottedSet) -> str:
    left = len(shown.variables) - MAX_PLOTTED_VARIABLES
    more = f" The {left} freest variables are left out." if left > 0 else ""
    return (
        "The set in pairs of variables. The colour of a pair of values is the share of the other "
        "variables' values that is in the set; lines enclose pairs for which some values of the "
        f"others are possible (P ≥ {OUTER_PROBABILITY:g}, dashed) or sure "
        f"(P ≥ {INNER_PROBABILITY:g}, solid). On the diagonal, marginals as in the next "
        f"figure.{more}"
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
    lambda of: (max(6.4, 3.2 * len(of.criterion.quantities)), 4.2),
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
    "set_marginals",
    "set",
    2,
    plotted,
    draw_marginals,
    "Each variable in the set against the prior, which is uniform as the campaign searches (line "
    "at 1). Free variables, which decide nothing, are grey.",
    lambda shown: _marginals_size(len(shown.variables)),
    panels=True,
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
Figure(
    "set_reliability",
    "set",
    4,
    lambda _, options: _calibrated(options),
    draw_reliability,
    lambda of: (
        "Strings that the emulator predicts without their own samples: how often their mean was "
        f"above {of.calibration.threshold:.4g}, against how probable that was. Bars are 95 % "
        "intervals of the share; on the diagonal, the emulator is right."
    ),
    (4.6, 4.2),
)
