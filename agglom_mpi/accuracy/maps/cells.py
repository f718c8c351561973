"""A map of two numbers: its axes, its cells, and what becomes of a method in one.

Cells are squares of the unit square, refined where a value changes. Those of level l have the edge
1/(grid·2^l). A cell with children is no leaf; the leaves cover the square.
"""

from abc import ABC
from collections.abc import Collection, Iterator, Mapping
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np

RESOLVED: Final = 2.0
"""Standard errors beyond which a difference from the event engine counts."""


class Axis(NamedTuple):
    """An axis of a map: its label, and the decimal logarithms of its ends."""

    label: str
    low: float
    high: float

    def value(self, share: Any) -> Any:
        """Return the number at a share of the axis, 0 to 1, or those at an array of shares."""
        return 10.0 ** (self.low + share * (self.high - self.low))


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


class MapPlane(ABC):
    """Two numbers that a map varies, and how it shows errors.

    Attributes
    ----------
    name, title
        As a command line and a report name it.
    x, y
        Its axes.
    error, ends
        Label and ends of the scale of the errors.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    x: ClassVar[Axis]
    y: ClassVar[Axis]
    error: ClassVar[str] = "relative error of mean b/b⁰"
    ends: ClassVar[tuple[float, float]] = (1e-3, 1.0)

    def shown_error(self, result: CellResult) -> float:
        """Return the magnitude of a resolved error; nan where there is none to show."""
        return abs(result.error) if result.resolved else np.nan


class CellMap:
    """The cells of a plane by every method.

    Parameters
    ----------
    plane
        What is mapped.
    grid
        Number of cells of level 0 along a side.

    Attributes
    ----------
    results
        Of each method, the default one first, its cells.
    """

    def __init__(self, plane: MapPlane, grid: int) -> None:
        self.plane, self.grid = plane, grid
        self.results: dict[str, dict[Cell, CellResult]] = {}

    def numbers(self, cell: Cell) -> tuple[float, float]:
        """Return the two numbers at the centre of a cell."""
        across, up = cell.centre(self.grid)
        return self.plane.x.value(across), self.plane.y.value(up)

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
