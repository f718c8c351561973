"""Measured data beside what the best strings give: cumulative and density curves, and residuals."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.data_fit import has_data, string_predictions
from agglom_mpi.analysis.ranking import judged_string, rank_strings
from agglom_mpi.formatting import in_unit, value_with_error
from agglom_mpi.measurements.datum import QUANTITIES, Datum
from agglom_mpi.report.drawing import COLOURS, few_ticks, style_axes
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.shown_units import shown_unit
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

MAX_DRAWN: Final = 3
"""Maximum number of strings that are drawn."""
TWO_SIDED: Final = 1.96
"""Standard errors in half a 95 % interval of a normal distribution."""
WIDTH, CURVE_HEIGHT, NUMBER_HEIGHT = 7.6, 3.1, 0.5
"""Width of the figure, and height of a curve and of a number, inches."""
OPEN_CLASS_RATIO: Final = 2.0
"""Ratio of the ends of an open class as it is drawn where no class beside it is closed."""
INDICES: Final = {"number": "₀", "area": "₂", "mass": "₃"}
"""Index of a distribution by its weight, as ISO 9276-1 names them."""


class DrawnPrediction(NamedTuple):
    """Prediction of a string for a datum, (q,), and the covariance of its errors, (q, q)."""

    name: str
    values: Floats
    covariance: Floats


class ComparedDatum(NamedTuple):
    """A datum, what the best strings predict for it, and factor and label of its shown unit."""

    datum: Datum
    predictions: list[DrawnPrediction]
    shown_unit: tuple[float, str]


def draw_data_fit(figure: Any, compared: Sequence[ComparedDatum]) -> NDArray[Any]:
    """Draw two panels for each size curve, and one for all numbers; return the axes, (panels,)."""
    curves = [each for each in compared if each.datum.quantity == "sizes"]
    numbers = [each for each in compared if each.datum.quantity != "sizes"]
    heights = [
        *([CURVE_HEIGHT] * len(curves)),
        *([_residual_height(len(numbers))] if numbers else []),
    ]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    axes = []
    for row, each in enumerate(curves):
        cumulative, density = figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])
        _draw_cumulative(cumulative, each)
        _draw_density(density, each)
        axes += [cumulative, density]
    if numbers:
        axes.append(figure.add_subplot(grid[-1, :]))
        _draw_residuals(axes[-1], numbers)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=MAX_DRAWN + 1, frameon=False)
    return np.asarray(axes)


def _draw_cumulative(ax: Any, compared: ComparedDatum) -> None:
    """Draw the share below each edge between classes, as measured and as predicted."""
    datum, (factor, _) = compared.datum, compared.shown_unit
    assert datum.edges is not None
    sizes = datum.edges[1:-1] / factor
    _scale_sizes(ax, compared)
    ax.set_ylabel(f"share below, Q{INDICES[datum.weight]} (%)")
    for place, each in enumerate(compared.predictions):
        colour = COLOURS[place % len(COLOURS)]
        share, error = _cumulative(each.values, each.covariance)
        ax.plot(sizes, share, color=colour, label=each.name, zorder=3.0 - 0.1 * place)
        ax.fill_between(sizes, share - error, share + error, color=colour, alpha=0.2, linewidth=0)
    share, error = _cumulative(datum.values, datum.covariance)
    ax.errorbar(sizes, share, yerr=error, fmt="o", color="0.15", capsize=3, label="measured")


def _draw_density(ax: Any, compared: ComparedDatum) -> None:
    """Draw the share of each class over its width in decades, as measured and as predicted."""
    datum, (factor, _) = compared.datum, compared.shown_unit
    assert datum.edges is not None
    edges = closed_edges(datum.edges) / factor
    decades = np.diff(np.log10(edges))
    _scale_sizes(ax, compared)
    index = INDICES[datum.weight]
    ax.set_ylabel(f"density, dQ{index}/dlog₁₀d (%)")
    density, error = _densities(datum.values, datum.covariance, decades)
    ax.stairs(density, edges, fill=True, color="0.88", label="measured")
    open_classes = [(0, datum.edges[0] == 0.0), (len(density) - 1, datum.edges[-1] == math.inf)]
    for here in (place for place, is_open in open_classes if is_open):
        style = {"hatch": "////", "facecolor": "0.95", "edgecolor": "0.75", "linewidth": 0}
        ax.stairs(density[[here]], edges[[here, here + 1]], fill=True, **style)
    for place, each in enumerate(compared.predictions):
        colour = COLOURS[place % len(COLOURS)]
        own, half = _densities(each.values, each.covariance, decades)
        ax.stairs(own, edges, baseline=None, color=colour, linewidth=1.5, zorder=3.0 - 0.1 * place)
        ax.stairs(own + half, edges, baseline=own - half, fill=True, color=colour, alpha=0.2)
    middles = np.sqrt(edges[:-1] * edges[1:])
    ax.errorbar(middles, density, yerr=error, fmt="o", color="0.15", capsize=3)
    ax.set_ylim(bottom=0.0)


def closed_edges(edges: Floats) -> Floats:
    """Return edges of classes, (q + 1,), with ends of open classes as far as those beside them."""
    inner = edges[(edges > 0.0) & np.isfinite(edges)]
    first, last = (
        (inner[1] / inner[0], inner[-1] / inner[-2])
        if len(inner) > 1
        else (OPEN_CLASS_RATIO, OPEN_CLASS_RATIO)
    )
    begin = [inner[0] / first] if edges[0] == 0.0 else []
    end = [inner[-1] * last] if edges[-1] == math.inf else []
    return np.array([*begin, *inner, *end])


def _scale_sizes(ax: Any, compared: ComparedDatum) -> None:
    """Give a panel of a curve its title and its axis of diameters."""
    datum, (factor, unit) = compared.datum, compared.shown_unit
    assert datum.edges is not None
    low, high = closed_edges(datum.edges)[[0, -1]] / factor
    style_axes(ax)
    ax.set(title=datum.name, xlabel=f"diameter ({unit})", xscale="log", xlim=(low, high))
    ticks = few_ticks(low, high, logarithmic=True)
    ax.set_xticks(ticks, [f"{tick:.4g}" for tick in ticks])
    ax.minorticks_off()


def _draw_residuals(ax: Any, compared: Sequence[ComparedDatum]) -> None:
    """Draw prediction less measurement over the error of the measurement, a row for each number."""
    style_axes(ax)
    ax.axvspan(-TWO_SIDED, TWO_SIDED, color="0.9", zorder=0)
    for row, each in enumerate(compared):
        scale = math.sqrt(each.datum.covariance[0, 0])
        for place, found in enumerate(each.predictions):
            away = (found.values[0] - each.datum.values[0]) / scale
            bar = TWO_SIDED * math.sqrt(found.covariance[0, 0]) / scale
            aside = 0.2 * (place - (len(each.predictions) - 1) / 2.0)
            style = {"color": COLOURS[place % len(COLOURS)], "fmt": "o", "capsize": 2}
            label = found.name if row == 0 else None
            ax.errorbar(away, row + aside, xerr=bar, label=label, markersize=4, **style)
    ax.set_yticks(range(len(compared)), [_measured(each) for each in compared])
    ax.set_ylim(len(compared) - 0.5, -0.5)
    ax.set_xlabel("(predicted − measured)/error")


def _measured(compared: ComparedDatum) -> str:
    """Return a number with its error in its unit, and below it what it is."""
    datum, (factor, unit) = compared.datum, compared.shown_unit
    error = math.sqrt(datum.covariance[0, 0])
    shown = value_with_error(float(datum.values[0]) / factor, error / factor)
    return f"{datum.name.replace('_', ' ')}\n{in_unit(shown, unit)}"


def _residual_height(numbers: int) -> float:
    return 0.9 + NUMBER_HEIGHT * numbers


def _cumulative(shares: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return the share below each edge between classes and half its 95 % interval, in %."""
    below = np.tril(np.ones((len(shares) - 1, len(shares))))
    variances = np.diag(below @ covariance @ below.T)
    return 100.0 * below @ shares, 100.0 * TWO_SIDED * np.sqrt(np.maximum(variances, 0.0))


def _densities(shares: Floats, covariance: Floats, decades: Floats) -> tuple[Floats, Floats]:
    """Return the share of each class and half its 95 % interval, in % per decade."""
    errors = TWO_SIDED * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return 100.0 * shares / decades, 100.0 * errors / decades


def compared_strings(data: CampaignData, string: int | None) -> dict[int, str]:
    """Return the names of a judged string, or of the best, by number.

    Raises
    ------
    ValueError
        If the string is not judged.
    """
    order = rank_strings(data).order
    ranks = {each: f"#{place} string {each}" for place, each in enumerate(order, 1)}
    wanted = order[:MAX_DRAWN] if string is None else [judged_string(data, string)]
    return {each: ranks[each] for each in wanted if each in ranks}


def _compared(data: CampaignData, options: FigureOptions) -> list[ComparedDatum] | None:
    """Return all data with the predictions of the best strings, or of one; None without data."""
    if not has_data(data):
        return None
    names = compared_strings(data, options.string)
    found = {string: string_predictions(data, string) for string in names}
    known = {string: each for string, each in found.items() if each is not None}
    if not known:
        return None
    first = next(iter(known.values()))
    compared, begin = [], 0
    for datum in first.data:
        here = slice(begin, begin + len(datum.values))
        begin = here.stop
        rows = [
            DrawnPrediction(names[string], each.values[here], each.covariance[here, here])
            for string, each in known.items()
        ]
        compared.append(ComparedDatum(datum, rows, unit_of_datum(data, datum)))
    return compared


def unit_of_datum(data: CampaignData, datum: Datum) -> tuple[float, str]:
    """Return factor and label of the unit in which a datum, or the sizes of a curve, are shown."""
    if datum.edges is not None:
        return shown_unit(data, datum.quantity, "m", float(datum.edges[-2]))
    unit = QUANTITIES[datum.quantity].unit
    return shown_unit(data, datum.quantity, unit, float(datum.values[0]))


def _size(compared: Sequence[ComparedDatum]) -> tuple[float, float]:
    curves = sum(each.datum.quantity == "sizes" for each in compared)
    numbers = len(compared) - curves
    height = CURVE_HEIGHT * curves + (_residual_height(numbers) if numbers else 0.0)
    return WIDTH, height + 0.4


DATA_FIT: Final = Figure(
    "data_fit",
    "answer",
    _compared,
    draw_data_fit,
    "Measured data and the best strings, with 95 % intervals of each: shares below a diameter and "
    "densities, and differences of single numbers in errors of the measurement, whose own 95 % are "
    "shaded. Hatched classes are open; they are drawn as wide as those beside them.",
    size=_size,
    empty="the campaign has no measured data, or no string is judged yet",
    panels=True,
)
