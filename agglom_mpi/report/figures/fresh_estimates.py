"""The best strings on fresh samples: beside the search's own objectives, and in larger volumes."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from agglom_mpi.analysis.estimates import Estimate, half_width, objective_of
from agglom_mpi.analysis.finite_size import FiniteSize, finite_sizes
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.report.figures.figure import Figure, FigureOptions, objective_label
from agglom_mpi.report.style import COLOURS, MIDDLE, legend_below
from agglom_mpi.storage.reader import CampaignData

Finalists = tuple[Sequence[Estimate], np.ndarray, str, float]
"""Estimates of n strings on fresh samples in order of rank, half of the 95 % intervals of their
objectives as searched, (n,), the name of the objective, and its lower bound, where those end."""


def draw_finalists(ax: Any, finalists: Finalists) -> Any:
    """Draw estimates beside the search's own objectives, with 95 % intervals; return the axes."""
    estimates, half, label, least = finalists
    ax.set_xlabel(label)
    place = np.arange(len(estimates))
    value = np.array([e.objective for e in estimates])
    ends = np.array([(e.lower, e.upper) for e in estimates]).T
    searched = np.array([e.searched_objective for e in estimates])
    bars = searched - np.maximum(least, searched - half), half
    style = {"fmt": "o", "color": COLOURS[1], "markerfacecolor": "white", "capsize": 2}
    ax.errorbar(searched, place - 0.12, xerr=bars, label="as searched", **style)
    style = {"fmt": "D", "markersize": 5, "color": COLOURS[0], "capsize": 2}
    ax.errorbar(value, place + 0.12, xerr=np.abs(ends - value), label="re-estimate", **style)
    ax.set_yticks(place, [f"#{i + 1} string {e.string}" for i, e in enumerate(estimates)])
    ax.set_ylim(len(estimates) - 0.4, -0.6)
    legend_below(ax)
    return ax


def _finalists_data(data: CampaignData, _: FigureOptions) -> Finalists | None:
    known = list(rank_strings(data).again.values())
    if not known:
        return None
    rows = [rank_strings(data).results[estimate.string] for estimate in known]
    counts = np.array([row["samples_used"] - row["failed"] for row in rows], int)
    errors = np.array([estimate.searched_standard_error for estimate in known], float)
    least = objective_of(data).least
    return known, half_width(errors, counts), objective_label(data), least


Figure(
    "finalists",
    "answer",
    2,
    _finalists_data,
    draw_finalists,
    "The best strings with 95 % intervals: as searched, by the samples that they were chosen by, "
    "and their re-estimates on fresh samples that no decision has seen.",
    lambda finalists: (MIDDLE, 1.4 + 0.34 * len(finalists[0])),
    empty="no string has been estimated again",
    method="plot_finalists",
    meaning="Draw the best strings as searched and on fresh samples.",
)


MAX_DRAWN: Final = 6
"""Maximum number of strings that are drawn."""
STAGGER: Final = 0.012
"""Distance of the points of successive strings, relative to the largest 1/N."""
CURVE_POINTS: Final = 40
"""Number of points of a fitted curve."""

Ranked = Sequence[tuple[str, FiniteSize]]
"""Names of strings, and their finite size."""


def draw_finite_size(ax: Any, ranked: Ranked) -> Any:
    """Draw means with 95 % intervals against 1/N and the fitted curves; return the axes."""
    ax.set_xlabel("1/N, N grains")
    ax.set_ylabel("mean b/b⁰")
    largest = max(1.0 / size.volumes[0].grains for _, size in ranked)
    for place, (name, size) in enumerate(ranked):
        colour, fit = COLOURS[place % len(COLOURS)], size.growth
        aside = STAGGER * largest * (place - (len(ranked) - 1) / 2.0)
        inverse = np.array([1.0 / each.grains for each in size.volumes])
        means = [each.growth for each in size.volumes]
        bars = [mean.half_width for mean in means]
        values = [mean.value for mean in means]
        points = {"color": colour, "fmt": "o", "markersize": 4, "capsize": 2}
        ax.errorbar(inverse + aside, values, yerr=bars, label=name, **points)
        at = np.linspace(0.0, inverse.max(), CURVE_POINTS)
        curve = fit.limit.value + (fit.slope.value + fit.quadratic.value * at) * at
        ax.plot(at + aside, curve, color=colour, linewidth=1)
        limit = {"color": colour, "fmt": "D", "markersize": 5, "capsize": 3}
        bar = fit.limit.half_width
        ax.errorbar(aside, fit.limit.value, yerr=bar, markerfacecolor="white", **limit)
    ax.set_xlim(left=-0.08 * largest)
    legend_below(ax)
    return ax


def _ranked(data: CampaignData, _: FigureOptions) -> Ranked | None:
    sizes = finite_sizes(data)
    order = rank_strings(data).order if sizes else []
    names = [(f"#{place} string {i}", sizes[i]) for place, i in enumerate(order, 1) if i in sizes]
    return names[:MAX_DRAWN] or None


Figure(
    "finite_size",
    "answer",
    3,
    _ranked,
    draw_finite_size,
    "Mean growth of the best strings in larger control volumes, against 1/N, with 95 % intervals. "
    "Diamonds: limits for many grains, of parabolas in 1/N fitted by weighted least squares, or "
    "lines with two volumes.",
    empty="no string was estimated in several volumes",
    method="plot_finite_size",
    meaning="Draw the growth of the best strings against 1/N, with limits.",
)
