"""How well the answer was known after how long: error against run time."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.report.figures.axes import grid, legend_below, say
from agglom_mpi.report.figures.convergence import History, history
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure


MANY: Final = 40
"""Generations from which single ones are not marked."""


def draw_cost(ax: Any, found: History) -> Any:
    """Draw half the 95 % interval of best and mean-of-top against time, and return the axes."""
    grid(ax)
    ax.set_xlabel("wall-clock time, all legs (s)")
    ax.set_ylabel("95 % half-width of the objective (1)")
    curves = (
        ("best string", found.best_half, "o"),
        (f"mean of the best {found.tops}", found.top_half, "s"),
    )
    if not any((half > 0.0).any() for _, half, _ in curves):
        say(ax, "no generation with an error yet")
        return ax
    for (name, half, marker), colour in zip(curves, COLOURS, strict=False):
        known = half > 0.0
        ax.plot(
            found.seconds[known],
            half[known],
            color=colour,
            marker=marker if len(half) < MANY else "",
            markersize=3.5,
            linewidth=1.0,
            label=name,
        )
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    legend_below(ax)
    return ax


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign, if there is an error to show."""
    found = history(data)
    if not (np.nan_to_num(found.best_half) > 0.0).any():
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_cost(figure.subplots(), found)

    yield Picture(
        "cost",
        "Error against run time: half of the 95 % interval (standard error × Student's t) of the "
        "best objective after each generation, and of the mean of the best.",
        draw,
    )
