"""Mean growth of the best strings against 1/N, and its limit for many grains."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from agglom_mpi.analysis.finite_size import FiniteSize, finite_sizes
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.report.drawing import legend_below
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.style import COLOURS
from agglom_mpi.storage.reader import CampaignData

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
