"""The figure of a map: a panel for each method, cells coloured by the error, marks of failures."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.maps.cells import Cell, CellMap, CellResult, MapPlane, leaves

if TYPE_CHECKING:
    import matplotlib.figure

PANEL_SIZE: Final = (3.1, 2.9)
"""Width and height of a panel, inches."""

TROUBLE_COLOURS: Final = (
    *("#D55E00", "#CC79A7", "#000000", "#E69F00", "#8C564B", "#7F7F7F", "#B22222"),
)
"""Colours of kinds of trouble, in the order in which they are met."""

TROUBLE_MARKERS: Final = "sXv^oDP*"
POINT_STYLES: Final[Mapping[bool, Mapping[str, Any]]] = {
    False: {"marker": "o", "markersize": 3.5, "markerfacecolor": "white", "markeredgewidth": 0.8},
    True: {"marker": "*", "markersize": 6.0, "markerfacecolor": "#F0E442", "markeredgewidth": 0.6},
}
"""How scenes are marked, and rows of a paper, whose names are like `[A] row 1`."""


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
    found: CellMap,
    points: Mapping[str, NDArray[np.float64]],
) -> None:
    """Draw a map.

    Parameters
    ----------
    found
        Its cells by each method, which has a panel; both axes are logarithmic.
    points
        Scenes to be marked where they lie on the map, by name, (2,).
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    plane, results = found.plane, found.results
    sides = plane.x, plane.y
    rows, columns = _layout(len(results))
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    colours = ScalarMappable(LogNorm(*plane.ends), "Blues")
    low, high = (np.array([side.value(end) for side in sides]) for end in (0.0, 1.0))
    shown = {n: at for n, at in points.items() if (low <= at).all() and (at <= high).all()}
    panels = [{cell: own[cell] for cell in leaves(own)} for own in results.values()]
    shown_results = [result for cells in panels for result in cells.values()]
    kinds = list(dict.fromkeys(each.trouble for each in shown_results if each.trouble))
    for ax, method, cells in zip(axes.flat, results, panels, strict=False):
        _draw_panel(ax, plane, found.grid, cells, kinds, colours)
        ax.set_title(method, fontsize="small")
        for name, place in shown.items():
            style = POINT_STYLES[name.startswith("[")]
            ax.plot(*place, **style, c="k", ls="none", mec="black", zorder=4, clip_on=False)
        ax.set(xscale="log", yscale="log", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        _plain_ticks(ax)
    for ax in axes.flat[len(results) :]:
        ax.set_visible(False)
    for column in range(columns):  # shared axes have their labels in the last row alone
        axes[(len(results) - 1 - column) // columns, column].tick_params(labelbottom=True)
    figure.supxlabel(sides[0].label, fontsize="medium")
    figure.supylabel(sides[1].label, fontsize="medium")
    figure.colorbar(colours, ax=axes, label=plane.error, extend="both", shrink=0.8)
    _add_legend(figure, kinds, shown, any(each.excuse for each in shown_results))


def _plain_ticks(ax: Any) -> None:
    from matplotlib.ticker import NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())
    ax.tick_params(labelsize="small")


def _draw_panel(
    ax: Any,
    plane: MapPlane,
    grid: int,
    cells: Mapping[Cell, CellResult],
    kinds: Sequence[str],
    colours: Any,
) -> None:
    """Draw the cells of a method; all of a kind at once, as single patches take long."""
    from matplotlib.collections import PolyCollection

    # Beginning, middle and end of the cells on both axes, shape (2, n, 3).
    places = np.array([[(cell.column, cell.row), (cell.edge(grid),) * 2] for cell in cells])
    ends = (places[:, 0, :, None] + [0.0, 0.5, 1.0]) * places[:, 1, :, None]
    x, y = (side.value(ends[:, i]) for i, side in enumerate((plane.x, plane.y)))
    errors = np.array([plane.shown_error(each) for each in cells.values()])
    shown = np.where(np.isnan(errors)[:, None], 1.0, colours.to_rgba(np.nan_to_num(errors)))
    corners: Any = np.stack([x[:, [0, 2, 2, 0]], y[:, [0, 0, 2, 2]]], axis=-1)
    levels = np.array([cell.level for cell in cells])
    widths = np.where(levels == 0, 0.3, 0.0)
    ax.add_collection(
        PolyCollection(corners, facecolors=shown, edgecolors="0.85", linewidths=widths, zorder=1)
    )
    hatched = np.array([bool(each.excuse) for each in cells.values()])
    if hatched.any():
        edge: dict[str, Any] = {"facecolors": "none", "edgecolors": "0.4", "linewidths": 0.0}
        ax.add_collection(PolyCollection(corners[hatched], **edge, hatch="/////", zorder=3))
    troubles = np.array([each.trouble for each in cells.values()])
    for kind, level in dict.fromkeys(zip(troubles.tolist(), levels.tolist(), strict=True)):
        if kind:
            is_one = (troubles == kind) & (levels == level)
            style = _mark(kinds.index(kind)) | {"markersize": 4.5 / 2**level + 0.3}
            ax.plot(x[is_one, 1], y[is_one, 1], **style, zorder=2)


def _mark(place: int) -> dict[str, Any]:
    """Return how a kind of trouble is marked, by its place among those of the figure."""
    colour = TROUBLE_COLOURS[place % len(TROUBLE_COLOURS)]
    marker = TROUBLE_MARKERS[place]
    return {"marker": marker, "color": colour, "linestyle": "none", "markeredgewidth": 0.0}


def _add_legend(
    figure: "matplotlib.figure.Figure",
    kinds: Sequence[str],
    points: Mapping[str, Any],
    hatched: bool,
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], label=kind, **_mark(place)) for place, kind in enumerate(kinds)
    ]
    handles.append(Patch(facecolor="white", edgecolor="0.85", label="not resolved"))
    if hatched:
        handles.append(Patch(facecolor="white", edgecolor="0.4", hatch="/////", label="documented"))
    for label, published in (("scenes", False), ("rows of the papers", True)):
        if any(name.startswith("[") == published for name in points):
            style = POINT_STYLES[published]
            handles.append(Line2D([], [], ls="none", mec="black", label=label, **style))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=min(6, len(handles)),
        frameon=False,
        fontsize="small",
    )
