"""Maps of impact and cooling laws alone, against their references; they need no samples."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Final

from agglom_mpi.accuracy.maps.cells import Axis, CellMap, CellResult, MapPlane, first_cells
from agglom_mpi.accuracy.maps.law_references import (
    PAIR,
    Grain,
    Material,
    euler,
    exact,
    exact_deficit,
    grain_of,
    impact_laws,
    linear_limit,
    solve_impact,
)
from agglom_mpi.accuracy.maps.scene import MapScene
from agglom_mpi.accuracy.maps.section import METHOD_COLUMNS, map_section, method_shares
from agglom_mpi.accuracy.report import ReportSection, Sentences
from agglom_mpi.display.table import Column
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration

ROOT: Final = "root finder"
ITERATION_CAPS: Final = (10, 100, 1000)
TOLERANCE: Final = 1e-6
"""Tolerance of the published iteration, and error of e up to which an impact counts as solved."""

ELSEWHERE: Final = 100.0
"""Tolerances from the smallest root beyond which an iteration has converged to another one."""

RISE: Final = 1.0
"""Rise of the temperature by a perfectly plastic impact, over the temperature."""

STIFF: Final = 10.0
"""Length of a run in the map of cooling, over the longest step that is stable at its start."""

EXACT: Final = "exact"
EULER: Final = "Euler steps"


class LawPlane(MapPlane):
    """A plane of a law of a scene, in which each point is computed, without any samples.

    Attributes
    ----------
    facts
        What the sentences of the section refer to.
    """

    ends = (1e-15, 1.0)
    facts: Mapping[str, Any]

    def shown_error(self, result: CellResult) -> float:
        """Return the magnitude of the error, at least that at the end of the scale."""
        return max(result.error, self.ends[0])

    @abstractmethod
    def __init__(self, scene: MapScene) -> None:
        """Take what the map needs of a scene."""

    @abstractmethod
    def results(self, x: float, y: float) -> Mapping[str, CellResult]:
        """Return what becomes of a point by every method."""


def law_section(plane: LawPlane, quick: bool = False) -> ReportSection:
    """Return the section on a law, of cells that are refined at every method's edge of soundness.

    `quick` is whether to have few cells.
    """
    found = CellMap(plane, 8 if quick else 12)
    cells = first_cells(found.grid)
    for level in range(2 if quick else 3):
        if level:
            cells = list(dict.fromkeys(c for own in found.refined(level).values() for c in own))
        for cell in cells:
            for method, result in plane.results(*found.numbers(cell)).items():
                found.results.setdefault(method, {})[cell] = result
    largest = "largest error of a sound cell"
    rows = [
        row | {largest: max((result.error for result in sound), default=math.nan)}
        for row, sound in method_shares(found, "fails by")
    ]
    columns = (
        *METHOD_COLUMNS,
        Column("fails by", text=True, format=lambda text: text or "–"),
        Column(largest, format=".1e"),
    )
    return map_section(
        found,
        Sentences("law_maps", plane=plane, rows=rows, **plane.facts),
        rows,
        columns,
        lambda result: {plane.error: result.error, "trouble": result.trouble},
    )


class ImpactPlane(LawPlane):
    """The impact solvers, with the scene's duration and area of contact."""

    name = "impact"
    title = "Impact solvers"
    x = Axis("impact pressure over that of bonding", -6.0, 1.0)
    y = Axis("activation energy over Rθ", -2.0, math.log10(50.0))
    error = "error of e"

    def __init__(self, scene: MapScene) -> None:
        self._mean_speed = scene.section.duration.takes_published_steps
        area = scene.section.contact_area
        self._initial = area.initial / area.final
        self.facts = {
            "mean_speed": self._mean_speed,
            "initial": self._initial,
            "rise": RISE,
            "tolerance": TOLERANCE,
        }

    def results(self, x: float, y: float) -> dict[str, CellResult]:
        """Return what becomes of an impact by each solver."""
        return solved_impacts(Material(self._mean_speed, self._initial, y, RISE), x)


IMPACT_SOLVERS: Final[Mapping[str, Any]] = {
    ROOT: BracketedRoot.Numbers(),
    **{
        f"published, cap {cap}": FixedPointIteration.Numbers(TOLERANCE, cap)
        for cap in ITERATION_CAPS
    },
}
"""The root finder, and the published iteration with every cap, by name."""


def solved_impacts(material: Material, x: float) -> dict[str, CellResult]:
    """Return what becomes of one impact by each solver; `x` as in `law_references`."""
    reference, bonded = exact_deficit(material, x), x >= 1.0
    results = {}
    for name, solver in IMPACT_SOLVERS.items():
        deficit, bonds, capped = solve_impact(impact_laws(material, solver, x), PAIR)
        error = abs(float(deficit) - reference)
        trouble = ""
        if bonds != bonded:
            trouble = "wrongly bonded or not"
        elif not bonded and error > TOLERANCE:
            elsewhere = error > ELSEWHERE * TOLERANCE
            trouble = "at the cap" if capped else "another root" if elsewhere else "inaccurate"
        error = 0.0 if bonded and bonds else error
        results[name] = CellResult({trouble: trouble} if trouble else {}, error)
    return results


class CoolingPlane(LawPlane):
    """The scene's cooling law; [B]'s radiation where it has none."""

    name = "cooling"
    title = "Cooling of a grain"
    x = Axis("step over the estimated limit", -3.0, 2.0)
    y = Axis("excess temperature over that of rest", -2.0, 3.0)
    error = "relative error of θ"

    def __init__(self, scene: MapScene) -> None:
        built = scene.section.build(scene.values)
        self._grain = grain_of(built)
        self._base = self._grain.rest if self._grain.rest > 0.0 else max(built.temperature, 1.0)
        self.facts = {"grain": self._grain, "scene": built, "stiff": STIFF}

    def results(self, x: float, y: float) -> dict[str, CellResult]:
        """Return what becomes of a grain by each way to cool it."""
        return cooled_grain(self._grain, self._base * (1.0 + y), x)


def cooled_grain(grain: Grain, start: float, step: float) -> dict[str, CellResult]:
    """Return what becomes of a grain from `start` in K by steps over their estimated limit."""
    limit = linear_limit(grain, start)
    steps = max(1, math.ceil(STIFF / step))
    size = step * limit
    reference = exact(grain, start, steps * size)
    again = exact(grain, start, steps * size, steps)
    found = euler(grain, start, size, steps)
    wrong = "below 0 K" if found.negative else "overshoots" if found.overshoots else ""
    off = abs(found.temperature / reference - 1.0)
    return {
        EXACT: CellResult({}, abs(again / reference - 1.0)),
        EULER: CellResult({wrong: wrong} if wrong else {}, off),
    }


LAW_PLANES: Final[Mapping[str, type[LawPlane]]] = {
    plane.name: plane for plane in (ImpactPlane, CoolingPlane)
}
"""Planes of laws by name, in the order of a report."""
