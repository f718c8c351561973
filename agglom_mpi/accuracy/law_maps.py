"""Maps of impact and cooling laws alone, against their references; they need no samples."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.accuracy.cooling_methods import (
    Grain,
    euler,
    exact,
    grain_of,
    linear_limit,
    times_of_exact,
    times_per_step,
)
from agglom_mpi.accuracy.document import ReportSection, ReportTable, Sentences, TableColumn
from agglom_mpi.accuracy.impact_methods import hardness_of, impact_laws, solve_all, time_of_impact
from agglom_mpi.accuracy.impact_reference import Exact, Material, exact_impact
from agglom_mpi.accuracy.map_figure import MapPanel, draw_map, map_size
from agglom_mpi.accuracy.map_scene import MapScene
from agglom_mpi.accuracy.map_tables import cell_table, first_columns, shares_of
from agglom_mpi.accuracy.planes import Axis
from agglom_mpi.accuracy.quadtree import Cell, edge_cells, first_cells, leaves
from agglom_mpi.accuracy.run_times import WALL_OVER_CPU, ratio_of_clocks, time_columns, time_name
from agglom_mpi.formatting import format_seconds
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration
from agglom_mpi.report.drawing import Drawing

if TYPE_CHECKING:
    import pandas as pd

ROOT: Final = "root finder"
CAPS: Final = (10, 100, 1000)
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
ERRORS: Final = (1e-15, 1.0)
"""Ends of the scale of errors of laws."""


class LawResult(NamedTuple):
    """A method in a cell: its error, and what is wrong; empty if nothing is."""

    error: float
    trouble: str


Evaluate = Callable[[float, float], Mapping[str, LawResult]]
"""Returns what becomes of a point of the plane by every method."""


class LawMap(NamedTuple):
    """A map of a law: its axes, its cells by every method, and the cells along a side at first."""

    x: Axis
    y: Axis
    results: Mapping[str, Mapping[Cell, LawResult]]
    grid: int


def refined(x: Axis, y: Axis, evaluate: Evaluate, grid: int, levels: int) -> LawMap:
    """Return a map whose cells are refined at every method's edge of soundness."""
    results: dict[str, dict[Cell, LawResult]] = {}
    cells = first_cells(grid)
    for level in range(levels):
        for cell in cells:
            across, up = cell.centre(grid)
            for method, result in evaluate(x.value(across), y.value(up)).items():
                results.setdefault(method, {})[cell] = result
        sound = [
            {cell: not found.trouble for cell, found in own.items()} for own in results.values()
        ]
        edges = [edge for own in sound for edge in edge_cells(own, grid, level)]
        cells = [child for edge in dict.fromkeys(edges) for child in edge.children()]
    return LawMap(x, y, results, grid)


def impact_map(scene: MapScene, quick: bool = False) -> ReportSection:
    """Return the map of the impact solvers, with the scene's duration and area of contact."""
    mean_speed = scene.section.duration.takes_published_steps
    initial = scene.section.contact_area.initial / scene.section.contact_area.final
    solvers = dict(impact_solvers())
    found = refined(
        Axis("impact pressure over that of bonding", -6.0, 1.0),
        Axis("activation energy over Rθ", -2.0, math.log10(50.0)),
        lambda x, y: solved_impacts(solvers, Material(mean_speed, initial, y, RISE), x),
        *_fineness(quick),
    )
    material = Material(mean_speed, initial, 1.0, RISE)
    hardness = hardness_of(material, np.logspace(-6.0, -0.01, 50))
    times = {
        name: time_of_impact(impact_laws(material, solver), hardness, LEAST_TIMED)
        for name, solver in solvers.items()
    }
    sentences = {"initial": initial, "mean_speed": mean_speed, "rise": RISE, "tolerance": TOLERANCE}
    return _section("impact", "Impact solvers", found, times, "impact", "error of e", sentences)


def impact_solvers() -> Iterator[tuple[str, Any]]:
    """Yield the root finder, and the published iteration with every cap, by name."""
    yield ROOT, BracketedRoot.Numbers()
    for cap in CAPS:
        yield f"published, cap {cap}", FixedPointIteration.Numbers(TOLERANCE, cap)


def solved_impacts(
    solvers: Mapping[str, Any], material: Material, x: float
) -> dict[str, LawResult]:
    """Return what becomes of one impact by each solver; `x` as in `impact_reference`."""
    reference = exact_impact(material, x)
    hardness = hardness_of(material, np.array([x]))
    results = {}
    for name, solver in solvers.items():
        deficit, bonds, capped = (
            part[0] for part in solve_all(impact_laws(material, solver), hardness)
        )
        error = abs(float(deficit) - reference.deficit)
        trouble = _impact_trouble(reference, error, bool(bonds), bool(capped))
        results[name] = LawResult(0.0 if reference.bonds and bonds else error, trouble)
    return results


def _impact_trouble(reference: Exact, error: float, bonds: bool, capped: bool) -> str:
    """Return what is wrong with a solution; empty if nothing is."""
    if bonds != reference.bonds:
        return "wrongly bonded or not"
    if reference.bonds or error <= TOLERANCE:
        return ""
    if capped:
        return "at the cap"
    return "another root" if error > ELSEWHERE * TOLERANCE else "inaccurate"


def cooling_map(scene: MapScene, quick: bool = False) -> ReportSection:
    """Return the map of the scene's cooling law; [B]'s radiation where it has none."""
    built = scene.section.build(scene.values)
    grain = grain_of(built)
    base = grain.rest if grain.rest > 0.0 else max(built.temperature, 1.0)
    found = refined(
        Axis("step over the estimated limit", -3.0, 2.0),
        Axis("excess temperature over that of rest", -2.0, 3.0),
        lambda x, y: cooled_grain(grain, base * (1.0 + y), x),
        *_fineness(quick),
    )
    start = 2.0 * base
    limit = linear_limit(grain, start)
    step, whole = times_per_step(grain, start, 1e-3 * limit), times_of_exact(grain, start, limit)
    times = {
        method: time_columns("step", [spent.cpu for spent in spent_in])
        | {WALL_OVER_CPU: ratio_of_clocks(spent_in)}
        for method, spent_in in ((EXACT, whole), (EULER, step))
    }
    sentences = {"grain": grain, "scene": built, "stiff": STIFF}
    label = "relative error of θ"
    return _section("cooling", "Cooling of a grain", found, times, "step", label, sentences)


def cooled_grain(grain: Grain, start: float, step: float) -> dict[str, LawResult]:
    """Return what becomes of a grain from `start` in K by steps over their estimated limit."""
    limit = linear_limit(grain, start)
    steps = max(1, math.ceil(STIFF / step))
    size = step * limit
    reference = exact(grain, start, steps * size)
    again = exact(grain, start, steps * size, steps)
    found = euler(grain, start, size, steps)
    wrong = "below 0 K" if found.negative else "overshoots" if found.overshoots else ""
    return {
        EXACT: LawResult(abs(again / reference - 1.0), ""),
        EULER: LawResult(abs(found.temperature / reference - 1.0), wrong),
    }


def _fineness(quick: bool) -> tuple[int, int]:
    """Return the cells along a side at first, and the number of levels."""
    return (8, 2) if quick else (12, 3)


def _section(
    name: str,
    title: str,
    found: LawMap,
    times: Mapping[str, Mapping[str, float]],
    timed: str,
    error: str,
    values: Mapping[str, Any],
) -> ReportSection:
    """Return the section on a law."""
    import pandas as pd

    frame = pd.DataFrame(list(_method_rows(found, times)))
    sentences = Sentences(
        "law_maps",
        law=name,
        title=title,
        rows=[row for _, row in frame.iterrows()],
        error=error,
        **values,
    )
    panels = [
        MapPanel(
            method,
            {cell: max(own[cell].error, ERRORS[0]) for cell in leaves(own)},
            {cell: own[cell].trouble for cell in leaves(own)},
        )
        for method, own in found.results.items()
    ]
    return sentences.section(
        title=title,
        figures=(
            Drawing(
                f"map_{name}",
                sentences.paragraph("caption"),
                lambda figure: draw_map(
                    figure, found.x, found.y, panels, {}, found.grid, error, ERRORS
                ),
                map_size(len(panels)),
            ),
        ),
        tables=(
            ReportTable(f"map_{name}", "One row is one method.", frame, _columns(timed)),
            ReportTable(f"map_{name}_cells", "One row is one cell.", _cells(found, error)),
        ),
    )


def _method_rows(
    found: LawMap, times: Mapping[str, Mapping[str, float]]
) -> Iterator[dict[str, Any]]:
    """Yield what becomes of the plane by each method; shares are of its area."""
    for method, own in found.results.items():
        shares = shares_of({cell: result.trouble for cell, result in own.items()}, found.grid)
        yield {
            "method": method,
            "cells": len(own),
            "sound": shares.sound_area,
            "fails by": shares.troubles,
            "largest error of a sound cell": max(
                (own[cell].error for cell in shares.sound), default=math.nan
            ),
            **times[method],
        }


def _columns(timed: str) -> tuple[TableColumn, ...]:
    return (
        *first_columns("fails by"),
        TableColumn.number("largest error of a sound cell", ".1e"),
        TableColumn(
            f"processor time per {timed}", lambda row: format_seconds(row[time_name(timed)])
        ),
    )


def _cells(found: LawMap, error: str) -> "pd.DataFrame":
    """Return every cell by every method."""
    return cell_table(
        found.results,
        (found.x, found.y),
        found.grid,
        lambda result: {error: result.error, "trouble": result.trouble},
    )


LAW_MAPS: Final[Mapping[str, Callable[[MapScene, bool], ReportSection]]] = {
    "impact": impact_map,
    "cooling": cooling_map,
}
"""Maps of laws by name, in the order of a report."""
