"""Objectives against the number of samples, where stopping rules end them, samples per string."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import Estimate, half_width, objective_at, objective_of
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.report.figures.figure import Figure, FigureOptions, objective_label
from agglom_mpi.report.style import (
    COLOURS,
    PAGE,
    draw_band,
    draw_estimate,
    integer_ticks,
    legend_below,
)
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import StoppingRule
from agglom_mpi.search.studied_rules import compared_rules
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_component

Floats = NDArray[np.float64]

STRINGS: Final = 3
"""Strings in the figure of ensembles."""
WIDE_INTERVALS: Final = 9
"""First samples whose intervals need not fit into the axes."""
LOGARITHMIC_COUNT: Final = 60
"""Number of samples above which their axis is logarithmic."""
BINS: Final = 30
MARKERS: Final = "osD^vP"


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


StoppingPoint = tuple[str, int | None]
"""A rule, and the completed samples after which it ends an ensemble; None if it needs more."""


EnsembleHistories = tuple[Sequence[RunningEstimate], Sequence[StoppingPoint], str, float]
"""Running estimates of the best strings, where rules end the samples of the first, the name of the
objective, and its lower bound, where intervals end."""


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


def stopping_points(data: CampaignData, string: int) -> list[StoppingPoint]:
    """Return where the campaign's own rule and `compared_rules` end the samples of a string."""
    samples = objective_of(data).summaries(data.counted(data.sample_rows(string)))
    own = recorded_component(data, "ensemble", StoppingRule.of_entries)
    particles = int(data.identity["scene.particles"])
    compared = [(name, rule) for name, rule in compared_rules().items() if not rule.tests_like(own)]
    if own.is_adaptive:
        compared.insert(0, (f"this campaign's: {own.label}", own))
    return [
        (name, samples_until(samples, rule, objective_at(data, string), particles))
        for name, rule in compared
    ]


def samples_until(
    samples: Sequence[SampleSummary],
    rule: StoppingRule,
    objective: Objective,
    particles: int,
) -> int | None:
    """Return the completed samples after which a rule is satisfied; None if it never is.

    Parameters
    ----------
    samples
        Of one string, in order of their numbers.
    rule
    objective
    particles
        Grains of the scene.
    """
    limit = max(len(samples) + 1, rule.min_samples)
    ensemble = Ensemble(rule.model_copy(update={"max_samples": limit}), objective, particles)
    for sample in samples:
        ensemble.add(sample)
        if ensemble.finished:
            return ensemble.completed
    return None


def draw_ensembles(ax: Any, histories: EnsembleHistories) -> Any:
    """Draw running objectives with 95 % intervals and the stopping points; return the axes."""
    estimates, points, quantity, least = histories
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
    _draw_stopping_points(ax, estimates[0], points)
    _limit_axes(ax, estimates, least)
    legend_below(ax)
    return ax


def _draw_stopping_points(
    ax: Any, estimate: RunningEstimate, points: Sequence[StoppingPoint]
) -> None:
    style = {"markeredgecolor": "black", "markersize": 7, "zorder": 4}
    for (rule, samples), marker, colour in zip(points, MARKERS, COLOURS[2:], strict=False):
        if samples is not None and samples <= len(estimate.objective):
            value, label = estimate.objective[samples - 1], f"{rule}: {samples}"
            ax.plot(samples, value, marker, color=colour, label=label, **style)


def _ensembles_caption(histories: EnsembleHistories) -> str:
    """Return the caption, which names the rules that the samples do not satisfy."""
    estimates, points, *_ = histories
    available = len(estimates[0].objective)
    absent = [rule for rule, samples in points if samples is None or samples > available]
    parts = ["Running objective of the best strings with its 95 % interval."]
    if len(absent) < len(points):
        parts.append("Marks: where each stopping rule would have ended the samples of the best.")
    if absent:
        parts.append(f"Not satisfied by its {pluralise(available, 'sample')}: {'; '.join(absent)}.")
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
    estimates, points = [running_estimate(data, i) for i in shown], stopping_points(data, shown[0])
    return estimates, points, objective_label(data), objective_of(data).least


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
    meaning="Draw running objectives of the best strings and where stopping rules end them.",
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
