"""A map of two numbers: its axes, its cells by every method, their shares, and its section.

Cells are squares of the unit square, refined where a value changes. Those of level l have the edge
1/(grid·2^l). A cell with children is no leaf; the leaves cover the square.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.maps.figure import Axis, MapPanel, draw_map, map_size
from agglom_mpi.accuracy.report import ReportSection, Sentences
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_percent
from agglom_mpi.report.drawing import Drawing

RESOLVED: Final = 2.0
"""Standard errors beyond which a difference from the event engine counts."""


class Cell(NamedTuple):
    """A square of the map: its level, and its column and row from the lower left at that level."""

    level: int
    column: int
    row: int

    def edge(self, grid: int) -> float:
        """Return the length of its edge; `grid` is the number of cells of level 0 along a side."""
        return float(1.0 / (grid * 2**self.level))

    def centre(self, grid: int) -> tuple[float, float]:
        """Return its centre in the unit square."""
        edge = self.edge(grid)
        return (self.column + 0.5) * edge, (self.row + 0.5) * edge

    def children(self) -> list["Cell"]:
        """Return the four cells of the next level that cover it."""
        corners = ((0, 0), (1, 0), (0, 1), (1, 1))
        level, column, row = self.level + 1, 2 * self.column, 2 * self.row
        return [Cell(level, column + right, row + up) for right, up in corners]


def first_cells(grid: int) -> list[Cell]:
    """Return the cells of level 0, row by row."""
    return [Cell(0, column, row) for row in range(grid) for column in range(grid)]


def leaves(cells: Collection[Cell]) -> list[Cell]:
    """Return those of some cells whose children are not among them."""
    known = set(cells)
    return [cell for cell in cells if cell.children()[0] not in known]


def edge_cells(values: Mapping[Cell, bool], grid: int, level: int) -> Iterator[Cell]:
    """Yield the leaves of a level that have a side in common with a leaf of another value.

    Parameters
    ----------
    values
        Value of every cell of the map so far; its leaves cover the square.
    grid
        Number of cells of level 0 along a side.
    level
        Level of the cells that may be refined.
    """
    kept = leaves(values)
    finest = max(cell.level for cell in kept)
    side = grid * 2**finest
    owner = np.zeros((side, side), np.int64)
    for number, cell in enumerate(kept):
        width = 2 ** (finest - cell.level)
        rows = slice(cell.row * width, (cell.row + 1) * width)
        owner[rows, cell.column * width : (cell.column + 1) * width] = number
    value = np.array([values[cell] for cell in kept])[owner]
    differs = np.zeros((side, side), np.bool_)
    beside, above = value[:, 1:] != value[:, :-1], value[1:] != value[:-1]
    differs[:, 1:] |= beside
    differs[:, :-1] |= beside
    differs[1:] |= above
    differs[:-1] |= above
    for number in np.unique(owner[differs]).tolist():
        if kept[number].level == level:
            yield kept[number]


class CellResult(NamedTuple):
    """A method in a cell.

    Attributes
    ----------
    troubles
        What is wrong, by kind, the most serious first; empty if the method is sound.
    error, standard_error
        Relative to the reference of the map.
    growth
        Mean b/b0, where samples are simulated.
    excuse
        Documented reason why it may fail; empty if there is none.
    """

    troubles: Mapping[str, str]
    error: float = np.nan
    standard_error: float = np.nan
    growth: float = np.nan
    excuse: str = ""

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong."""
        return not self.troubles

    @property
    def trouble(self) -> str:
        """The most serious kind of trouble; empty if nothing is wrong."""
        return next(iter(self.troubles), "")

    @property
    def resolved(self) -> bool:
        """Whether the error is larger than what chance makes it."""
        return bool(abs(self.error) > RESOLVED * self.standard_error)


class CellMap:
    """Cells of a plane by every method.

    Attributes
    ----------
    name, title
        As a command line and a report name it.
    x, y
        Its axes.
    grid
        Number of cells of level 0 along a side.
    results
        Of each method, the default one first, its cells.
    error, ends
        Label and ends of the scale of the errors.
    """

    def __init__(
        self,
        name: str,
        title: str,
        sides: tuple[Axis, Axis],
        grid: int,
        error: str = "relative error of mean b/b⁰",
        ends: tuple[float, float] = (1e-3, 1.0),
    ) -> None:
        self.name, self.title, self.grid = name, title, grid
        self.x, self.y = sides
        self.error, self.ends = error, ends
        self.results: dict[str, dict[Cell, CellResult]] = {}

    def numbers(self, cell: Cell) -> tuple[float, float]:
        """Return the two numbers at the centre of a cell."""
        across, up = cell.centre(self.grid)
        return self.x.value(across), self.y.value(up)

    def refined(self, level: int) -> dict[str, list[Cell]]:
        """Return the cells of a level at the edges of each method's soundness."""
        return {
            method: [
                child
                for cell in edge_cells(
                    {cell: result.sound for cell, result in own.items()}, self.grid, level - 1
                )
                for child in cell.children()
            ]
            for method, own in self.results.items()
        }

    def area(self, cells: Collection[Cell]) -> float:
        """Return the part of the plane that cells cover."""
        return sum(cell.edge(self.grid) ** 2 for cell in cells)

    def rows(self, lines: Mapping[str, str]) -> Iterator[dict[str, Any]]:
        """Yield what becomes of the plane by each method; shares are of its area.

        `lines` are commands that reproduce a failing cell, by method.
        """
        for method, own in self.results.items():
            kept = leaves(own)
            kinds: dict[str, list[Cell]] = {}
            for cell in kept:
                kinds.setdefault(own[cell].trouble, []).append(cell)
            sound = kinds.pop("", [])
            failing = [cell for cells in kinds.values() for cell in cells]
            excused = [cell for cell in kept if own[cell].troubles and own[cell].excuse]
            resolved = [abs(own[cell].error) for cell in sound if own[cell].resolved]
            parts = (f"{kind} {format_percent(self.area(each))}" for kind, each in kinds.items())
            yield {
                "method": method,
                "cells": len(own),
                "sound": self.area(sound),
                "failing, documented": self.area(excused),
                "failing cells, not documented": len(failing) - len(excused),
                "documented": "; ".join(dict.fromkeys(own[cell].excuse for cell in excused)),
                "troubles": ", ".join(parts),
                "sound cells with a resolved error": len(resolved),
                "sound cells": len(sound),
                "largest resolved error": max(resolved, default=np.nan),
                "reproduced by": lines.get(method, ""),
            }

    def section(
        self,
        sentences: Sentences,
        rows: list[dict[str, Any]],
        points: Mapping[str, NDArray[np.float64]],
    ) -> ReportSection:
        """Return the section of the report.

        Parameters
        ----------
        sentences
            With a block `caption`.
        rows
            Those of `rows`, which the sentences refer to.
        points
            Scenes that are marked on the map, by name, (2,).
        """
        cells = [
            {
                "method": method,
                "level": cell.level,
                **dict(zip((self.x.label, self.y.label), self.numbers(cell), strict=True)),
                "mean b/b0": result.growth,
                self.error: result.error,
                "standard error": result.standard_error,
                "troubles": "; ".join(result.troubles.values()),
                "documented": result.excuse,
            }
            for method, own in self.results.items()
            for cell, result in own.items()
        ]
        name = f"map_{self.name}"
        tables = [
            Table(METHOD_COLUMNS, rows, "One row is one method.", name),
            Table((), cells, "One row is one cell.", f"{name}_cells"),
        ]
        if points:
            scenes = [
                {"scene": scene, self.x.label: float(across), self.y.label: float(up)}
                for scene, (across, up) in points.items()
            ]
            tables.append(Table((), scenes, "One row is one scene.", f"{name}_points"))
        panels = [self._panel(method) for method in self.results]
        figure = Drawing(
            name,
            sentences.paragraph("caption"),
            lambda figure: draw_map(
                figure, (self.x, self.y), panels, points, self.error, self.ends
            ),
            map_size(len(panels)),
        )
        return sentences.section(self.title, [figure], tables)

    def _panel(self, method: str) -> MapPanel:
        """Return what the figure shows of a method."""
        own, squares = self.results[method], []
        kept = leaves(own)
        for cell in kept:
            edge = cell.edge(self.grid)
            x = [self.x.value((cell.column + i) * edge) for i in (0, 0.5, 1)]
            y = [self.y.value((cell.row + i) * edge) for i in (0, 0.5, 1)]
            squares.append([x, y])
        return MapPanel(
            method,
            np.array(squares).reshape(-1, 2, 3),
            np.array([cell.level for cell in kept]),
            np.array([abs(own[cell].error) if own[cell].resolved else np.nan for cell in kept]),
            [own[cell].trouble for cell in kept],
            np.array([bool(own[cell].excuse) for cell in kept]),
        )


METHOD_COLUMNS: Final = (
    Column("method", text=True),
    Column("cells"),
    Column("sound", format=format_percent),
    Column("troubles", "fails by", text=True),
    Column("sound cells with a resolved error"),
    Column("sound cells", "of sound cells"),
    Column("largest resolved error", "largest", format=lambda error: f"{100.0 * error:.2g} %"),
)
