"""The section of a report on a map: its figure, and the shares of the plane by method."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.maps.cells import Cell, CellMap, CellResult, leaves
from agglom_mpi.accuracy.maps.figure import draw_map, map_size
from agglom_mpi.accuracy.maps.plane_map import PlaneMap
from agglom_mpi.accuracy.maps.planes import points
from agglom_mpi.accuracy.maps.scene import Values
from agglom_mpi.accuracy.report import ReportSection, Sentences
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_percent
from agglom_mpi.report.drawing import Drawing

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
