"""Tables of a map: what becomes of the plane by each method, and every cell."""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from agglom_mpi.accuracy.document import TableColumn
from agglom_mpi.accuracy.planes import Axis
from agglom_mpi.accuracy.quadtree import Cell, leaves
from agglom_mpi.formatting import format_percent

if TYPE_CHECKING:
    import pandas as pd

R = TypeVar("R")


class Shares(NamedTuple):
    """Parts of the plane in which one method is sound, and in which it fails.

    Attributes
    ----------
    sound, failing
        The leaves without and with a trouble.
    sound_area
        Part of the plane in which nothing is wrong.
    troubles
        Part of the plane of each trouble, as text.
    """

    sound: list[Cell]
    failing: list[Cell]
    sound_area: float
    troubles: str


def shares_of(troubles: Mapping[Cell, str], grid: int) -> Shares:
    """Return the shares of a map.

    Parameters
    ----------
    troubles
        The most serious trouble in each cell; empty where nothing is wrong.
    grid
        Number of cells of level 0 along a side.
    """
    kept = leaves(troubles)
    sound = [cell for cell in kept if not troubles[cell]]
    failing = [cell for cell in kept if troubles[cell]]
    kinds: dict[str, float] = {}
    for cell in failing:
        kinds[troubles[cell]] = kinds.get(troubles[cell], 0.0) + area_of(cell, grid)
    texts = (f"{kind} {format_percent(area)}" for kind, area in kinds.items())
    area = sum(area_of(cell, grid) for cell in sound)
    return Shares(sound, failing, area, ", ".join(texts))


def area_of(cell: Cell, grid: int) -> float:
    """Return the part of the plane that a cell covers."""
    return cell.edge(grid) ** 2


def first_columns(troubles: str) -> tuple[TableColumn, ...]:
    """Return the columns that tables of methods have in common.

    Parameters
    ----------
    troubles
        Key of the text on troubles in a row.
    """
    return (
        TableColumn("method", lambda row: row["method"]),
        TableColumn("cells", lambda row: f"{row['cells']}"),
        TableColumn("sound", lambda row: format_percent(row["sound"])),
        TableColumn("fails by", lambda row: row[troubles] or "–"),
    )


def cell_table(
    results: Mapping[str, Mapping[Cell, R]],
    axes: tuple[Axis, Axis],
    grid: int,
    columns: Callable[[R], Mapping[str, Any]],
) -> "pd.DataFrame":
    """Return every cell by every method, with its place in the plane and some columns.

    Parameters
    ----------
    results
        Of each method, its cells.
    axes
        Those across and up.
    grid
        Number of cells of level 0 along a side.
    columns
        Returns the columns on a result.
    """
    import pandas as pd

    def rows() -> Iterator[dict[str, Any]]:
        for method, own in results.items():
            for cell, result in own.items():
                centre = zip(axes, cell.centre(grid), strict=True)
                place = {axis.label: axis.value(share) for axis, share in centre}
                yield {"method": method, "level": cell.level, **place, **columns(result)}

    return pd.DataFrame(list(rows()))
