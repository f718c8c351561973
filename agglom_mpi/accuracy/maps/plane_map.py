"""Stability maps of a scene: cells of planes by every method, refined at the edge of soundness."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.accuracy.maps.cells import Cell, CellMap, CellResult, first_cells, leaves
from agglom_mpi.accuracy.maps.planes import DEFAULT, Plane
from agglom_mpi.accuracy.maps.scene import MapScene
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
from agglom_mpi.config.yaml_source import CampaignError, Problem

REFUSED: Final = "refused"
"""Kind of trouble of a scene that is refused before anything is simulated."""

COLLAPSE: Final = "inelastic collapse without a contact time"
"""Documented reason why an event engine without contact time may exhaust its budget."""


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


class PlaneMap(CellMap):
    """The cells of one plane by every method, level by level.

    Parameters
    ----------
    plane, scene, size
        What is mapped, and how finely.
    """

    plane: Plane

    def __init__(self, plane: Plane, scene: MapScene, size: MapSize) -> None:
        super().__init__(plane, size.grid)
        self.size = size
        self._scene = scene
        self._campaigns: dict[Cell, dict[str, Campaign] | str] = {}

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
        if level == 0:
            first = first_cells(self.grid)
            found = [self._methods(cell) for cell in first]
            known = next((methods for methods in found if not isinstance(methods, str)), None)
            if known is None:
                problem = Problem(self._scene.centre.name, None, self.plane.name, str(found[0]))
                raise CampaignError(problem)
            return dict.fromkeys(known, first)
        chosen = self.refined(level)
        every = list(dict.fromkeys(cell for cells in chosen.values() for cell in cells))
        everywhere = [name for name in (DEFAULT, self.plane.remedy) if name in chosen]
        return chosen | (dict.fromkeys(everywhere, every) if every else {})

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
            default, remedy = (self.results[name][cell] for name in (DEFAULT, self.plane.remedy))
            if list(default.troubles) == [EXHAUSTED] and remedy.sound:
                self.results[DEFAULT][cell] = default._replace(excuse=COLLAPSE)

    def failing_cell(self, method: str) -> Cell | None:
        """Return the cell that shows best how a method fails, of those that are not refused.

        One without an excuse comes first, then the most serious trouble, then the finest level.
        """
        results = self.results[method]
        failing = [cell for cell in leaves(results) if results[cell].trouble in KINDS]

        def telling(cell: Cell) -> tuple[bool, int, int]:
            found = results[cell]
            return not found.excuse, -KINDS.index(found.trouble), cell.level

        return max(failing, key=telling, default=None)

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
            excuse = self.plane.refusal_excuse(*self.numbers(cell))
            return CellResult({REFUSED: text}, excuse=excuse)
        own, event = summary(rows), summary(reference)
        wrong = troubles(own, heaped_overlaps(event))
        kinds = {kind: wrong[kind] for kind in KINDS if kind in wrong}
        growth = own["mean b/b0"]
        if is_default:
            campaign = self.campaign(cell, DEFAULT)
            if list(kinds) == [OVERLAPS] and campaign is not None:
                allowed = overlaps_part(campaign, range(self.size.samples))
                kinds = {} if allowed else kinds
            return CellResult(kinds, growth=growth)
        spread = float(np.hypot(own["standard error"], event["standard error"]))
        exact = event["mean b/b0"]
        return CellResult(kinds, growth / exact - 1.0, spread / exact, growth)
