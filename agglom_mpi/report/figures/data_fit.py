"""Measured data beside what the best strings give: cumulative and density curves, and residuals."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.data_fit import has_data, string_predictions
from agglom_mpi.analysis.ranking import judged_string, rank_strings
from agglom_mpi.analysis.shown_units import unit_of_datum
from agglom_mpi.formatting import in_unit, value_with_error
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.style import COLOURS, draw_band, few_ticks, figure_legend, tick_text
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

MAX_DRAWN: Final = 3
"""Maximum number of strings that are drawn."""
TWO_SIDED: Final = 1.96
"""Standard errors in half a 95 % interval of a normal distribution."""
WIDTH, CURVE_HEIGHT, NUMBER_HEIGHT = 6.5, 2.4, 0.42
"""Width of the figure, and height of a curve and of a number, inches."""
OPEN_CLASS_RATIO: Final = 2.0
"""Ratio of the ends of an open class as it is drawn where no class beside it is closed."""
INDICES: Final = {"number": "₀", "area": "₂", "mass": "₃"}
"""Index of a distribution by its weight, as ISO 9276-1 names them."""


class Prediction(NamedTuple):
    """What is predicted for a datum, or measured, with its error.

    Attributes
    ----------
    name
        Name in the legend.
    values
        Values, (q,), or draws of them, (draws, q).
    covariance
        Of the errors of the values, (q, q); None: they are draws.
    """

    name: str
    values: Floats
    covariance: Floats | None = None

    def interval(self, matrix: Floats) -> Floats:
        """Return middle and ends of 95 % intervals of `matrix`, (r, q), times the values, (3, r).

        Errors are normal; intervals of draws are their quantiles.
        """
        if self.covariance is None:
            low, middle, high = np.quantile(self.values @ matrix.T, [0.025, 0.5, 0.975], axis=0)
            return np.array([middle, low, high])
        middle = matrix @ self.values
        variances = np.diag(matrix @ self.covariance @ matrix.T)
        half = TWO_SIDED * np.sqrt(np.maximum(variances, 0.0))
        return np.array([middle, middle - half, middle + half])


def _bars(interval: Floats) -> Floats:
    """Return the lengths below and above the middle of intervals, (2, r)."""
    middle, low, high = interval
    return np.maximum([middle - low, high - middle], 0.0)


class ComparedDatum(NamedTuple):
    """A datum, what is predicted for it, and how it is shown.

    Attributes
    ----------
    datum
    predictions
        In order of the legend.
    shown_unit
        Factor and label of the unit of its number, or of the diameters of its classes.
    note
        Remark on the datum; empty if there is none.
    """

    datum: Datum
    predictions: Sequence[Prediction]
    shown_unit: tuple[float, str]
    note: str = ""

    @property
    def measured(self) -> Prediction:
        """The measured values with their errors."""
        return Prediction("measured", self.datum.values, self.datum.covariance)

    @property
    def title(self) -> str:
        """Name of the datum."""
        return self.datum.name.replace("_", " ")


def draw_data_fit(figure: Any, compared: Sequence[ComparedDatum]) -> NDArray[Any]:
    """Draw two panels of each size curve, one of each file of impacts, and one of all numbers.

    Returns the axes, (panels,).
    """
    curves = [each for each in compared if each.datum.kind.is_curve]
    impacts = [each for each in compared if each.datum.kind.is_exact]
    numbers = [each for each in compared if not each.datum.kind.has_file]
    last = [_residual_height(len(numbers))] if numbers else []
    heights = [CURVE_HEIGHT] * (len(curves) + len(impacts)) + last
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    axes = []
    for row, each in enumerate(curves):
        cumulative, density = figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])
        _draw_cumulative(cumulative, each)
        _draw_density(density, each)
        axes += [cumulative, density]
    for row, each in enumerate(impacts, len(curves)):
        axes.append(figure.add_subplot(grid[row, :]))
        _draw_impacts(axes[-1], each)
    if numbers:
        axes.append(figure.add_subplot(grid[-1, :]))
        _draw_residuals(axes[-1], numbers)
    figure_legend(figure, axes[:1], MAX_DRAWN + 1)
    return np.asarray(axes)


def _draw_cumulative(ax: Any, compared: ComparedDatum) -> None:
    """Draw the share below each edge between classes, as measured and as predicted."""
    datum, (factor, _) = compared.datum, compared.shown_unit
    assert datum.edges is not None
    sizes = datum.edges[1:-1] / factor
    _scale_sizes(ax, compared)
    ax.set_ylabel(f"share below, Q{INDICES[datum.weight]} (%)")
    below = 100.0 * np.tril(np.ones((len(sizes), len(datum.values))))
    for place, each in enumerate(compared.predictions):
        middle, *ends = each.interval(below)
        line = {"label": each.name, "zorder": 3.0 - 0.1 * place}
        draw_band(ax, sizes, middle, ends, COLOURS[place % len(COLOURS)], **line)
    share = compared.measured.interval(below)
    style = {"fmt": "o", "color": "0.15", "capsize": 3, "label": "measured"}
    ax.errorbar(sizes, share[0], yerr=_bars(share), **style)
    # The lower right of a cumulative curve is empty.
    where = {"transform": ax.transAxes, "ha": "right", "va": "bottom"}
    ax.text(0.97, 0.04, compared.note, **where)


def _draw_density(ax: Any, compared: ComparedDatum) -> None:
    """Draw the share of each class over its width in decades, as measured and as predicted."""
    datum, (factor, _) = compared.datum, compared.shown_unit
    assert datum.edges is not None
    edges = closed_edges(datum.edges) / factor
    per_decade = 100.0 * np.diag(1.0 / np.diff(np.log10(edges)))
    _scale_sizes(ax, compared)
    index = INDICES[datum.weight]
    ax.set_ylabel(f"density, dQ{index}/dlog₁₀d (%)")
    measured = compared.measured.interval(per_decade)
    density = measured[0]
    ax.stairs(density, edges, fill=True, color="0.88", label="measured")
    open_classes = [(0, datum.edges[0] == 0.0), (len(density) - 1, datum.edges[-1] == math.inf)]
    for here in (place for place, is_open in open_classes if is_open):
        # A colour behind a hatch would not follow the dark mode of the page.
        style = {"hatch": "////", "facecolor": "none", "edgecolor": "0.65", "linewidth": 0}
        ax.stairs(density[[here]], edges[[here, here + 1]], fill=True, **style)
    for place, each in enumerate(compared.predictions):
        colour = COLOURS[place % len(COLOURS)]
        middle, low, high = each.interval(per_decade)
        line = {"baseline": None, "linewidth": 1.5, "zorder": 3.0 - 0.1 * place}
        ax.stairs(middle, edges, color=colour, **line)
        ax.stairs(high, edges, baseline=low, fill=True, color=colour, alpha=0.2)
    middles = np.sqrt(edges[:-1] * edges[1:])
    ax.errorbar(middles, density, yerr=_bars(measured), fmt="o", color="0.15", capsize=3)
    ax.set_ylim(bottom=0.0)


def _draw_impacts(ax: Any, compared: ComparedDatum) -> None:
    """Draw the coefficient of each impact over its speed, as measured and as predicted."""
    datum, (factor, unit) = compared.datum, compared.shown_unit
    assert datum.impacts is not None
    speeds, each_one = datum.impacts[:, 0] / factor, np.eye(len(datum.values))
    title = ", ".join(filter(None, (compared.title, compared.note)))
    ax.set(title=title, xlabel=f"approach speed ({unit})", ylabel="coefficient of restitution")
    ax.set(xscale="log", ylim=(0.0, max(1.0, float(datum.values.max()) + 0.05)))
    for place, found in enumerate(compared.predictions):
        own = found.interval(each_one)
        style = {"fmt": "x", "color": COLOURS[place % len(COLOURS)], "zorder": 3.0 - 0.1 * place}
        ax.errorbar(speeds, own[0], yerr=_bars(own), label=found.name, **style)
    own = compared.measured.interval(each_one)
    style = {
        "fmt": "o",
        "color": "0.15",
        "capsize": 3,
        "label": "measured",
        "markerfacecolor": "none",
    }
    ax.errorbar(speeds, own[0], yerr=_bars(own), **style)


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
    datum, (factor, unit) = compared.datum, compared.shown_unit
    assert datum.edges is not None
    low, high = closed_edges(datum.edges)[[0, -1]] / factor
    ax.set(title=compared.title, xlabel=f"diameter ({unit})", xscale="log", xlim=(low, high))
    ticks = few_ticks(low, high, logarithmic=True)
    ax.set_xticks(ticks, [tick_text(tick) for tick in ticks])
    ax.minorticks_off()


def _draw_residuals(ax: Any, compared: Sequence[ComparedDatum]) -> None:
    """Draw prediction less measurement over the error of the measurement, a row for each number."""
    ax.axvspan(-TWO_SIDED, TWO_SIDED, color="0.9", zorder=0)
    for row, each in enumerate(compared):
        scale = math.sqrt(each.datum.covariance[0, 0])
        for place, found in enumerate(each.predictions):
            own = found.interval(np.array([[1.0 / scale]]))
            away = own[0] - each.datum.values / scale
            aside = 0.2 * (place - (len(each.predictions) - 1) / 2.0)
            style = {"color": COLOURS[place % len(COLOURS)], "fmt": "o", "capsize": 2}
            label = found.name if row == 0 else None
            ax.errorbar(away, row + aside, xerr=_bars(own), label=label, markersize=4, **style)
    ax.set_yticks(range(len(compared)), [_measured(each) for each in compared])
    ax.set_ylim(len(compared) - 0.5, -0.5)
    ax.set_xlabel("(predicted − measured)/error")


def _measured(compared: ComparedDatum) -> str:
    """Return a number with its error in its unit, and below it what it is."""
    datum, (factor, unit) = compared.datum, compared.shown_unit
    error = math.sqrt(datum.covariance[0, 0])
    shown = value_with_error(float(datum.values[0]) / factor, error / factor)
    note = f", {compared.note}" if compared.note else ""
    return f"{compared.title}\n{in_unit(shown, unit)}{note}"


def _residual_height(numbers: int) -> float:
    return 0.9 + NUMBER_HEIGHT * numbers


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
    compared, begin = [], 0
    for datum in next(iter(known.values()))[0]:
        here = slice(begin, begin + len(datum.values))
        begin = here.stop
        rows = [
            Prediction(names[string], values[here], covariance[here, here])
            for string, (_, values, covariance) in known.items()
        ]
        compared.append(ComparedDatum(datum, rows, unit_of_datum(data.campaign_text, datum)))
    return compared


def data_fit_size(compared: Sequence[ComparedDatum]) -> tuple[float, float]:
    """Return width and height of the figure of some data, inches."""
    curves = sum(each.datum.kind.has_file for each in compared)
    numbers = len(compared) - curves
    height = CURVE_HEIGHT * curves + (_residual_height(numbers) if numbers else 0.0)
    return WIDTH, height + 0.4


Figure(
    "data_fit",
    "answer",
    0,
    _compared,
    draw_data_fit,
    "Measured data and the best strings, with 95 % intervals of each: shares below a diameter and "
    "densities, coefficients of impacts, and differences of single numbers in errors of the "
    "measurement, whose own 95 % are shaded. Hatched classes are open; they are drawn as wide as "
    "those beside them.",
    size=data_fit_size,
    empty="the campaign has no measured data, or no string is judged yet",
    panels=True,
    method="plot_data_fit",
    meaning="Draw measured data beside the best strings, or one; each size curve has two panels.",
    takes=("string", "figure"),
)
