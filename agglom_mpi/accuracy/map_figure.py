"""The figure of a map: a panel for each method, cells coloured by the error, marks of failures."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.quadtree import Cell

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.accuracy.planes import Axis

PANEL_SIZE: Final = (3.1, 2.9)
"""Width and height of a panel, inches."""

TROUBLE_COLOURS: Final = (
    "#D55E00",
    "#CC79A7",
    "#000000",
    "#E69F00",
    "#8C564B",
    "#7F7F7F",
    "#B22222",
)
"""Colours of kinds of trouble, in the order in which they are met."""

TROUBLE_MARKERS: Final = "sXv^oDP*"
ERRORS: Final = (1e-3, 1.0)
"""Ends of the scale of relative errors."""


class MapPanel(NamedTuple):
    """A method on a map.

    Attributes
    ----------
    title
    errors
        Magnitude of the error of each leaf; nan where none is shown.
    troubles
        What is wrong in each leaf; empty where it is sound.
    hatched
        Cells in which the method may fail.
    """

    title: str
    errors: Mapping[Cell, float]
    troubles: Mapping[Cell, str]
    hatched: frozenset[Cell] = frozenset()


def map_size(panels: int) -> tuple[float, float]:
    """Return width and height of a figure of some panels, inches."""
    rows, columns = _layout(panels)
    return columns * PANEL_SIZE[0] + 0.9, rows * PANEL_SIZE[1] + 0.6


def _layout(panels: int) -> tuple[int, int]:
    """Return the numbers of rows and columns of some panels."""
    columns = 2 if panels == 4 else min(panels, 3)
    return math.ceil(panels / columns), columns


def draw_map(
    figure: "matplotlib.figure.Figure",
    x: "Axis",
    y: "Axis",
    panels: Sequence[MapPanel],
    points: Mapping[str, NDArray[np.float64]],
    grid: int,
    error: str = "relative error of mean b/b⁰",
    ends: tuple[float, float] = ERRORS,
) -> None:
    """Draw a map.

    Parameters
    ----------
    x, y
        Its axes, logarithmic.
    panels
        One for each method.
    points
        Scenes to be marked, by name, (2,).
    grid
        Cells of level 0 along a side.
    error, ends
        Label and ends of the scale of the colours.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    rows, columns = _layout(len(panels))
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    norm = LogNorm(*ends)
    kinds = list(dict.fromkeys(k for panel in panels for k in panel.troubles.values() if k))
    for ax, panel in zip(axes.flat, panels, strict=False):
        _draw_panel(ax, x, y, panel, kinds, norm, grid)
        for place in _within(points, x, y):
            ax.plot(
                *place,
                "o",
                markersize=3.5,
                markerfacecolor="white",
                markeredgecolor="black",
                markeredgewidth=0.8,
                zorder=4,
                clip_on=False,
            )
    for ax in axes.flat[len(panels) :]:
        ax.set_visible(False)
    for column in range(columns):  # shared axes have their labels in the last row alone
        axes[(len(panels) - 1 - column) // columns, column].tick_params(labelbottom=True)
    figure.supxlabel(x.label, fontsize="medium")
    figure.supylabel(y.label, fontsize="medium")
    colours = ScalarMappable(norm, "Blues")
    figure.colorbar(colours, ax=axes, label=error, extend="both", shrink=0.8)
    _add_legend(figure, kinds, bool(points), any(panel.hatched for panel in panels))


def _within(
    points: Mapping[str, NDArray[np.float64]], x: "Axis", y: "Axis"
) -> list[NDArray[np.float64]]:
    """Return those of some points that lie on the map."""
    low, high = np.array([x.value(0.0), y.value(0.0)]), np.array([x.value(1.0), y.value(1.0)])
    return [place for place in points.values() if (low <= place).all() and (place <= high).all()]


def _draw_panel(
    ax: Any, x: "Axis", y: "Axis", panel: MapPanel, kinds: Sequence[str], norm: Any, grid: int
) -> None:
    """Draw the cells of a method."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import NullFormatter

    colours = ScalarMappable(norm, "Blues")
    for cell, error in panel.errors.items():
        kind, edge = panel.troubles[cell], cell.edge(grid)
        left, low = x.value(cell.column * edge), y.value(cell.row * edge)
        right, high = x.value((cell.column + 1) * edge), y.value((cell.row + 1) * edge)
        shown = "white" if math.isnan(error) else colours.to_rgba(np.array(error))
        patch = Rectangle(
            (left, low),
            right - left,
            high - low,
            facecolor=shown,
            edgecolor="0.85",
            linewidth=0.3 if cell.level == 0 else 0.0,
            zorder=1,
        )
        ax.add_patch(patch)
        if kind:
            place = kinds.index(kind)
            colour = TROUBLE_COLOURS[place % len(TROUBLE_COLOURS)]
            centre = cell.centre(grid)
            ax.plot(
                x.value(centre[0]),
                y.value(centre[1]),
                TROUBLE_MARKERS[place],
                color=colour,
                markersize=4.5 / 2**cell.level + 0.3,
                markeredgewidth=0.0,
                zorder=2,
            )
        if cell in panel.hatched:
            ax.add_patch(
                Rectangle(
                    (left, low),
                    right - left,
                    high - low,
                    facecolor="none",
                    edgecolor="0.4",
                    linewidth=0.0,
                    hatch="/////",
                    zorder=3,
                )
            )
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(x.value(0.0), x.value(1.0))
    ax.set_ylim(y.value(0.0), y.value(1.0))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())
    ax.set_title(panel.title, fontsize="small")
    ax.tick_params(labelsize="small")


def _add_legend(
    figure: "matplotlib.figure.Figure", kinds: Sequence[str], points: bool, hatched: bool
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D(
            [],
            [],
            marker=TROUBLE_MARKERS[i],
            linestyle="none",
            markeredgewidth=0.0,
            color=TROUBLE_COLOURS[i % len(TROUBLE_COLOURS)],
            label=kind,
        )
        for i, kind in enumerate(kinds)
    ]
    handles.append(Patch(facecolor="white", edgecolor="0.85", label="not resolved"))
    if hatched:
        handles.append(Patch(facecolor="white", edgecolor="0.4", hatch="/////", label="documented"))
    if points:
        handles.append(
            Line2D(
                [],
                [],
                marker="o",
                linestyle="none",
                markerfacecolor="white",
                markeredgecolor="black",
                markersize=3.5,
                label="scenes",
            )
        )
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=min(6, len(handles)),
        frameon=False,
        fontsize="small",
    )
