"""The section of a report on a map: its figure, and the shares of the plane by method."""

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Any, Final

import numpy as np

from agglom_mpi.accuracy.maps.cells import Cell, leaves
from agglom_mpi.accuracy.maps.figure import draw_map, map_size
from agglom_mpi.accuracy.maps.plane_map import PlaneMap
from agglom_mpi.accuracy.maps.planes import points
from agglom_mpi.accuracy.maps.scene import Values
from agglom_mpi.accuracy.report import ReportSection, Sentences
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_percent
from agglom_mpi.report.drawing import Drawing


def format_largest(error: float) -> str:
    """Return the largest resolved error in percent; a dash where none is resolved."""
    return "–" if math.isnan(error) else format_percent(error)


METHOD_COLUMNS: Final = (
    Column("method", text=True),
    Column("cells"),
    Column("sound", format=format_percent),
    Column("troubles", "fails by", text=True),
    Column("sound cells with a resolved error"),
    Column("sound cells", "of sound cells"),
    Column("largest resolved error", "largest", format=format_largest),
)


def map_section(
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
    sentences = Sentences("maps", plane=plane, size=plane_map.size, rows=rows)
    cells = [
        {
            "method": method,
            "level": cell.level,
            **dict(zip((plane.x.label, plane.y.label), plane_map.numbers(cell), strict=True)),
            "mean b/b0": result.growth,
            "relative error": result.error,
            "standard error": result.standard_error,
            "troubles": "; ".join(result.troubles.values()),
            "documented": result.excuse,
        }
        for method, own in plane_map.results.items()
        for cell, result in own.items()
    ]
    placed = points(plane, scenes)
    places = [
        {"scene": scene, plane.x.label: float(across), plane.y.label: float(up)}
        for scene, (across, up) in placed.items()
    ]
    name = f"map_{plane.name}"
    tables = [
        Table(METHOD_COLUMNS, rows, "One row is one method.", name),
        Table((), cells, "One row is one cell.", f"{name}_cells"),
        Table((), places, "One row is one scene.", f"{name}_points"),
    ]
    figure = Drawing(
        name,
        sentences.paragraph("caption"),
        lambda figure: draw_map(
            figure, (plane.x, plane.y), plane_map.size.grid, plane_map.results, placed
        ),
        map_size(len(plane_map.results)),
    )
    return sentences.section(plane.title, [figure], tables)


def method_rows(plane_map: PlaneMap, lines: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Yield what becomes of the plane by each method; shares are of its area.

    `lines` are commands that reproduce a failing cell, by method.
    """

    def area(cells: Collection[Cell]) -> float:
        return sum(cell.edge(plane_map.size.grid) ** 2 for cell in cells)

    for method, own in plane_map.results.items():
        kept = leaves(own)
        kinds: dict[str, list[Cell]] = {}
        for cell in kept:
            kinds.setdefault(own[cell].trouble, []).append(cell)
        sound = kinds.pop("", [])
        failing = [cell for cells in kinds.values() for cell in cells]
        excused = [cell for cell in kept if own[cell].troubles and own[cell].excuse]
        resolved = [abs(own[cell].error) for cell in sound if own[cell].resolved]
        parts = (f"{kind} {format_percent(area(each))}" for kind, each in kinds.items())
        yield {
            "method": method,
            "cells": len(own),
            "sound": area(sound),
            "failing, documented": area(excused),
            "failing cells, not documented": len(failing) - len(excused),
            "documented": "; ".join(dict.fromkeys(own[cell].excuse for cell in excused)),
            "troubles": ", ".join(parts),
            "sound cells with a resolved error": len(resolved),
            "sound cells": len(sound),
            "largest resolved error": max(resolved, default=np.nan),
            "reproduced by": lines.get(method, ""),
        }
