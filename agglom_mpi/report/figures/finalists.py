"""The best strings by the samples that the search used, and on fresh samples."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agglom_mpi.analysis.estimates import Estimate, half_width, objective_of
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.report.drawing import legend_below
from agglom_mpi.report.figures.figure import Figure, FigureOptions, objective_label
from agglom_mpi.report.style import COLOURS, MIDDLE
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
