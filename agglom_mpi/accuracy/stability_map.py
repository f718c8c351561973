"""Stability maps of a scene: cells of planes by every method, refined at the edge of soundness."""

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.accuracy.document import ReportSection, ReportTable, Sentences, TableColumn
from agglom_mpi.accuracy.map_figure import MapPanel, draw_map, map_size
from agglom_mpi.accuracy.map_scene import MapScene
from agglom_mpi.accuracy.map_tables import area_of, cell_table, first_columns, shares_of
from agglom_mpi.accuracy.planes import DEFAULT, Plane, Values, points
from agglom_mpi.accuracy.quadtree import Cell, edge_cells, first_cells, leaves
from agglom_mpi.accuracy.soundness import (
    EXHAUSTED,
    KINDS,
    OVERLAPS,
    heaped_overlaps,
    overlaps_part,
    summary,
    troubles,
)
from agglom_mpi.accuracy.study import Rows, Setup, scene_error
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import format_percent
from agglom_mpi.report.drawing import Drawing

if TYPE_CHECKING:
    import pandas as pd

REFUSED: Final = "refused"
"""Kind of trouble of a scene that is refused before anything is simulated."""

RESOLVED: Final = 2.0
"""Standard errors beyond which a difference from the event engine counts."""


class MapSize(NamedTuple):
    """How fine a map is.

    Attributes
    ----------
    grid
        Cells along a side at first.
    levels
        Number of levels of cells; each halves the edge of those of the one before.
    samples
        Random starts of each cell and method.
    grains
        Maximum number of grains.
    budget
        Events per grain that the event engine may take.
    quick
        Whether to leave out the finer steps.
    """

    grid: int
    levels: int
    samples: int
    grains: int
    budget: int
    quick: bool


QUICK: Final = MapSize(grid=4, levels=2, samples=4, grains=40, budget=2000, quick=True)
FULL: Final = MapSize(grid=6, levels=3, samples=5, grains=100, budget=3000, quick=False)

COLLAPSE: Final = "inelastic collapse without a contact time"
"""Documented reason why an event engine without contact time may exhaust its budget."""


class CellResult(NamedTuple):
    """A method in a cell.

    Attributes
    ----------
    troubles
        What is wrong, by kind; empty if the method is sound.
    growth
        Mean b/b0.
    error, standard_error
        Growth relative to that of the event engine, less 1.
    excuse
        Documented reason why it may fail; empty if there is none.
    """

    troubles: Mapping[str, str]
    growth: float = np.nan
    error: float = np.nan
    standard_error: float = np.nan
    excuse: str = ""

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong."""
        return not self.troubles

    @property
    def resolved(self) -> bool:
        """Whether the error is larger than what chance makes it."""
        return bool(abs(self.error) > RESOLVED * self.standard_error)


class PlaneMap:
    """The cells of one plane by every method, level by level.

    Parameters
    ----------
    plane, scene, size
        What is mapped, and how finely.

    Attributes
    ----------
    results
        Of each method, the default one first, its cells.
    """

    def __init__(self, plane: Plane, scene: MapScene, size: MapSize) -> None:
        self.plane = plane
        self.size = size
        self.results: dict[str, dict[Cell, CellResult]] = {}
        self._scene = scene
        self._campaigns: dict[Cell, dict[str, Campaign] | str] = {}

    def numbers(self, cell: Cell) -> tuple[float, float]:
        """Return the two numbers at the centre of a cell."""
        across, up = cell.centre(self.size.grid)
        return self.plane.x.value(across), self.plane.y.value(up)

    def campaign(self, cell: Cell, method: str) -> Campaign | None:
        """Return the scene of a cell by a method; None if it is refused."""
        found = self._methods(cell)
        return None if isinstance(found, str) else found[method]

    def cells(self, level: int) -> dict[str, list[Cell]]:
        """Return the cells of a level to simulate, by method: all, or those at an edge.

        The default method and its remedy take those of all others, too.

        Raises
        ------
        CampaignError
            If every cell is refused.
        """
        grid = self.size.grid
        if level == 0:
            first = first_cells(grid)
            found = [self._methods(cell) for cell in first]
            known = next((methods for methods in found if not isinstance(methods, str)), None)
            if known is None:
                raise CampaignError(Problem(self._scene.name, None, self.plane.name, str(found[0])))
            return dict.fromkeys(known, first)
        chosen = {
            method: [
                child
                for cell in edge_cells(
                    {cell: result.sound for cell, result in results.items()}, grid, level - 1
                )
                for child in cell.children()
            ]
            for method, results in self.results.items()
        }
        every = list(dict.fromkeys(cell for cells in chosen.values() for cell in cells))
        return chosen | (
            {name: every for name in self._everywhere if name in chosen} if every else {}
        )

    @property
    def _everywhere(self) -> tuple[str, ...]:
        """Methods that every cell is simulated by: the default one, and its remedy."""
        return DEFAULT, self.plane.remedy

    def setups(self, level: int) -> dict[str, Setup]:
        """Return what to simulate at a level, by name."""
        chosen = {}
        for method, cells in self.cells(level).items():
            for cell in cells:
                campaign = self.campaign(cell, method)
                if campaign is not None:
                    setup = Setup(campaign, campaign.parameters(), self.size.samples)
                    if not scene_error(setup):
                        chosen[self._name(method, cell)] = setup
        return chosen

    def take(self, level: int, samples: Mapping[str, Rows]) -> None:
        """Take the samples of the set-ups of a level."""
        chosen = self.cells(level)
        for method, cells in chosen.items():
            for cell in cells:
                rows = samples.get(self._name(method, cell))
                reference = samples.get(self._name(DEFAULT, cell))
                result = self._result(cell, rows, reference, method == DEFAULT)
                self.results.setdefault(method, {})[cell] = result
        for cell in chosen.get(self.plane.remedy, []):
            default = self.results[DEFAULT][cell]
            if (
                list(default.troubles) == [EXHAUSTED]
                and self.results[self.plane.remedy][cell].sound
            ):
                self.results[DEFAULT][cell] = default._replace(excuse=COLLAPSE)

    def panels(self) -> list[MapPanel]:
        """Return what the figure shows of each method."""
        return [
            MapPanel(
                method,
                {cell: _shown_error(results[cell]) for cell in leaves(results)},
                {cell: next(iter(results[cell].troubles), "") for cell in leaves(results)},
                frozenset(cell for cell in results if results[cell].excuse),
            )
            for method, results in self.results.items()
        ]

    def failing_cell(self, method: str) -> Cell | None:
        """Return the cell that shows best how a method fails, of those that are not refused.

        One without an excuse comes first, then the most serious trouble, then the finest level.
        """
        results = self.results[method]
        failing = [cell for cell in leaves(results) if results[cell].troubles]
        failing = [cell for cell in failing if REFUSED not in results[cell].troubles]

        def telling(cell: Cell) -> tuple[bool, int, int]:
            found = results[cell]
            return not found.excuse, -KINDS.index(next(iter(found.troubles))), cell.level

        return max(failing, key=telling, default=None)

    def _overlaps_part(self, cell: Cell) -> bool:
        """Return whether the default method leaves overlaps in a cell that the model allows."""
        campaign = self.campaign(cell, DEFAULT)
        return campaign is not None and overlaps_part(campaign, range(self.size.samples))

    def _name(self, method: str, cell: Cell) -> str:
        return f"{self.plane.name}, {method}, cell {cell.level} {cell.column} {cell.row}"

    def _methods(self, cell: Cell) -> dict[str, Campaign] | str:
        """Return the scene of a cell by every method, or why it is refused."""
        if cell not in self._campaigns:
            x, y = self.numbers(cell)
            try:
                campaign = self.plane.campaign(self._scene, x, y)
                self._campaigns[cell] = dict(self.plane.methods(campaign, y, self.size.quick))
            except CampaignError as error:
                self._campaigns[cell] = str(error)
        return self._campaigns[cell]

    def _result(
        self, cell: Cell, rows: Rows | None, reference: Rows | None, is_default: bool
    ) -> CellResult:
        """Return what the samples of a cell say; those of the default method are the reference."""
        if rows is None or reference is None:
            found = self._methods(cell)
            text = found if isinstance(found, str) else "the scene cannot be simulated"
            return CellResult(
                {REFUSED: text}, excuse=self.plane.refusal_excuse(*self.numbers(cell))
            )
        own, event = summary(rows), summary(reference)
        wrong = troubles(own, heaped_overlaps(event))
        kinds = {kind: wrong[kind] for kind in KINDS if kind in wrong}
        growth = own["mean b/b0"]
        if is_default:
            allowed = list(kinds) == [OVERLAPS] and self._overlaps_part(cell)
            return CellResult({} if allowed else kinds, growth)
        spread = float(np.hypot(own["standard error"], event["standard error"]))
        exact = event["mean b/b0"]
        return CellResult(kinds, growth, growth / exact - 1.0, spread / exact)


def _shown_error(result: CellResult) -> float:
    """Return the magnitude of a resolved error; nan where there is none to show."""
    return abs(result.error) if result.resolved else np.nan


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
    import pandas as pd

    plane, size = plane_map.plane, plane_map.size
    frame = pd.DataFrame(list(_method_rows(plane_map, lines)))
    placed = points(plane, scenes)
    sentences = Sentences("maps", plane=plane, size=size, rows=[row for _, row in frame.iterrows()])
    panels = plane_map.panels()
    return sentences.section(
        title=plane.title,
        figures=(
            Drawing(
                f"map_{plane.name}",
                sentences.paragraph("caption"),
                lambda figure: draw_map(figure, plane.x, plane.y, panels, placed, size.grid),
                map_size(len(panels)),
            ),
        ),
        tables=(
            ReportTable(f"map_{plane.name}", "One row is one method.", frame, COLUMNS),
            ReportTable(f"map_{plane.name}_cells", "One row is one cell.", _cells(plane_map)),
            ReportTable(
                f"map_{plane.name}_points",
                "One row is one scene.",
                pd.DataFrame(
                    [[name, *place] for name, place in placed.items()],
                    columns=["scene", plane.x.label, plane.y.label],
                ),
            ),
        ),
    )


def _method_rows(plane_map: PlaneMap, lines: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Yield what becomes of the plane by each method; shares are of its area."""
    for method, results in plane_map.results.items():
        kinds = {cell: next(iter(result.troubles), "") for cell, result in results.items()}
        found = shares_of(kinds, plane_map.size.grid)
        excused = [cell for cell in found.failing if results[cell].excuse]
        resolved = [abs(results[cell].error) for cell in found.sound if results[cell].resolved]
        yield {
            "method": method,
            "cells": len(results),
            "sound": found.sound_area,
            "failing, documented": sum(area_of(cell, plane_map.size.grid) for cell in excused),
            "failing cells, not documented": len(found.failing) - len(excused),
            "documented": "; ".join(dict.fromkeys(results[cell].excuse for cell in excused)),
            "troubles": found.troubles,
            "sound cells with a resolved error": len(resolved),
            "sound cells": len(found.sound),
            "largest resolved error": max(resolved, default=np.nan),
            "reproduced by": lines.get(method, ""),
        }


COLUMNS: Final = (
    *first_columns("troubles"),
    TableColumn(
        "sound cells with a resolved error",
        lambda row: (
            "–"
            if row["method"] == DEFAULT
            else f"{row['sound cells with a resolved error']} of {row['sound cells']}"
        ),
    ),
    TableColumn(
        "largest",
        lambda row: (
            "–"
            if np.isnan(row["largest resolved error"])
            else format_percent(row["largest resolved error"])
        ),
    ),
)


def _cells(plane_map: PlaneMap) -> "pd.DataFrame":
    """Return every cell by every method."""
    axes = plane_map.plane.x, plane_map.plane.y
    return cell_table(
        plane_map.results,
        axes,
        plane_map.size.grid,
        lambda result: {
            "mean b/b0": result.growth,
            "relative error": result.error,
            "standard error": result.standard_error,
            "troubles": "; ".join(result.troubles.values()),
            "documented": result.excuse,
        },
    )


def slug(method: str) -> str:
    """Return a method's name as part of a file's."""
    return re.sub(r"[^a-z0-9]+", "_", method.lower()).strip("_")
