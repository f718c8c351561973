"""Engines against exact trajectories: error and seconds of each scene, engine and step."""

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.accuracy.batch import run_all
from agglom_mpi.accuracy.convergence import fit_power
from agglom_mpi.accuracy.few_scenes import (
    END_TIME,
    HALF_WIDTH,
    LONGEST_DELAY,
    SPEED,
    FewBodies,
    Floats,
    exact_end,
    scene_of,
    starts_of,
)
from agglom_mpi.simulation.scene import AdaptiveSteps, EventDriven, FixedSteps
from agglom_mpi.statistics import mean_of

if TYPE_CHECKING:
    import pandas as pd

EDGE: Final = 2.0 * HALF_WIDTH

CEILING: Final = 1e-3
"""Longest step of the adaptive engine in s, as published [B 6.14]."""

BUDGET: Final = 20_000

ROUNDING: Final = 1e-12
"""Errors below this are no part of a fit: the step does not decide them."""


class Knobs(NamedTuple):
    """What is varied: numbers of fixed steps, shortest adaptive steps in s; runs at each."""

    steps: tuple[int, ...]
    floors: tuple[float, ...]
    runs: int


FULL: Final = Knobs(
    (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000),
    (1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8),
    128,
)
QUICK: Final = Knobs((50, 200, 1000, 5000), (1e-4, 1e-5, 1e-6, 1e-7), 32)


def settings(knobs: Knobs) -> list[tuple[str, float, Any]]:
    """Return engines with their names and steps in s; the event engine has none, nan."""
    return [
        ("event", math.nan, EventDriven(BUDGET)),
        *(("fixed", END_TIME / steps, FixedSteps(steps)) for steps in knobs.steps),
        *(("adaptive", floor, AdaptiveSteps(floor, CEILING)) for floor in knobs.floors),
    ]


def study(scenes: list[FewBodies], knobs: Knobs, random: np.random.Generator) -> "pd.DataFrame":
    """Run every scene with every engine and step; one row each."""
    import pandas as pd

    return pd.DataFrame(
        [
            {"scene": bodies.name, "engine": name, "step (s)": step}
            | measure(bodies, engine, random.uniform(0.0, LONGEST_DELAY, knobs.runs))
            for bodies in scenes
            for name, step, engine in settings(knobs)
        ]
    )


def measure(bodies: FewBodies, engine: Any, delays: Floats) -> dict[str, float]:
    """Run one scene from starts delayed by `delays` in s and compare with the exact ends."""
    starts = starts_of(bodies, delays)
    ends = run_all(scene_of(bodies, engine), starts)
    position, velocity = [], []
    for run in range(len(delays)):
        r, v = exact_end(bodies, starts, run)
        left = r.shape[1]
        if ends.left[run] == left:
            apart = ends.position[run][:, :left] - r
            position.append(_length(apart - EDGE * np.round(apart / EDGE)) / EDGE)
            velocity.append(_length(ends.velocity[run][:, :left] - v) / SPEED)
    error, speed_error = mean_of(position), mean_of(velocity)
    return {
        "runs": len(delays),
        "other bonds": len(delays) - len(position),
        "position error": error.value,
        "position error, standard error": error.error,
        "position error, largest": max(position, default=math.nan),
        "velocity error": speed_error.value,
        "velocity error, standard error": speed_error.error,
        "velocity error, largest": max(velocity, default=math.nan),
        "seconds per run (s)": ends.seconds,
    }


def orders(frame: "pd.DataFrame") -> "pd.DataFrame":
    """Fit the order of convergence of each stepper in each scene, of positions and velocities."""
    import pandas as pd

    steppers = frame[frame["engine"] != "event"]
    return pd.DataFrame(
        [
            {"scene": scene, "engine": engine} | _fit("position", rows) | _fit("velocity", rows)
            for (scene, engine), rows in steppers.groupby(["scene", "engine"], sort=False)
        ]
    )


def _fit(what: str, rows: "pd.DataFrame") -> dict[str, float]:
    """Fit the order of one error, nan where the step does not decide it."""
    good = rows[rows[f"{what} error"] > ROUNDING]
    error, step = good[f"{what} error"], good["step (s)"]
    order, standard_error = math.nan, math.nan
    if len(good) >= 3:
        order, standard_error = fit_power(step, error, good[f"{what} error, standard error"])
    return {
        f"{what}, order": order,
        f"{what}, order, standard error": standard_error,
        f"{what}, error over step (1/s)": float((error / step).median()),
    }


def _length(vectors: Any) -> float:
    """Root mean square length of vectors, shape (3, spheres)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=0))))
