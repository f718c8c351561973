"""Measured data beside what the best strings give: cumulative curves, and residuals of numbers."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.data_fit import has_data, string_predictions
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.report.drawing import COLOURS, scaled_unit, style_axes
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

MAX_DRAWN: Final = 3
"""Maximum number of strings that are drawn."""
TWO_SIDED: Final = 1.96
"""Standard errors in half a 95 % interval of a normal distribution."""
PANEL_WIDTH, PANEL_HEIGHT = 4.2, 3.4
"""Size of a panel, inches."""


class DrawnPrediction(NamedTuple):
    """Prediction of a string for a datum, (q,), and the covariance of its errors, (q, q)."""

    name: str
    values: Floats
    covariance: Floats


class ComparedDatum(NamedTuple):
    """A datum, and what the best strings predict for it."""

    datum: Datum
    predictions: list[DrawnPrediction]


def draw_data_fit(figure: Any, compared: Sequence[ComparedDatum]) -> NDArray[Any]:
    """Draw a panel for each size curve, and one for all numbers; return the axes, (panels,)."""
    curves = [each for each in compared if each.datum.quantity == "sizes"]
    numbers = [each for each in compared if each.datum.quantity != "sizes"]
    count = len(curves) + bool(numbers)
    axes = figure.subplots(1, count, squeeze=False)[0]
    for ax, each in zip(axes, curves, strict=False):
        _draw_curve(ax, each)
    if numbers:
        _draw_residuals(axes[-1], numbers)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=count + 1, frameon=False)
    return np.asarray(axes)


def _draw_curve(ax: Any, compared: ComparedDatum) -> None:
    """Draw the share below each edge between classes, as measured and as predicted."""
    datum = compared.datum
    assert datum.edges is not None
    factor, unit = scaled_unit("m", float(datum.edges[-2]))
    sizes = datum.edges[1:-1] / factor
    style_axes(ax)
    ax.set(title=datum.name, xlabel=f"diameter ({unit})", ylabel="share below (%)", xscale="log")
    for place, each in enumerate(compared.predictions):
        colour = COLOURS[place % len(COLOURS)]
        share, error = _cumulative(each.values, each.covariance)
        ax.plot(sizes, share, color=colour, label=each.name)
        ax.fill_between(sizes, share - error, share + error, color=colour, alpha=0.2, linewidth=0)
    share, error = _cumulative(datum.values, datum.covariance)
    ax.errorbar(sizes, share, yerr=error, fmt="o", color="0.15", capsize=3, label="measured")
    ticks = np.unique(np.round(np.geomspace(sizes[0], sizes[-1], 4), 2))
    ax.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
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
            aside = 0.15 * (place - (len(each.predictions) - 1) / 2.0)
            style = {"color": COLOURS[place % len(COLOURS)], "fmt": "o", "capsize": 3}
            label = found.name if row == 0 else None
            ax.errorbar(away, row + aside, xerr=bar, label=label, **style)
    ax.set_yticks(range(len(compared)), [each.datum.name for each in compared])
    ax.set_ylim(len(compared) - 0.5, -0.5)
    ax.set_xlabel("(predicted − measured)/error")


def _cumulative(shares: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return the share below each edge between classes and half its 95 % interval, in %."""
    below = np.tril(np.ones((len(shares) - 1, len(shares))))
    variances = np.diag(below @ covariance @ below.T)
    return 100.0 * below @ shares, 100.0 * TWO_SIDED * np.sqrt(np.maximum(variances, 0.0))


def _compared(data: CampaignData, options: FigureOptions) -> list[ComparedDatum] | None:
    """Return all data with the predictions of the best strings, or of one; None without data."""
    if not has_data(data):
        return None
    order = rank_strings(data).order
    ranks = {string: f"#{place} string {string}" for place, string in enumerate(order, 1)}
    wanted = order[:MAX_DRAWN] if options.string is None else [options.string]
    found = {string: string_predictions(data, string) for string in wanted}
    known = {string: each for string, each in found.items() if each is not None}
    if not known:
        return None
    first = next(iter(known.values()))
    compared, begin = [], 0
    for datum in first.data:
        here = slice(begin, begin + len(datum.values))
        begin = here.stop
        rows = [
            DrawnPrediction(ranks[string], each.values[here], each.covariance[here, here])
            for string, each in known.items()
        ]
        compared.append(ComparedDatum(datum, rows))
    return compared


def _size(compared: Sequence[ComparedDatum]) -> tuple[float, float]:
    curves = sum(each.datum.quantity == "sizes" for each in compared)
    return PANEL_WIDTH * (curves + (curves < len(compared))), PANEL_HEIGHT


DATA_FIT: Final = Figure(
    "data_fit",
    "answer",
    _compared,
    draw_data_fit,
    "Measured data and the best strings, with 95 % intervals of each: shares below a diameter, and "
    "differences of single numbers in errors of the measurement, whose own 95 % are shaded.",
    size=_size,
    empty="the campaign has no measured data, or no string is judged yet",
    panels=True,
)
