"""The best strings as the search believed them, and on fresh samples."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from agglom_mpi.analysis.estimates import Estimate, half_width
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.report.figures.axes import grid, legend_below, objective_label, say
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure


def draw_finalists(
    ax: Any,
    estimates: Sequence[Estimate],
    searched_half: np.ndarray,
    objective: str = "objective (1)",
) -> Any:
    """Draw n estimates beside the search's own values, with 95 % intervals; return the axes.

    Parameters
    ----------
    searched_half
        Half the interval of the search's own values, shape (n,).
    """
    grid(ax)
    ax.set_xlabel(objective)
    if not estimates:
        say(ax, "no string has been estimated again")
        return ax
    place = np.arange(len(estimates))
    value = np.array([e.objective for e in estimates])
    ends = np.array([(e.lower, e.upper) for e in estimates]).T
    own = np.array([e.searched_objective for e in estimates])
    ax.errorbar(
        own,
        place - 0.12,
        xerr=np.abs([np.minimum(searched_half, own), searched_half]),
        fmt="o",
        color=COLOURS[1],
        markerfacecolor="white",
        capsize=2,
        label="as the search had it",
    )
    ax.errorbar(
        value,
        place + 0.12,
        xerr=np.abs(ends - value),
        fmt="D",
        markersize=5,
        color=COLOURS[0],
        capsize=2,
        label="on fresh samples",
    )
    ax.set_yticks(place, [f"#{i + 1} string {e.string}" for i, e in enumerate(estimates)])
    ax.set_ylim(len(estimates) - 0.4, -0.6)
    legend_below(ax)
    return ax


def of_data(data: CampaignData) -> tuple[list[Estimate], np.ndarray]:
    """Return the estimates of a campaign, and half the intervals of the search's own values."""
    known = [estimate for estimate in rank_strings(data).estimates if estimate.known]
    rows = [rank_strings(data).results[estimate.string] for estimate in known]
    counts = np.array([row["samples_used"] - row["failed"] for row in rows], int)
    errors = np.array([estimate.searched_standard_error for estimate in known], float)
    return known, half_width(errors, counts)


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign, if strings were estimated again."""
    estimates, half = of_data(data)
    if not estimates:
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_finalists(figure.subplots(), estimates, half, objective_label(data))

    yield Picture(
        "finalists",
        "The best strings with 95 % intervals: as the search had them, chosen for being low, and "
        "on fresh samples that no decision has seen.",
        draw,
        (6.0, 1.6 + 0.4 * len(estimates)),
    )
