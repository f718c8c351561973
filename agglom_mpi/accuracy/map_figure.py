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
    shown = _within(points, x, y)
    kinds = list(dict.fromkeys(k for panel in panels for k in panel.troubles.values() if k))
    for ax, panel in zip(axes.flat, panels, strict=False):
        _draw_panel(ax, x, y, panel, kinds, norm, grid)
        for name, place in shown.items():
            ax.plot(*place, **_point_style(name), linestyle="none", zorder=4, clip_on=False)
    for ax in axes.flat[len(panels) :]:
        ax.set_visible(False)
    for column in range(columns):  # shared axes have their labels in the last row alone
        axes[(len(panels) - 1 - column) // columns, column].tick_params(labelbottom=True)
    figure.supxlabel(x.label, fontsize="medium")
    figure.supylabel(y.label, fontsize="medium")
    colours = ScalarMappable(norm, "Blues")
    figure.colorbar(colours, ax=axes, label=error, extend="both", shrink=0.8)
    _add_legend(figure, kinds, shown, any(panel.hatched for panel in panels))


def _within(
    points: Mapping[str, NDArray[np.float64]], x: "Axis", y: "Axis"
) -> dict[str, NDArray[np.float64]]:
    """Return those of some points that lie on the map."""
    low, high = np.array([x.value(0.0), y.value(0.0)]), np.array([x.value(1.0), y.value(1.0)])
    return {
        name: place
        for name, place in points.items()
        if (low <= place).all() and (place <= high).all()
    }


def _point_style(name: str) -> dict[str, Any]:
    """Return how a scene is marked; rows of a paper, as `[A] row 1`, are stars."""
    published = name.startswith("[")
    return {
        "marker": "*" if published else "o",
        "markersize": 6.0 if published else 3.5,
        "markerfacecolor": "#F0E442" if published else "white",
        "markeredgecolor": "black",
        "markeredgewidth": 0.6 if published else 0.8,
    }


def _draw_panel(
    ax: Any, x: "Axis", y: "Axis", panel: MapPanel, kinds: Sequence[str], norm: Any, grid: int
) -> None:
    """Draw the cells of a method; all of a kind at once, as single patches take long."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.ticker import NullFormatter

    colours = ScalarMappable(norm, "Blues")
    cells = list(panel.errors)
    errors = np.array([panel.errors[cell] for cell in cells])
    shown = np.where(np.isnan(errors)[:, None], 1.0, colours.to_rgba(np.nan_to_num(errors)))
    widths = [0.3 if cell.level == 0 else 0.0 for cell in cells]
    corners = [_corners(x, y, cell, grid) for cell in cells]
    ax.add_collection(
        PolyCollection(corners, facecolors=shown, edgecolors="0.85", linewidths=widths, zorder=1)
    )
    hatched = [corner for corner, cell in zip(corners, cells, strict=True) if cell in panel.hatched]
    if hatched:
        edge: dict[str, Any] = {"facecolors": "none", "edgecolors": "0.4", "linewidths": 0.0}
        ax.add_collection(PolyCollection(hatched, **edge, hatch="/////", zorder=3))
    groups: dict[tuple[str, int], list[tuple[float, float]]] = {}
    for cell in cells:
        if kind := panel.troubles[cell]:
            across, up = cell.centre(grid)
            groups.setdefault((kind, cell.level), []).append((x.value(across), y.value(up)))
    for (kind, level), places in groups.items():
        marker, colour = _mark(kinds.index(kind))
        size = 4.5 / 2**level + 0.3
        style: dict[str, Any] = {"marker": marker, "color": colour, "markersize": size}
        ax.plot(*np.transpose(places), linestyle="none", markeredgewidth=0.0, zorder=2, **style)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(x.value(0.0), x.value(1.0))
    ax.set_ylim(y.value(0.0), y.value(1.0))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())
    ax.set_title(panel.title, fontsize="small")
    ax.tick_params(labelsize="small")


def _corners(x: "Axis", y: "Axis", cell: Cell, grid: int) -> list[tuple[float, float]]:
    """Return the corners of a cell, one after the other."""
    edge = cell.edge(grid)
    left, right = x.value(cell.column * edge), x.value((cell.column + 1) * edge)
    low, high = y.value(cell.row * edge), y.value((cell.row + 1) * edge)
    return [(left, low), (right, low), (right, high), (left, high)]


def _mark(place: int) -> tuple[str, str]:
    """Return marker and colour of a kind of trouble, by its place among those of the figure."""
    return TROUBLE_MARKERS[place], TROUBLE_COLOURS[place % len(TROUBLE_COLOURS)]


def _add_legend(
    figure: "matplotlib.figure.Figure",
    kinds: Sequence[str],
    points: Mapping[str, Any],
    hatched: bool,
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    for place, kind in enumerate(kinds):
        marker, colour = _mark(place)
        style: dict[str, Any] = {"linestyle": "none", "markeredgewidth": 0.0, "label": kind}
        handles.append(Line2D([], [], marker=marker, color=colour, **style))
    handles.append(Patch(facecolor="white", edgecolor="0.85", label="not resolved"))
    if hatched:
        handles.append(Patch(facecolor="white", edgecolor="0.4", hatch="/////", label="documented"))
    for label, published in (("scenes", False), ("rows of the papers", True)):
        named = [name for name in points if name.startswith("[") == published]
        if named:
            handles.append(Line2D([], [], linestyle="none", label=label, **_point_style(named[0])))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=min(6, len(handles)),
        frameon=False,
        fontsize="small",
    )
