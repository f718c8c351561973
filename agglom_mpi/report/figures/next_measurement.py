"""Share of the box that each further measurement would leave, as bars."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.report.drawing import legend_below
from agglom_mpi.report.figures.data_fit import TWO_SIDED
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.style import COLOURS, PAGE
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    from agglom_mpi.inference.next_measurement import NextMeasurements

MAX_BARS: Final = 20
"""Maximum number of measurements that are drawn."""
BAR_HEIGHT: Final = 0.24
"""Height of the figure per bar, inches."""


def draw_next(ax: Any, found: "NextMeasurements") -> Any:
    """Draw the expected volume after each measurement beside that of today; return the axes."""
    shown = found.ranked[:MAX_BARS]
    place = np.arange(len(shown))
    volumes = 100.0 * np.array([each.after.value for each in shown])
    errors = 100.0 * TWO_SIDED * np.array([each.after.error for each in shown])
    for repeats, colour, label in (
        (False, COLOURS[0], "new quantity"),
        (True, COLOURS[4], "repetition with half of the error"),
    ):
        some = np.array([each.repeats is repeats for each in shown], bool)
        if some.any():
            ax.barh(place[some], volumes[some], color=colour, height=0.7, label=label)
    ax.errorbar(volumes, place, xerr=errors, fmt="none", ecolor="0.15", capsize=2)
    ax.axvline(100.0 * found.volume, color="0.3", linestyle="--", label="posterior as it is")
    names = [each.name if each.repeats else f"{each.name}, {each.error_text}" for each in shown]
    ax.set_yticks(place, names)
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_xlabel("expected share of the box (%)")
    legend_below(ax)
    return ax


def _found(_: CampaignData, options: FigureOptions) -> "NextMeasurements | None":
    if options.plotted and options.posterior is not None:
        return options.posterior.next_measurements()
    return options.further


def _caption(found: "NextMeasurements") -> str:
    left = len(found.ranked) - MAX_BARS
    more = f" The {left} that would leave more are left out." if left > 0 else ""
    return (
        "What to measure next: expected share of the box in the smallest region with 90 % of the "
        "posterior after one more measurement, with 95 % intervals of the simulated measurements."
        f"{more}"
    )


Figure(
    "next_measurement",
    "posterior",
    2,
    _found,
    draw_next,
    _caption,
    lambda found: (PAGE, 1.5 + BAR_HEIGHT * min(len(found.ranked), MAX_BARS)),
    method="plot_next_measurement",
    meaning="Draw what each further measurement would leave of the box; takes a minute.",
    takes=("ax", "posterior"),
)
