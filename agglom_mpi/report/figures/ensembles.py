"""What the samples of a string amount to, one by one, and where a stopping rule would end them."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import half_width, objective_of
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.outcome import SampleSummary, summaries
from agglom_mpi.report.figures.axes import grid, legend_below, objective_label, say
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.objectives import Objective
from agglom_mpi.search.stopping import COMPARED_RULES, FixedNumber, StoppingRule
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

Floats = NDArray[np.float64]

TALL: Final = (7.2, 5.4)
"""Inches."""
SHOWN: Final = 3
"""Strings in the picture."""
WIDE: Final = 9
"""First samples whose intervals need not fit."""
MARKERS: Final = "osD^vP"


class Course(NamedTuple):
    """The first 1 … n completed samples of a string: arrays of shape (n,).

    Attributes
    ----------
    string
    value, half
        Objective of the samples so far, and half of its 95 % interval, nan for one sample.
    seen
        Completed samples that the search judged the string by; the rest ran ahead or is fresh.
    """

    string: int
    value: Floats
    half: Floats
    seen: int


class Stop(NamedTuple):
    """Where a rule would have ended an ensemble; `samples` is None if it needs more than these."""

    rule: str
    samples: int | None


def course(data: CampaignData, string: int) -> Course:
    """Return how the objective of a string came about, over all its samples there are."""
    rows = data.sample_rows(string)
    used = int(rank_strings(data).results[string]["samples_used"])
    completed = rows[rows["state"] == 1]
    tally, values, errors = objective_of(data).accumulator(), [], []
    for outcome in summaries(completed):
        tally.add(outcome)
        values.append(tally.value)
        errors.append(tally.standard_error)
    counts = np.arange(1, len(values) + 1)
    seen = int((completed["sample"] < used).sum())
    return Course(string, np.array(values), half_width(np.array(errors), counts), seen)


def own_rule(data: CampaignData) -> StoppingRule:
    """Return the stopping rule of the campaign's ensembles."""
    from agglom_mpi.config.ensemble import ENSEMBLE

    return ENSEMBLE.validate_python(data.section("ensemble")).build()


def stops(data: CampaignData, string: int) -> list[Stop]:
    """Return where the campaign's own rule and `COMPARED_RULES` end the samples of a string."""
    outcomes = summaries(data.sample_rows(string))
    own, fewest = own_rule(data), int(data.identity.get("ensemble.min_samples", 2))
    particles = int(data.identity["scene.particles"])
    tried = [(name, rule, 2) for name, rule in COMPARED_RULES if rule != own]
    if not isinstance(own, FixedNumber):
        tried.insert(0, (f"this campaign's: {own.label}", own, fewest))
    return [
        Stop(name, stop(outcomes, rule, objective_of(data), particles, fewest))
        for name, rule, fewest in tried
    ]


def stop(
    outcomes: Sequence[SampleSummary],
    rule: StoppingRule,
    objective: Objective,
    particles: int,
    fewest: int,
) -> int | None:
    """Completed samples after which a rule is satisfied; None if these are not enough."""
    ensemble = Ensemble(rule, objective, particles, fewest, max(len(outcomes) + 1, fewest))
    for outcome in outcomes:
        ensemble.add(outcome)
        if ensemble.finished:
            return ensemble.completed
    return None


def draw_ensembles(
    ax: Any,
    courses: Sequence[Course],
    stopped: Sequence[Stop],
    objective: str = "objective (1)",
    least: float = 0.0,
) -> Any:
    """Draw running means with 95 % intervals, the first with the rules' ends; return the axes.

    No objective is less than `least`, so intervals end there.
    """
    grid(ax)
    ax.set_xlabel("completed samples of the string")
    ax.set_ylabel(f"running {objective}")
    if not any(len(one.value) for one in courses):
        say(ax, "no string has samples yet")
        return ax
    for place, (one, colour) in enumerate(zip(courses, COLOURS, strict=False)):
        count = np.arange(1, len(one.value) + 1)
        name = f"#{place + 1}, string {one.string}"
        ax.plot(count, one.value, color=colour, linewidth=1.4 - 0.3 * (place > 0), label=name)
        low, high = _interval(one, least)
        ax.fill_between(count, low, high, color=colour, alpha=0.15, linewidth=0)
        if 0 < one.seen < len(one.value):
            ax.axvline(one.seen, color=colour, linewidth=0.8, linestyle=":")
    _draw_stops(ax, courses[0], stopped)
    _limit(ax, courses, least)
    legend_below(ax)
    return ax


def _draw_stops(ax: Any, one: Course, stopped: Sequence[Stop]) -> None:
    for found, marker, colour in zip(stopped, MARKERS, COLOURS[2:], strict=False):
        if found.samples is None or found.samples > len(one.value):
            ax.plot([], [], " ", label=f"{found.rule}: not within {len(one.value)}")
            continue
        ax.plot(
            found.samples,
            one.value[found.samples - 1],
            marker,
            color=colour,
            markeredgecolor="black",
            markersize=7,
            zorder=4,
            label=f"{found.rule}: {found.samples}",
        )


def _interval(one: Course, least: float) -> tuple[Floats, Floats]:
    return np.maximum(least, one.value - one.half), one.value + one.half


def _limit(ax: Any, courses: Sequence[Course], least: float) -> None:
    """Show all means, and intervals from the tenth sample on: those of fewer are wide."""
    longest = max(len(one.value) for one in courses)
    ends = [
        end[np.isfinite(end)]
        for one in courses
        for end in (one.value, *(end[WIDE:] for end in _interval(one, least)))
    ]
    values = np.concatenate(ends)
    room = 0.05 * (float(np.ptp(values)) or 1.0)
    ax.set_ylim(float(values.min()) - room, float(values.max()) + room)
    if longest > 60:
        ax.set_xscale("log")
        ax.set_xlim(1, longest * 1.05)


def draw_campaign(ax: Any, data: CampaignData) -> Any:
    """Draw those of the best strings of a campaign, and return the axes."""
    shown = _shown(data)
    courses = [course(data, string) for string in shown]
    stopped = stops(data, shown[0]) if shown else []
    return draw_ensembles(ax, courses, stopped, objective_label(data), objective_of(data).least)


def _shown(data: CampaignData) -> list[int]:
    """Best strings that have completed samples."""
    return [i for i in rank_strings(data).order if (data.sample_rows(i)["state"] == 1).any()][
        :SHOWN
    ]


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign's best strings, if they have samples."""
    if not _shown(data):
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_campaign(figure.subplots(), data)

    yield Picture(
        "ensembles",
        "Running objective of the best strings with its 95 % interval. Marks: where each stopping "
        "rule would have ended the samples of the best. Left of a dotted line are the samples that "
        "the search saw, right of it those that ran ahead and fresh ones.",
        draw,
        TALL,
    )
