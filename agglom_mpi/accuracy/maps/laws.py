"""Maps of impact and cooling laws alone, against their references; they need no samples."""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from agglom_mpi.accuracy.maps.cells import CellMap, CellResult, first_cells
from agglom_mpi.accuracy.maps.cooling import Grain, euler, exact, grain_of, linear_limit
from agglom_mpi.accuracy.maps.figure import Axis
from agglom_mpi.accuracy.maps.impacts import (
    Material,
    exact_deficit,
    hardness_of,
    impact_laws,
    solve_all,
)
from agglom_mpi.accuracy.maps.scene import MapScene
from agglom_mpi.accuracy.report import ReportSection, Sentences
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

ROUNDING: Final = (1e-15, 1.0)
"""Ends of the scale of errors, from rounding on."""

EXACT: Final = "exact"
EULER: Final = "Euler steps"


def law_section(
    found: CellMap,
    evaluate: Callable[[float, float], Mapping[str, CellResult]],
    quick: bool,
    **values: Any,
) -> ReportSection:
    """Return the section on a law, of cells that are refined at every method's edge of soundness.

    Parameters
    ----------
    found
        The map, without cells.
    evaluate
        Returns what becomes of a point of the plane by every method.
    quick
        Whether to have few cells.
    values
        What the sentences refer to.
    """
    cells = first_cells(found.grid)
    for level in range(2 if quick else 3):
        if level:
            cells = list(dict.fromkeys(c for own in found.refined(level).values() for c in own))
        for cell in cells:
            for method, result in evaluate(*found.numbers(cell)).items():
                found.results.setdefault(method, {})[cell] = result
    rows = list(found.rows({}))
    sentences = Sentences(
        "law_maps", law=found.name, title=found.title, error=found.error, rows=rows, **values
    )
    return found.section(sentences, rows, {})


def impact_map(scene: MapScene, quick: bool = False) -> ReportSection:
    """Return the map of the impact solvers, with the scene's duration and area of contact."""
    mean_speed = scene.section.duration.takes_published_steps
    initial = scene.section.contact_area.initial / scene.section.contact_area.final
    solvers = impact_solvers()
    sides = (
        Axis("impact pressure over that of bonding", -6.0, 1.0),
        Axis("activation energy over Rθ", -2.0, math.log10(50.0)),
    )
    grid = 8 if quick else 12
    return law_section(
        CellMap("impact", "Impact solvers", sides, grid, "error of e", ROUNDING),
        lambda x, y: solved_impacts(solvers, Material(mean_speed, initial, y, RISE), x),
        quick,
        initial=initial,
        mean_speed=mean_speed,
        rise=RISE,
        tolerance=TOLERANCE,
    )


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
        results[name] = CellResult({trouble: trouble} if trouble else {}, error, 0.0)
    return results


def cooling_map(scene: MapScene, quick: bool = False) -> ReportSection:
    """Return the map of the scene's cooling law; [B]'s radiation where it has none."""
    built = scene.section.build(scene.values)
    grain = grain_of(built)
    base = grain.rest if grain.rest > 0.0 else max(built.temperature, 1.0)
    sides = (
        Axis("step over the estimated limit", -3.0, 2.0),
        Axis("excess temperature over that of rest", -2.0, 3.0),
    )
    grid = 8 if quick else 12
    return law_section(
        CellMap("cooling", "Cooling of a grain", sides, grid, "relative error of θ", ROUNDING),
        lambda x, y: cooled_grain(grain, base * (1.0 + y), x),
        quick,
        grain=grain,
        scene=built,
        stiff=STIFF,
    )


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
        EXACT: CellResult({}, abs(again / reference - 1.0), 0.0),
        EULER: CellResult({wrong: wrong} if wrong else {}, off, 0.0),
    }


LAW_MAPS: Final[Mapping[str, Callable[[MapScene, bool], ReportSection]]] = {
    "impact": impact_map,
    "cooling": cooling_map,
}
"""Maps of laws by name, in the order of a report."""
