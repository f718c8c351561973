"""Objective against generation ([A] fig. 4, [B] fig. 4), and its error against run time."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import half_width
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.report.drawing import COLOURS, integer_ticks, legend_below, style_axes
from agglom_mpi.report.figures.figure import Figure, FigureOptions, objective_label
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

NORMAL_QUANTILE: Final = 1.96
"""Half of a 95 % interval in standard errors, where many samples are behind it."""
LOGARITHMIC_RATIO: Final = 15.0
"""Ratio of the largest to the smallest value from which the axis is logarithmic."""
MAX_MARKED: Final = 30
"""Generations from which single ones are not marked in the convergence."""
MAX_MARKED_ERRORS: Final = 40
"""Generations from which single ones are not marked in the cost."""


class FreshEstimate(NamedTuple):
    """Objective of the best string on fresh samples, and the ends of its 95 % interval."""

    objective: float
    lower: float
    upper: float


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
        Name of the objective, with its unit.
    fresh
        The best string on fresh samples, if it was estimated again.
    """

    generation: NDArray[np.int64]
    seconds: Floats
    best: Floats
    best_half_width: Floats
    top_mean: Floats
    top_half_width: Floats
    top_count: int
    objective_label: str = "objective (1)"
    fresh: FreshEstimate | None = None


def convergence_history(data: CampaignData) -> ConvergenceHistory:
    """Return the search after each generation in the file."""
    rows, result_of = data.generation_rows(), rank_strings(data).results
    best = [result_of.get(int(string)) for string in rows["best_string"]]
    counts = np.array([0 if r is None else r["samples_used"] - r["failed"] for r in best], int)
    errors = [_top_error(row, result_of) for row in rows]
    return ConvergenceHistory(
        generation=rows["generation"] + 1,
        seconds=rows["seconds"],
        best=_nan_if_infinite(rows["best_objective"]),
        best_half_width=half_width(rows["best_standard_error"], counts),
        top_mean=_nan_if_infinite(rows["mean_of_top"]),
        top_half_width=NORMAL_QUANTILE * np.array(errors, float),
        top_count=int(rows["top"][-1]) if len(rows) else 0,
        objective_label=objective_label(data),
        fresh=fresh_estimate_of_best(data),
    )


def fresh_estimate_of_best(data: CampaignData) -> FreshEstimate | None:
    """Return the estimate of the best string on fresh samples; None if it has none."""
    for estimate in rank_strings(data).estimates:
        if estimate.known and estimate.string == rank_strings(data).order[0]:
            return FreshEstimate(estimate.objective, estimate.lower, estimate.upper)
    return None


def _top_error(row: np.void, result_of: dict[int, np.void]) -> float:
    """Return the standard error of the mean of the top strings, whose samples are independent."""
    top = [result_of.get(int(string)) for string in row["population"][: row["top"]]]
    errors = [np.nan if result is None else result["standard_error"] for result in top]
    return float(np.linalg.norm(errors) / max(1, len(errors)))


def _nan_if_infinite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)


def draw_convergence(ax: Any, history: ConvergenceHistory) -> Any:
    """Draw the objectives of the best and of the top strings with 95 % bands; return the axes."""
    style_axes(ax)
    ax.set_xlabel("generation")
    ax.set_ylabel(history.objective_label)
    generation = history.generation
    curves = [("best string", history.best, history.best_half_width)]
    if history.top_count > 1:  # of one it is the same
        name = f"mean of the best {history.top_count}"
        curves.append((name, history.top_mean, history.top_half_width))
    marker = "o" if len(generation) < MAX_MARKED else ""
    for (name, value, half), colour in zip(curves, COLOURS, strict=False):
        ax.plot(generation, value, color=colour, marker=marker, markersize=3.5, label=name)
        ax.fill_between(
            generation, value - half, value + half, color=colour, alpha=0.18, linewidth=0
        )
        if len(value) == 1:
            ax.errorbar(generation, value, half, color=colour, capsize=3)
    if history.fresh is not None:
        _draw_fresh(ax, generation[-1] + max(0.4, 0.015 * len(generation)), history.fresh)
    _scale_objective_axis(ax, history)
    ax.set_xlim(left=1.0 - 0.03 * max(10, len(generation)))
    integer_ticks(ax.xaxis)
    legend_below(ax, 3)
    return ax


def _draw_fresh(ax: Any, x: float, fresh: FreshEstimate) -> None:
    value = fresh.objective
    ax.errorbar(
        x,
        value,
        [[value - fresh.lower], [fresh.upper - value]],
        color=COLOURS[6],
        marker="D",
        markersize=4,
        capsize=3,
        linestyle="none",
        label="best, on fresh samples",
    )


def _scale_objective_axis(ax: Any, history: ConvergenceHistory) -> None:
    """Use a logarithmic axis where values differ much; bands that reach 0 end at its edge."""
    values = [v for v in (*history.best, *history.top_mean) if np.isfinite(v)]
    if history.fresh is not None:
        values.append(history.fresh.objective)
    low, high = min(values), max(values)
    if low > 0.0 and high > LOGARITHMIC_RATIO * low:
        ax.set_yscale("log", nonpositive="clip")
        ax.set_ylim(bottom=0.3 * low)
    elif low >= 0.0:
        ax.set_ylim(bottom=max(0.0, ax.get_ylim()[0]))


def draw_cost(ax: Any, history: ConvergenceHistory) -> Any:
    """Draw half-widths of the best and of the top strings against time, and return the axes."""
    style_axes(ax)
    ax.set_xlabel("wall-clock time, all legs (s)")
    ax.set_ylabel("95 % half-width of the objective (1)")
    curves = (
        ("best string", history.best_half_width, "o"),
        (f"mean of the best {history.top_count}", history.top_half_width, "s"),
    )
    for (name, half, marker), colour in zip(curves, COLOURS, strict=False):
        known = half > 0.0
        ax.plot(
            history.seconds[known],
            half[known],
            color=colour,
            marker=marker if len(half) < MAX_MARKED_ERRORS else "",
            markersize=3.5,
            linewidth=1.0,
            label=name,
        )
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


CONVERGENCE: Final = Figure(
    "convergence",
    "search",
    _convergence_data,
    draw_convergence,
    "Objective of the best string and mean of the best strings after each generation, as the "
    "search had them, with 95 % bands ([A] fig. 4, [B] fig. 4). Lucky strings survive, so "
    "these are biased low; fresh samples are not.",
    empty="no generation with a result yet",
)

COST: Final = Figure(
    "cost",
    "search",
    _cost_data,
    draw_cost,
    "Error against run time: half of the 95 % interval (standard error × Student's t) of the "
    "best objective after each generation, and of the mean of the best.",
    empty="no generation with an error yet",
)
