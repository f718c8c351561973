"""Objectives against the number of samples, where stopping rules end them, samples per string."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import Estimate, half_width, objective_at, objective_of
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.report.drawing import COLOURS, integer_ticks, legend_below, style_axes
from agglom_mpi.report.figures.figure import Figure, FigureOptions, objective_label
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


class StoppingPoint(NamedTuple):
    """Completed samples after which a rule ends an ensemble; None if it needs more of them."""

    rule: str
    samples: int | None


class EnsembleHistories(NamedTuple):
    """Running estimates of the best strings, and where rules end the samples of the first.

    Attributes
    ----------
    estimates
    stopping_points
    objective_label
        Name of the objective.
    least
        Lower bound of the objective, where intervals end.
    """

    estimates: Sequence[RunningEstimate]
    stopping_points: Sequence[StoppingPoint]
    objective_label: str = "objective"
    least: float = 0.0


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
    known = (each for each in rank_strings(data).estimates if each.known)
    again = next((each for each in known if each.string == string), None)
    return RunningEstimate(string, np.array(values), half, decided, again)


def stopping_points(data: CampaignData, string: int) -> list[StoppingPoint]:
    """Return where the campaign's own rule and `compared_rules` end the samples of a string."""
    samples = objective_of(data).summaries(data.counted(data.sample_rows(string)))
    own = own_rule(data)
    particles = int(data.identity["scene.particles"])
    compared = [(name, rule) for name, rule in compared_rules().items() if not rule.tests_like(own)]
    if own.is_adaptive:
        compared.insert(0, (f"this campaign's: {own.label}", own))
    return [
        StoppingPoint(name, samples_until(samples, rule, objective_at(data, string), particles))
        for name, rule in compared
    ]


def own_rule(data: CampaignData) -> StoppingRule:
    """Return the stopping rule of a campaign's ensembles."""
    return recorded_component(data, "ensemble", StoppingRule.of_entries)


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
    estimates = histories.estimates
    style_axes(ax)
    ax.set_xlabel("completed samples of the string")
    ax.set_ylabel(f"running {histories.objective_label}")
    for place, (estimate, colour) in enumerate(zip(estimates, COLOURS, strict=False)):
        objective = estimate.objective
        count = np.arange(1, len(objective) + 1)
        name = f"#{place + 1}, string {estimate.string}"
        ax.plot(count, objective, color=colour, linewidth=1.4 - 0.3 * (place > 0), label=name)
        low, high = _interval(estimate, histories.least)
        ax.fill_between(count, low, high, color=colour, alpha=0.15, linewidth=0)
        if 0 < estimate.used < len(objective):
            ax.axvline(estimate.used, color=colour, linewidth=0.8, linestyle=":")
        if estimate.again is not None:
            name = "re-estimates, by fresh samples alone"
            _draw_again(ax, estimate, place, colour, "" if place else name)
    _draw_stopping_points(ax, estimates[0], histories.stopping_points)
    _limit_axes(ax, histories)
    legend_below(ax)
    return ax


def _draw_again(ax: Any, estimate: RunningEstimate, place: int, colour: str, label: str) -> None:
    """Draw the re-estimate of a string behind the end of its curve, beside those of others."""
    again = estimate.again
    assert again is not None
    value = again.objective
    ax.errorbar(
        len(estimate.objective) * (1.04 + 0.04 * place),
        value,
        [[value - again.lower], [again.upper - value]],
        color=colour,
        marker="D",
        markersize=4,
        capsize=3,
        linestyle="none",
        label=label or None,
    )


def _draw_stopping_points(
    ax: Any, estimate: RunningEstimate, points: Sequence[StoppingPoint]
) -> None:
    available = len(estimate.objective)
    for point, marker, colour in zip(points, MARKERS, COLOURS[2:], strict=False):
        if point.samples is None or point.samples > available:
            continue
        ax.plot(
            point.samples,
            estimate.objective[point.samples - 1],
            marker,
            color=colour,
            markeredgecolor="black",
            markersize=7,
            zorder=4,
            label=f"{point.rule}: {point.samples}",
        )


def _ensembles_caption(histories: EnsembleHistories) -> str:
    """Return the caption, which names the rules that the samples do not satisfy."""
    best = histories.estimates[0]
    available = len(best.objective)
    points = histories.stopping_points
    absent = [each.rule for each in points if each.samples is None or each.samples > available]
    parts = ["Running objective of the best strings with its 95 % interval."]
    if len(absent) < len(points):
        parts.append("Marks: where each stopping rule would have ended the samples of the best.")
    if absent:
        parts.append(f"Not satisfied by its {pluralise(available, 'sample')}: {'; '.join(absent)}.")
    if any(0 < each.used < len(each.objective) for each in histories.estimates):
        parts.append(
            "Left of a dotted line are the samples that the string was chosen by; right of it the "
            "mean goes on over fresh ones."
        )
    if any(each.again is not None for each in histories.estimates):
        parts.append("Diamonds: re-estimates by the fresh samples alone.")
    return " ".join(parts)


def _interval(estimate: RunningEstimate, least: float) -> tuple[Floats, Floats]:
    lower = np.maximum(least, estimate.objective - estimate.half_width)
    return lower, estimate.objective + estimate.half_width


def _limit_axes(ax: Any, histories: EnsembleHistories) -> None:
    """Show all objectives, and intervals from the tenth sample on: those of fewer are wide."""
    longest = max(len(estimate.objective) for estimate in histories.estimates)
    ends = [
        end[np.isfinite(end)]
        for estimate in histories.estimates
        for end in (
            estimate.objective,
            *(end[WIDE_INTERVALS:] for end in _interval(estimate, histories.least)),
        )
    ]
    values = np.concatenate(ends)
    margin = 0.05 * (float(np.ptp(values)) or 1.0)
    ax.set_ylim(float(values.min()) - margin, float(values.max()) + margin)
    if longest > LOGARITHMIC_COUNT:
        ax.set_xscale("log")
        ax.set_xlim(1, longest * (1.08 + 0.04 * len(histories.estimates)))


class SampleCounts(NamedTuple):
    """Samples that each of n strings was judged by.

    Attributes
    ----------
    used
        Shape (n,).
    at_maximum
        Whether `max_samples` ended the ensemble and not its rule, shape (n,).
    unused
        Samples simulated ahead of decisions that did not need them.
    """

    used: NDArray[np.int64]
    at_maximum: NDArray[np.bool_]
    unused: int


def draw_sample_counts(ax: Any, counts: SampleCounts) -> Any:
    """Draw a histogram of the samples per string, and return the axes."""
    used, at_maximum = counts.used, counts.at_maximum
    style_axes(ax)
    ax.set_xlabel("samples of a string")
    ax.set_ylabel("strings")
    low, high = int(used.min()), int(used.max())
    width = max(1, -(-(high - low + 1) // BINS))
    edges = np.arange(low, high + width + 1, width) - 0.5
    parts = [
        ("ended by the stopping rule", ~at_maximum, COLOURS[5]),
        ("at max_samples", at_maximum, COLOURS[1]),
    ]
    parts = [part for part in parts if part[1].any()]
    ax.hist(
        [used[chosen] for _, chosen, _ in parts],
        bins=edges,
        stacked=True,
        color=[colour for *_, colour in parts],
        label=[f"{name}: {int(chosen.sum())}" for name, chosen, _ in parts],
        edgecolor="white",
        linewidth=0.4,
    )
    mean = float(used.mean())
    ax.axvline(mean, color=COLOURS[6], linestyle="--", linewidth=1.2, label=f"mean {mean:.4g}")
    if low == high:
        ax.set_xlim(low - 2.0, high + 2.0)
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
    return EnsembleHistories(
        [running_estimate(data, string) for string in shown],
        stopping_points(data, shown[0]),
        objective_label(data),
        objective_of(data).least,
    )


def _counts_data(data: CampaignData, _: FigureOptions) -> SampleCounts | None:
    used = data.result_rows()["samples_used"]
    if not len(used):
        return None
    searched = int((data.all_sample_rows()["sample"] < data.fresh_from).sum())
    return SampleCounts(
        used, data.result_rows()["hit_maximum"] == 1, max(0, searched - int(used.sum()))
    )


def _counts_caption(counts: SampleCounts) -> str:
    return (
        f"Samples that the strings were judged by; {counts.unused} more were simulated ahead of a "
        "decision and not needed. The papers took 125 [A] and 11.84 [B] on average."
    )


Figure(
    "ensembles",
    "samples",
    0,
    _ensembles_data,
    draw_ensembles,
    _ensembles_caption,
    (7.2, 5.4),
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
    empty="no string is judged yet",
    method="plot_samples",
    meaning="Draw how many samples strings took.",
)
