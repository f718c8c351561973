"""How the figures of the accuracy report look: work-precision curves with their bands."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from agglom_mpi.report.drawing import COLOURS

if TYPE_CHECKING:
    import matplotlib.figure

MARKERS: Final = "os^DvPX"


class Curve(NamedTuple):
    """Points of one method: cost, error, and a confidence band of the error (same shapes)."""

    label: str
    cost: ArrayLike
    error: ArrayLike
    low: ArrayLike | None = None
    high: ArrayLike | None = None


def draw_curves(
    figure: "matplotlib.figure.Figure",
    curves: Sequence[Curve],
    cost: str,
    error: str,
    *,
    scales: tuple[str, str] = ("log", "log"),
    zero: bool = False,
) -> Any:
    """Draw work-precision curves and return the axes.

    Parameters
    ----------
    cost, error
        Labels of the axes, with units.
    scales
        Of both axes: `log`, `linear`, `symlog`.
    zero
        Draw a line where the error is zero, for signed errors on a linear scale.
    """
    axes = figure.subplots()
    axes.set_xscale(scales[0])
    axes.set_yscale(scales[1])
    for index, curve in enumerate(curves):
        add_curve(axes, curve, index)
    if zero:
        axes.axhline(0.0, color="0.5", linewidth=0.8)
    axes.set_xlabel(cost)
    axes.set_ylabel(error)
    axes.grid(True, which="major", color="0.9", linewidth=0.6)
    if len(curves) > 1:
        axes.legend(frameon=False, fontsize="small")
    return axes


def add_curve(axes: Any, curve: Curve, index: int) -> None:
    """Add one curve with its band to axes; `index` picks colour and marker."""
    colour = COLOURS[index % len(COLOURS)]
    cost, error = np.asarray(curve.cost, float), np.asarray(curve.error, float)
    axes.plot(
        cost,
        error,
        color=colour,
        marker=MARKERS[index % len(MARKERS)],
        markersize=4,
        linewidth=1.2,
        label=curve.label,
    )
    if curve.low is not None and curve.high is not None:
        low, high = np.asarray(curve.low, float), np.asarray(curve.high, float)
        axes.fill_between(cost, low, high, color=colour, alpha=0.15, linewidth=0)
