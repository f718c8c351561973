"""Which variables matter: shares of the variance of the objective."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from agglom_mpi.report.figures.axes import grid, legend_below
from agglom_mpi.report.picture import COLOURS, Picture

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.analysis.sensitivity import Sensitivity


def draw_sensitivity(ax: Any, names: Sequence[str], found: "Sensitivity") -> Any:
    """Draw first-order and total indices of d variables as bars, and return the axes."""
    grid(ax)
    order = np.argsort(-found.total, kind="stable")
    place = np.arange(len(order))
    for shift, values, name, colour in (
        (-0.2, found.first_order, "alone", COLOURS[0]),
        (0.2, found.total, "with others", COLOURS[4]),
    ):
        ax.barh(place + shift, 100.0 * values[order], 0.38, color=colour, label=name)
    ax.set_yticks(place, [names[i].replace("_", " ") for i in order])
    ax.invert_yaxis()
    ax.set_xlabel("share of the variance of the objective (%)")
    legend_below(ax)
    return ax


def picture_of(names: Sequence[str], found: "Sensitivity") -> Picture:
    """Return the picture of a sensitivity."""

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_sensitivity(figure.subplots(), names, found)

    return Picture(
        "sensitivity",
        "Share of the variance of the objective over the search box that each variable explains "
        f"(Sobol indices), by a regression of {found.strings} strings; it predicts "
        f"{found.explained:.0%} of the variance of strings left out, noise of samples is "
        f"{found.noise:.0%}.",
        draw,
        (6.0, 1.8 + 0.3 * len(names)),
    )
