"""Objective against generation ([A] fig. 4, [B] fig. 4), and its error against run time."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import Estimate, half_width, objective_of
from agglom_mpi.analysis.ranking import rank_strings, ranks_itself
from agglom_mpi.report.figures.data_fit import TWO_SIDED
from agglom_mpi.report.figures.figure import Figure, FigureOptions, objective_label
from agglom_mpi.report.style import (
    COLOURS,
    draw_band,
    draw_estimate,
    integer_ticks,
    legend_below,
    log_scale_from_zero,
)
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

LOGARITHMIC_RATIO: Final = 15.0
"""Ratio of the largest to the smallest value above which the axis is logarithmic."""
BELOW_LOWEST: Final = 0.3
"""Lower end of a logarithmic axis over the lowest objective."""
MAX_MARKED: Final = 30
"""Minimum number of generations for a convergence without marks at single ones."""
MAX_MARKED_ERRORS: Final = 40
"""Minimum number of generations for a cost without marks at single ones."""


class ConvergenceHistory(NamedTuple):
    """The search after each of G generations: arrays of shape (G,), half-widths of 95 % intervals.

    Attributes
    ----------
    generation
        Counted from 1.
    seconds
        Wall-clock time so far, s.
    best, best_half_width
        Objective of the best string by the samples that the search used.
    top_mean, top_half_width
        Mean objective of the best `top_count` strings.
    top_count
        Number of strings in `top_mean`.
    objective_label
        Name of the objective.
    fresh
        The best string on fresh samples, if it was estimated again.
    least
        Lower bound of the objective, where intervals end.
    source
        Whose objective that of the best string is: as searched, or as the search estimates.
    """

    generation: NDArray[np.int64]
    seconds: Floats
    best: Floats
    best_half_width: Floats
    top_mean: Floats
    top_half_width: Floats
    top_count: int
    objective_label: str = "objective"
    fresh: Estimate | None = None
    least: float = 0.0
    source: str = "as searched"


def convergence_history(data: CampaignData) -> ConvergenceHistory:
    """Return the search after each generation in the file."""
    rows, ranked = data.generation_rows(), rank_strings(data)
    result_of = ranked.results
    best = [result_of.get(int(string)) for string in rows["best_string"]]
    counts = np.array([0 if r is None else r["samples_used"] - r["failed"] for r in best], int)
    errors = [_top_error(row, result_of) for row in rows]
    return ConvergenceHistory(
        generation=rows["generation"] + 1,
        seconds=rows["seconds"],
        best=_nan_if_infinite(rows["best_objective"]),
        best_half_width=half_width(rows["best_standard_error"], counts),
        top_mean=_nan_if_infinite(rows["mean_of_top"]),
        top_half_width=TWO_SIDED * np.array(errors, float),
        top_count=int(rows["top"][-1]) if len(rows) else 0,
        objective_label=objective_label(data),
        fresh=ranked.again.get(ranked.order[0]) if ranked.order else None,
        least=objective_of(data).least,
        source="as the search estimates" if ranks_itself(data) else "as searched",
    )


def _top_error(row: np.void, result_of: dict[int, np.void]) -> float:
    """Return the standard error of the mean of the top strings, whose samples are independent."""
    top = [result_of.get(int(string)) for string in row["population"][: row["top"]]]
    errors = [np.nan if result is None else result["standard_error"] for result in top]
    return float(np.linalg.norm(errors) / max(1, len(errors)))


def _nan_if_infinite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)


def _curves(history: ConvergenceHistory) -> list[tuple[str, Floats, Floats]]:
    """Return name, objective and half-width of the best string, and of the best few if several."""
    curves = [("best string", history.best, history.best_half_width)]
    if history.top_count > 1:  # of one it is the same
        name = f"mean of the best {history.top_count}"
        curves.append((name, history.top_mean, history.top_half_width))
    return curves


def draw_convergence(ax: Any, history: ConvergenceHistory) -> Any:
    """Draw the objectives of the best and of the top strings with 95 % bands; return the axes."""
    ax.set_xlabel("generation")
    ax.set_ylabel(history.objective_label)
    generation = history.generation
    line = {"marker": "o" if len(generation) < MAX_MARKED else "", "markersize": 3.5}
    for place, (name, value, half) in enumerate(_curves(history)):
        low, colour = np.maximum(history.least, value - half), COLOURS[place]
        name = name if place else f"{name}, {history.source}"
        draw_band(ax, generation, value, (low, value + half), colour, label=name, **line)
        if len(value) == 1:
            ax.errorbar(generation, value, [value - low, half], color=colour, capsize=3)
    if history.fresh is not None:
        place = generation[-1] + max(0.4, 0.015 * len(generation))
        draw_estimate(ax, place, history.fresh, COLOURS[6], "best, re-estimate")
    _scale_objective_axis(ax, history)
    ax.set_xlim(left=1.0 - 0.03 * max(10, len(generation)))
    integer_ticks(ax.xaxis)
    legend_below(ax, 3)
    return ax


def _scale_objective_axis(ax: Any, history: ConvergenceHistory) -> None:
    """Use a logarithmic axis where values differ much, down to 0 where a band ends there."""
    bands = (history.best, history.best_half_width), (history.top_mean, history.top_half_width)
    values = [v for value, _ in bands for v in value if np.isfinite(v)]
    ends = [v for value, half in bands for v in value - half if np.isfinite(v)]
    if history.fresh is not None:
        values.append(history.fresh.objective)
        ends.append(history.fresh.lower)
    low, high, end = min(values), max(values), max(history.least, min(ends, default=np.inf))
    bottom = BELOW_LOWEST * low
    if low > 0.0 and high > LOGARITHMIC_RATIO * low and (end >= bottom or history.least == 0.0):
        if end >= bottom:
            ax.set_yscale("log")
            ax.set_ylim(bottom=bottom)
        else:
            log_scale_from_zero(ax, low)
    elif history.least == 0.0:
        ax.set_ylim(bottom=max(0.0, ax.get_ylim()[0]))


def draw_cost(ax: Any, history: ConvergenceHistory) -> Any:
    """Draw half-widths of the best and of the top strings against time, and return the axes."""
    ax.set_xlabel("wall-clock time, all legs (s)")
    ax.set_ylabel("95 % half-width of the objective")
    marked = len(history.seconds) < MAX_MARKED_ERRORS
    for place, (name, _, half) in enumerate(_curves(history)):
        known = half > 0.0
        line = {"marker": "os"[place] if marked else "", "markersize": 3.5, "linewidth": 1.0}
        at, style = history.seconds[known], {"color": COLOURS[place], "label": name}
        ax.plot(at, half[known], **line, **style)
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    legend_below(ax)
    return ax


def _convergence_data(data: CampaignData, _: FigureOptions) -> ConvergenceHistory | None:
    history = convergence_history(data)
    return history if np.isfinite(history.best).any() else None


def _cost_data(data: CampaignData, _: FigureOptions) -> ConvergenceHistory | None:
    history = convergence_history(data)
    return history if (np.nan_to_num(history.best_half_width) > 0.0).any() else None


Figure(
    "convergence",
    "search",
    0,
    _convergence_data,
    draw_convergence,
    "Objective of the best string and mean of the best strings after each generation, by the "
    "samples that they were chosen by, with 95 % bands ([A] fig. 4, [B] fig. 4): lucky strings "
    "survive. The re-estimate is on fresh samples that no decision has seen.",
    empty="no generation with a result yet",
    method="plot_convergence",
    meaning="Draw best and mean-of-top objective against generation, with 95 % bands.",
)

Figure(
    "cost",
    "search",
    3,
    _cost_data,
    draw_cost,
    "Error against run time: half of the 95 % interval (standard error × Student's t) of the "
    "best objective after each generation, and of the mean of the best.",
    empty="no generation with an error yet",
    method="plot_cost",
    meaning="Draw the error of the best objective against run time.",
)
