"""The section of a report on a map: its figure, and the shares of the plane by method.

The figure has a panel for each method, cells coloured by the error, and marks of failures.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.maps.cells import Cell, CellMap, CellResult, MapPlane, leaves
from agglom_mpi.accuracy.maps.plane_map import REFUSED, PlaneMap
from agglom_mpi.accuracy.maps.planes import points
from agglom_mpi.accuracy.maps.scene import Values
from agglom_mpi.accuracy.report import ReportSection, Sentences
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_percent
from agglom_mpi.report.style import COLOURS, PAGE, Drawing, field_map

if TYPE_CHECKING:
    import matplotlib.figure

PANEL_SIZE: Final = (2.2, 1.9)
"""Width and height of a panel, inches."""
LEGEND_ENTRY: Final = 1.35
"""Room for an entry of the legend, inches."""
TROUBLE_STYLES: Final[Mapping[str, tuple[str, str]]] = {
    "overlaps": ("X", COLOURS[1]),
    "budget exhausted": ("s", COLOURS[3]),
    "unsolved impacts": ("^", COLOURS[4]),
    "at the cap": ("v", COLOURS[1]),
    "another root": ("D", COLOURS[3]),
    "inaccurate": ("P", COLOURS[4]),
    "below 0 K": ("d", COLOURS[6]),
    "overshoots": ("^", COLOURS[1]),
    "no place": (">", COLOURS[6]),
    "not finite": ("<", COLOURS[6]),
    "energy not closed": ("h", COLOURS[2]),
}
"""Marker and colour of each kind of trouble, the same in all maps; what is refused is hatched."""
OTHERWISE: Final = ("*", COLOURS[6])
"""Marker and colour of any other kind."""
UNRESOLVED: Final = "0.9"
"""Shade of cells whose error chance may have made."""
HATCHES: Final[Mapping[bool, str]] = {True: "xxxxx", False: "/////"}
"""Hatches of cells that are refused, and of those that may fail for a documented reason."""
POINT_STYLES: Final[Mapping[bool, Mapping[str, Any]]] = {
    False: {"marker": "o", "markersize": 3.5, "markerfacecolor": "white", "markeredgewidth": 0.8},
    True: {"marker": "*", "markersize": 6.0, "markerfacecolor": "#F0E442", "markeredgewidth": 0.6},
}
"""How scenes are marked, and rows of a paper, whose names are like `[A] row 1`."""

METHOD_COLUMNS: Final = (
    Column("method", text=True),
    Column("cells"),
    Column("sound", format=format_percent),
)


def format_largest(error: float) -> str:
    """Return the largest resolved error in percent; a dash where none is resolved."""
    return "–" if math.isnan(error) else format_percent(error)


PLANE_COLUMNS: Final = (
    *METHOD_COLUMNS,
    Column("troubles", "fails by", text=True, format=lambda text: text or "–"),
    Column("sound cells with a resolved error"),
    Column("sound cells", "of sound cells"),
    Column("largest resolved error", "largest", format=format_largest),
)


def map_section(
    found: CellMap,
    sentences: Sentences,
    rows: Sequence[Mapping[str, Any]],
    columns: Sequence[Column],
    of_cell: Callable[[CellResult], Mapping[str, Any]],
    placed: Mapping[str, NDArray[np.float64]] | None = None,
) -> ReportSection:
    """Return the section on a map.

    Parameters
    ----------
    found
        With the results of all levels.
    sentences
        With a block `caption`.
    rows, columns
        The table of methods, and the columns of it that the document shows.
    of_cell
        Returns the columns of the table of cells on a result.
    placed
        Scenes that are marked on the map, by name, (2,); None: it has none.
    """
    plane = found.plane
    sides = plane.x.label, plane.y.label
    cells = [
        {"method": method, "level": cell.level}
        | dict(zip(sides, found.numbers(cell), strict=True))
        | dict(of_cell(result))
        for method, own in found.results.items()
        for cell, result in own.items()
    ]
    name = f"map_{plane.name}"
    tables = [
        Table(columns, rows, "One row is one method.", name),
        Table((), cells, "One row is one cell.", f"{name}_cells"),
    ]
    if placed is not None:
        places = [
            {"scene": scene} | dict(zip(sides, place.tolist(), strict=True))
            for scene, place in placed.items()
        ]
        tables.append(Table((), places, "One row is one scene.", f"{name}_points"))
    figure = Drawing(
        name,
        sentences.paragraph("caption"),
        lambda figure: draw_map(figure, found, placed or {}),
        map_size(len(found.results)),
    )
    return sentences.section(plane.title, [figure], tables)


def plane_section(
    plane_map: PlaneMap,
    scenes: Mapping[str, tuple[SceneSection, Values]],
    lines: Mapping[str, str],
) -> ReportSection:
    """Return the section on one plane.

    Parameters
    ----------
    plane_map
        With the results of all levels.
    scenes
        Scenes that are points on the map, by name, with their variables.
    lines
        Commands that reproduce a failing cell, by method.
    """
    rows, plane = list(method_rows(plane_map, lines)), plane_map.plane
    return map_section(
        plane_map,
        Sentences("maps", plane=plane, size=plane_map.size, rows=rows),
        rows,
        PLANE_COLUMNS,
        lambda result: {
            "mean b/b0": result.growth,
            "relative error": result.error,
            "standard error": result.standard_error,
            "troubles": "; ".join(result.troubles.values()),
            "documented": result.excuse,
        },
        points(plane, scenes),
    )


def area(cells: Collection[Cell], grid: int) -> float:
    """Return the part of a plane that cells cover."""
    return sum(cell.edge(grid) ** 2 for cell in cells)


def method_shares(
    found: CellMap, troubles: str
) -> Iterator[tuple[dict[str, Any], list[CellResult]]]:
    """Yield the columns that all tables of methods have, with the results of sound leaves.

    `troubles` is the column with the part of the plane of each trouble, as text.
    """
    for method, own in found.results.items():
        kinds: dict[str, list[Cell]] = {}
        for cell in leaves(own):
            kinds.setdefault(own[cell].trouble, []).append(cell)
        sound = kinds.pop("", [])
        parts = (
            f"{kind} {format_percent(area(cells, found.grid))}" for kind, cells in kinds.items()
        )
        row = {"method": method, "cells": len(own), "sound": area(sound, found.grid)}
        yield row | {troubles: ", ".join(parts)}, [own[cell] for cell in sound]


def method_rows(plane_map: PlaneMap, lines: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Yield what becomes of the plane by each method; shares are of its area.

    `lines` are commands that reproduce a failing cell, by method.
    """
    for row, sound in method_shares(plane_map, "troubles"):
        method = row["method"]
        own = plane_map.results[method]
        failing = [cell for cell in leaves(own) if own[cell].troubles]
        excused = [cell for cell in failing if own[cell].excuse]
        resolved = [abs(result.error) for result in sound if result.resolved]
        texts = row.pop("troubles")
        yield row | {
            "failing, documented": area(excused, plane_map.grid),
            "failing cells, not documented": len(failing) - len(excused),
            "documented": "; ".join(dict.fromkeys(own[cell].excuse for cell in excused)),
            "troubles": texts,
            "sound cells with a resolved error": len(resolved),
            "sound cells": len(sound),
            "largest resolved error": max(resolved, default=np.nan),
            "reproduced by": lines.get(method, ""),
        }


def map_size(panels: int) -> tuple[float, float]:
    """Return width and height of a figure of some panels, inches."""
    rows, columns = _layout(panels)
    return min(columns * PANEL_SIZE[0] + 1.0, PAGE), rows * PANEL_SIZE[1] + 0.7


def _layout(panels: int) -> tuple[int, int]:
    columns = 2 if panels == 4 else min(panels, 3)
    return math.ceil(panels / columns), columns


def draw_map(
    figure: "matplotlib.figure.Figure",
    found: CellMap,
    points: Mapping[str, NDArray[np.float64]],
) -> Any:
    """Draw a map, and return the axes of its panels, (methods,).

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
    colours = ScalarMappable(LogNorm(*plane.ends), field_map())
    low, high = (np.array([side.value(end) for side in sides]) for end in (0.0, 1.0))
    shown = {n: at for n, at in points.items() if (low <= at).all() and (at <= high).all()}
    panels = [{cell: own[cell] for cell in leaves(own)} for own in results.values()]
    shown_results = [result for cells in panels for result in cells.values()]
    kinds = list(dict.fromkeys(each.trouble for each in shown_results if each.trouble))
    for ax, method, cells in zip(axes.flat, results, panels, strict=False):
        _draw_panel(ax, plane, found.grid, cells, colours)
        ax.set_title(method)
        for name, place in shown.items():
            style = POINT_STYLES[name.startswith("[")]
            ax.plot(*place, **style, c="k", ls="none", mec="black", zorder=4, clip_on=False)
        ax.set(xscale="log", yscale="log", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    for ax in axes.flat[len(results) :]:
        ax.set_visible(False)
    for column in range(columns):  # shared axes have their labels in the last row alone
        axes[(len(results) - 1 - column) // columns, column].tick_params(labelbottom=True)
    figure.supxlabel(sides[0].label)
    figure.supylabel(sides[1].label)
    bar = figure.colorbar(colours, ax=axes, label=plane.error, extend="both", shrink=0.8)
    bar.ax.minorticks_off()
    _add_legend(figure, kinds, shown, {_hatch(each) for each in shown_results})
    return axes.ravel()[: len(results)]


def _draw_panel(
    ax: Any,
    plane: MapPlane,
    grid: int,
    cells: Mapping[Cell, CellResult],
    colours: Any,
) -> None:
    """Draw the cells of a method; all of a kind at once, as single patches take long."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    # Beginning, middle and end of the cells on both axes, shape (2, n, 3).
    places = np.array([[(cell.column, cell.row), (cell.edge(grid),) * 2] for cell in cells])
    ends = (places[:, 0, :, None] + [0.0, 0.5, 1.0]) * places[:, 1, :, None]
    x, y = (side.value(ends[:, i]) for i, side in enumerate((plane.x, plane.y)))
    errors = np.array([plane.shown_error(each) for each in cells.values()])
    shown = np.where(
        np.isnan(errors)[:, None], to_rgba(UNRESOLVED), colours.to_rgba(np.nan_to_num(errors))
    )
    corners: Any = np.stack([x[:, [0, 2, 2, 0]], y[:, [0, 0, 2, 2]]], axis=-1)
    levels = np.array([cell.level for cell in cells])
    hatches = np.array([_hatch(each) for each in cells.values()])
    shown[hatches != ""] = 1.0  # refused, or not to be judged: no error
    widths = np.where(levels == 0, 0.3, 0.0)
    ax.add_collection(
        PolyCollection(corners, facecolors=shown, edgecolors="white", linewidths=widths, zorder=1)
    )
    for hatch in filter(None, np.unique(hatches).tolist()):
        edge: dict[str, Any] = {"facecolors": "none", "edgecolors": "0.4", "linewidths": 0.0}
        ax.add_collection(PolyCollection(corners[hatches == hatch], **edge, hatch=hatch, zorder=3))
    troubles = np.array([each.trouble for each in cells.values()])
    for kind, level in dict.fromkeys(zip(troubles.tolist(), levels.tolist(), strict=True)):
        if kind and kind != REFUSED:
            is_one = (troubles == kind) & (levels == level)
            style = _mark(kind) | {"markersize": 4.0 / 2**level + 0.3}
            ax.plot(x[is_one, 1], y[is_one, 1], **style, zorder=2)


def _hatch(result: CellResult) -> str:
    is_refused = result.trouble == REFUSED
    return HATCHES[is_refused] if is_refused or result.excuse else ""


def _mark(kind: str) -> dict[str, Any]:
    marker, colour = TROUBLE_STYLES.get(kind, OTHERWISE)
    return {"marker": marker, "color": colour, "linestyle": "none", "markeredgewidth": 0.0}


def _add_legend(
    figure: "matplotlib.figure.Figure",
    kinds: Sequence[str],
    points: Mapping[str, Any],
    hatches: Collection[str],
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    marked = [kind for kind in kinds if kind != REFUSED]
    handles: list[Any] = [Line2D([], [], label=kind, **_mark(kind)) for kind in marked]
    handles.append(Patch(facecolor=UNRESOLVED, edgecolor="white", label="error not resolved"))
    for is_refused, label in ((True, REFUSED), (False, "documented")):
        hatch = HATCHES[is_refused]
        if hatch in hatches:
            handles.append(Patch(facecolor="white", edgecolor="0.4", hatch=hatch, label=label))
    for label, published in (("scenes", False), ("rows of the papers", True)):
        if any(name.startswith("[") == published for name in points):
            style = POINT_STYLES[published]
            handles.append(Line2D([], [], ls="none", mec="black", label=label, **style))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=min(int(figure.get_figwidth() / LEGEND_ENTRY), len(handles)),
    )
