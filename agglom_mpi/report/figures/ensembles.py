"""Objectives against the number of samples, and samples per string."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import Estimate, half_width, objective_at, objective_of
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.report.figures.figure import Figure, FigureOptions, objective_label
from agglom_mpi.report.style import (
    COLOURS,
    PAGE,
    draw_band,
    draw_estimate,
    integer_ticks,
    legend_below,
)
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

STRINGS: Final = 3
"""Strings in the figure of ensembles."""
WIDE_INTERVALS: Final = 9
"""First samples whose intervals need not fit into the axes."""
LOGARITHMIC_COUNT: Final = 60
"""Number of samples above which their axis is logarithmic."""
BINS: Final = 30


class RunningEstimate(NamedTuple):
    """Objective of a string by its first 1 … n completed samples.

    Attributes
    ----------
    string
    objective, half_width
        By the samples so far, and half of its 95 % interval, nan for one sample; shape (n,).
    used
        Completed samples that the search decided by; the rest is fresh.
    again
        Re-estimate by the fresh samples alone, if there are any.
    """

    string: int
    objective: Floats
    half_width: Floats
    used: int
    again: Estimate | None = None


EnsembleHistories = tuple[Sequence[RunningEstimate], str, float]
"""Running estimates of the best strings, the name of the objective, and its lower bound, where
intervals end."""


def running_estimate(data: CampaignData, string: int) -> RunningEstimate:
    """Return the objective of a string after each of its completed samples."""
    rows = data.counted(data.sample_rows(string))
    used = int(rank_strings(data).results[string]["samples_used"])
    completed = rows[rows["state"] == COMPLETED]
    objective = objective_at(data, string)
    accumulator, values, errors = objective.accumulator(), [], []
    for summary in objective.summaries(completed):
        accumulator.add(summary)
        values.append(accumulator.value)
        errors.append(accumulator.standard_error)
    half = half_width(np.array(errors), np.arange(1, len(values) + 1))
    decided = int((completed["sample"] < used).sum())
    again = rank_strings(data).again.get(string)
    return RunningEstimate(string, np.array(values), half, decided, again)


def draw_ensembles(ax: Any, histories: EnsembleHistories) -> Any:
    """Draw running objectives with their 95 % intervals, and return the axes."""
    estimates, quantity, least = histories
    ax.set_xlabel("completed samples of the string")
    ax.set_ylabel(f"running {quantity}")
    for place, (estimate, colour) in enumerate(zip(estimates, COLOURS, strict=False)):
        objective = estimate.objective
        count = np.arange(1, len(objective) + 1)
        name, width = f"#{place + 1}, string {estimate.string}", 1.4 - 0.3 * (place > 0)
        ends = _interval(estimate, least)
        draw_band(ax, count, objective, ends, colour, linewidth=width, label=name)
        if 0 < estimate.used < len(objective):
            ax.axvline(estimate.used, color=colour, linewidth=0.8, linestyle=":")
        if estimate.again is not None:  # behind the end of the curve, beside those of others
            label = None if place else "re-estimates, by fresh samples alone"
            at = len(objective) * (1.04 + 0.04 * place)
            draw_estimate(ax, at, estimate.again, colour, label)
    _limit_axes(ax, estimates, least)
    legend_below(ax)
    return ax


def _ensembles_caption(histories: EnsembleHistories) -> str:
    estimates = histories[0]
    parts = ["Running objective of the best strings with its 95 % interval."]
    if any(0 < each.used < len(each.objective) for each in estimates):
        parts.append(
            "Left of a dotted line are the samples that the string was chosen by; right of it the "
            "mean goes on over fresh ones."
        )
    if any(each.again is not None for each in estimates):
        parts.append("Diamonds: re-estimates by the fresh samples alone.")
    return " ".join(parts)


def _interval(estimate: RunningEstimate, least: float) -> tuple[Floats, Floats]:
    lower = np.maximum(least, estimate.objective - estimate.half_width)
    return lower, estimate.objective + estimate.half_width


def _limit_axes(ax: Any, estimates: Sequence[RunningEstimate], least: float) -> None:
    """Show all objectives, and intervals from the tenth sample on: those of fewer are wide."""
    longest = max(len(estimate.objective) for estimate in estimates)
    ends = [
        end[np.isfinite(end)]
        for estimate in estimates
        for end in (
            estimate.objective,
            *(end[WIDE_INTERVALS:] for end in _interval(estimate, least)),
        )
    ]
    values = np.concatenate(ends)
    margin = 0.05 * (float(np.ptp(values)) or 1.0)
    ax.set_ylim(float(values.min()) - margin, float(values.max()) + margin)
    if longest > LOGARITHMIC_COUNT:
        ax.set_xscale("log")
        ax.set_xlim(1, longest * (1.08 + 0.04 * len(estimates)))


SampleCounts = tuple[NDArray[np.int64], NDArray[np.bool_], int]
"""Samples that each of n strings was judged by, (n,), whether `max_samples` ended its ensemble and
not the rule, (n,), and the number of samples that ran ahead of decisions and were not needed."""


def draw_sample_counts(ax: Any, counts: SampleCounts) -> Any:
    """Draw a histogram of the samples per string, and return the axes."""
    used, at_maximum, _ = counts
    ax.set_xlabel("samples of a string")
    ax.set_ylabel("strings")
    low, high = int(used.min()), int(used.max())
    width = max(1, -(-(high - low + 1) // BINS))
    edges = np.arange(low, high + width + 1, width) - 0.5
    kinds = (
        ("ended by the stopping rule", ~at_maximum, COLOURS[5]),
        ("at max_samples", at_maximum, COLOURS[1]),
    )
    shown = [kind for kind in kinds if kind[1].any()]
    values, colours = [used[some] for _, some, _ in shown], [colour for *_, colour in shown]
    names = [f"{name}: {some.sum()}" for name, some, _ in shown]
    style = {"stacked": True, "edgecolor": "white", "linewidth": 0.4}
    ax.hist(values, edges, color=colours, label=names, **style)
    mean = float(used.mean())
    ax.axvline(mean, color=COLOURS[6], linestyle="--", linewidth=1.2, label=f"mean {mean:.4g}")
    integer_ticks(ax.xaxis)
    integer_ticks(ax.yaxis)
    legend_below(ax, 3)
    return ax


def _ensembles_data(data: CampaignData, _: FigureOptions) -> EnsembleHistories | None:
    samples = data.counted_samples
    completed = {*samples["string"][samples["state"] == COMPLETED].tolist()}
    shown = [i for i in rank_strings(data).order if i in completed][:STRINGS]
    if not shown:
        return None
    estimates = [running_estimate(data, i) for i in shown]
    return estimates, objective_label(data), objective_of(data).least


def _counts_data(data: CampaignData, _: FigureOptions) -> SampleCounts | None:
    used = data.result_rows()["samples_used"]
    if not len(used) or used.min() == used.max():  # one bar says nothing
        return None
    searched = int((data.all_sample_rows()["sample"] < data.fresh_from).sum())
    return used, data.result_rows()["hit_maximum"] == 1, max(0, searched - int(used.sum()))


def _counts_caption(counts: SampleCounts) -> str:
    return (
        f"Samples that the strings were judged by; {counts[2]} more were simulated ahead of a "
        "decision and not needed. The papers took 125 [A] and 11.84 [B] on average."
    )


Figure(
    "ensembles",
    "samples",
    0,
    _ensembles_data,
    draw_ensembles,
    _ensembles_caption,
    (PAGE, 4.6),
    empty="no string has samples yet, or its objective needs code that is not run",
    method="plot_ensembles",
    meaning="Draw running objectives of the best strings with their 95 % intervals.",
)

Figure(
    "samples_per_string",
    "samples",
    1,
    _counts_data,
    draw_sample_counts,
    _counts_caption,
    empty="no string is judged yet, or all by the same number of samples",
    method="plot_samples",
    meaning="Draw how many samples strings took.",
)
