"""Maps of impact and cooling laws alone, against their references; they need no samples."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np

from agglom_mpi.accuracy.maps.cells import Axis, CellMap, CellResult, MapPlane, first_cells
from agglom_mpi.accuracy.maps.cooling import (
    Grain,
    euler,
    euler_loop,
    exact,
    exact_loop,
    grain_of,
    linear_limit,
    times_of,
)
from agglom_mpi.accuracy.maps.impacts import (
    Material,
    exact_deficit,
    hardness_of,
    impact_laws,
    solve_all,
    times_of_impact,
)
from agglom_mpi.accuracy.maps.scene import MapScene
from agglom_mpi.accuracy.maps.section import METHOD_COLUMNS, map_section, method_shares
from agglom_mpi.accuracy.report import TIME, ReportSection, Sentences, time_columns
from agglom_mpi.display.table import Column
from agglom_mpi.formatting import format_seconds
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration
from agglom_mpi.stopwatch import TimeSpent

ROOT: Final = "root finder"
ITERATION_CAPS: Final = (10, 100, 1000)
TOLERANCE: Final = 1e-6
"""Tolerance of the published iteration, and error of e up to which an impact counts as solved."""

ELSEWHERE: Final = 100.0
"""Tolerances from the smallest root beyond which an iteration has converged to another one."""

RISE: Final = 1.0
"""Rise of the temperature by a perfectly plastic impact, over the temperature."""

LEAST_TIMED: Final = 2000
"""Minimum number of impacts of a timed loop."""

STIFF: Final = 10.0
"""Length of a run in the map of cooling, over the longest step that is stable at its start."""

EXACT: Final = "exact"
EULER: Final = "Euler steps"


class LawPlane(MapPlane):
    """A plane of a law of a scene, in which each point is computed, without any samples.

    Attributes
    ----------
    of
        What a time is of, such as an `impact`.
    facts
        What the sentences of the section refer to.
    """

    ends = (1e-15, 1.0)
    of: ClassVar[str]
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

    @abstractmethod
    def times(self) -> Mapping[str, list[TimeSpent]]:
        """Return the times that every method takes, in s."""


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
    times, largest = plane.times(), "largest error of a sound cell"
    rows = [
        row
        | {largest: max((result.error for result in sound), default=math.nan)}
        | _loop_columns(plane.of, times[row["method"]])
        for row, sound in method_shares(found, "fails by")
    ]
    columns = (
        *METHOD_COLUMNS,
        Column("fails by", text=True, format=lambda text: text or "–"),
        Column(largest, format=".1e"),
        Column(_time_of(plane.of, TIME), f"processor time per {plane.of}", format=format_seconds),
    )
    return map_section(
        found,
        Sentences("law_maps", plane=plane, rows=rows, **plane.facts),
        rows,
        columns,
        lambda result: {plane.error: result.error, "trouble": result.trouble},
    )


def _time_of(of: str, name: str) -> str:
    return name.replace("sample", of)


def _loop_columns(of: str, times: Sequence[TimeSpent]) -> dict[str, float]:
    """Return the times of timed loops as columns, with the median ratio of their clocks."""
    ratio = float(np.median([spent.wall / spent.cpu for spent in times]))
    columns = time_columns([spent.cpu for spent in times])
    named = {_time_of(of, name): value for name, value in columns.items()}
    return named | {"wall-clock over processor time": ratio}


class ImpactPlane(LawPlane):
    """The impact solvers, with the scene's duration and area of contact."""

    name = "impact"
    title = "Impact solvers"
    x = Axis("impact pressure over that of bonding", -6.0, 1.0)
    y = Axis("activation energy over Rθ", -2.0, math.log10(50.0))
    error = "error of e"
    of = "impact"

    def __init__(self, scene: MapScene) -> None:
        self._mean_speed = scene.section.duration.takes_published_steps
        area = scene.section.contact_area
        self._initial = area.initial / area.final
        self._solvers = impact_solvers()
        self.facts = {
            "mean_speed": self._mean_speed,
            "initial": self._initial,
            "rise": RISE,
            "tolerance": TOLERANCE,
        }

    def _material(self, softening: float) -> Material:
        return Material(self._mean_speed, self._initial, softening, RISE)

    def results(self, x: float, y: float) -> dict[str, CellResult]:
        """Return what becomes of an impact by each solver."""
        return solved_impacts(self._solvers, self._material(y), x)

    def times(self) -> dict[str, list[TimeSpent]]:
        """Return the times of impacts of all speeds below bonding, by solver."""
        material = self._material(1.0)
        hardness = hardness_of(material, np.logspace(-6.0, -0.01, 50))
        return {
            name: times_of_impact(impact_laws(material, solver), hardness, LEAST_TIMED)
            for name, solver in self._solvers.items()
        }


def impact_solvers() -> dict[str, Any]:
    """Return the root finder, and the published iteration with every cap, by name."""
    solvers: dict[str, Any] = {ROOT: BracketedRoot.Numbers()}
    for cap in ITERATION_CAPS:
        solvers[f"published, cap {cap}"] = FixedPointIteration.Numbers(TOLERANCE, cap)
    return solvers


def solved_impacts(
    solvers: Mapping[str, Any], material: Material, x: float
) -> dict[str, CellResult]:
    """Return what becomes of one impact by each solver; `x` as in `impacts`."""
    reference, bonded = exact_deficit(material, x), x >= 1.0
    hardness = hardness_of(material, np.array([x]))
    results = {}
    for name, solver in solvers.items():
        found = solve_all(impact_laws(material, solver), hardness)
        deficit, bonds, capped = (part[0] for part in found)
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
    of = "step"

    def __init__(self, scene: MapScene) -> None:
        built = scene.section.build(scene.values)
        self._grain = grain_of(built)
        self._base = self._grain.rest if self._grain.rest > 0.0 else max(built.temperature, 1.0)
        self.facts = {"grain": self._grain, "scene": built, "stiff": STIFF}

    def results(self, x: float, y: float) -> dict[str, CellResult]:
        """Return what becomes of a grain by each way to cool it."""
        return cooled_grain(self._grain, self._base * (1.0 + y), x)

    def times(self) -> dict[str, list[TimeSpent]]:
        """Return the times of steps from twice the temperature of rest."""
        start = 2.0 * self._base
        limit = linear_limit(self._grain, start)
        return {
            EXACT: times_of(exact_loop, self._grain, start, limit),
            EULER: times_of(euler_loop, self._grain, start, 1e-3 * limit),
        }


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
