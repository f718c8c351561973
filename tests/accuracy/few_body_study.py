"""Engines against exact trajectories: error and run time of each case, engine and step."""

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from few_body_reference import (
    END_TIME,
    FRICTION,
    HALF_WIDTH,
    LONGEST_DELAY,
    MASS,
    RADIUS,
    SPEED,
    FewBodyCase,
    Floats,
    InitialStates,
    exact_end,
    hardness,
    initial_states,
)
from numpy.typing import ArrayLike, NDArray

import agglom_mpi.simulation.event_driven.engine
import agglom_mpi.simulation.time_driven.steppers  # noqa: F401  (all register their engines)
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.hardness import ConstantHardness
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    ImpactLaws,
    PressureRestitution,
)
from agglom_mpi.physics.velocities import UniformX
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import AdaptiveSteps, EventDriven, FixedSteps
from agglom_mpi.simulation.particles import (
    new_ledger,
    new_particles,
    position_of,
    set_position,
    set_velocity,
    velocity_of,
)
from agglom_mpi.simulation.reference_frame import to_box_frame, to_mass_frame
from agglom_mpi.simulation.scene import Scene, new_engine_state, run_to_end
from agglom_mpi.statistics import mean_of

if TYPE_CHECKING:
    import pandas as pd

EDGE: Final = 2.0 * HALF_WIDTH

CEILING: Final = 1e-3
"""Longest step of the adaptive engine in s, as published [B 6.14]."""

BUDGET: Final = 20_000

ROUNDING: Final = 1e-12
"""Errors below this are no part of a fit: the step does not decide them."""


class FinalStates(NamedTuple):
    """States at the end of every run.

    Attributes
    ----------
    position, velocity
        Of the particles left, in the order of their slots, shape (runs, 3, grains), m and m/s.
    left
        Particles left, shape (runs,).
    """

    position: Floats
    velocity: Floats
    left: NDArray[np.int64]


@inlined
def vector(values, i):
    """Column i of an array of shape (3, count), as three components."""
    return values[0, i], values[1, i], values[2, i]


@inlined
def set_vector(values, i, components):
    """Set column i of an array of shape (3, count)."""
    values[0, i], values[1, i], values[2, i] = components


@kernel
def run_batch(scene, grains, particles, engine_state, ledger, position, velocity, abort, left):
    """Run the engine of a scene from each state, which the end replaces; see `InitialStates`.

    `grains` are the particles of the scene not placed yet, `particles` as many to work on.
    """
    for run in range(position.shape[0]):
        particles.size[0] = grains.size[0]
        for i in range(grains.size[0]):
            particles.records[i] = grains.records[i]
            particle = particles.records[i]
            set_position(particle, vector(position[run], i))
            set_velocity(particle, vector(velocity[run], i))
        drift = to_mass_frame(scene, particles)
        end = run_to_end(scene, particles, ledger, engine_state, abort)
        to_box_frame(scene, particles, drift, end)
        for i in range(particles.size[0]):
            particle = particles.records[i]
            set_vector(position[run], i, position_of(particle))
            set_vector(velocity[run], i, velocity_of(particle))
        left[run] = particles.size[0]


def run_all(scene: Scene, starts: InitialStates) -> FinalStates:
    """Run a scene without fragmentation from all starts."""
    position, velocity = starts.position.copy(), starts.velocity.copy()
    left = np.zeros(len(position), np.int64)
    abort = np.zeros(1, np.uint8)
    count = scene.particles
    grains, particles = new_particles(scene, count), new_particles(scene, count)
    state = grains, particles, new_engine_state(scene.engine, scene, count), new_ledger()
    run_batch(scene, *state, position, velocity, abort, left)
    return FinalStates(position, velocity, left)


def scene_of(case: FewBodyCase, engine: Any) -> Scene:
    """Return the scene of a case; constant restitution and pressure law give one type each."""
    value = case.restitution
    constant = value is not None
    laws = ImpactLaws(
        restitution=PressureRestitution.Numbers()
        if value is None
        else ConstantRestitution.Numbers(value),
        duration=None if constant else CompressionRecoveryDuration.Numbers(1.0),
        contact_area=ContactArea.Numbers(0.0, 1.0),
        hardness=None if constant else ConstantHardness.Numbers(hardness()),
        friction=ConstantFriction.Numbers(FRICTION) if constant else None,
        heating=None,
        reaction=None,
        fragmentation=None,
        solver=None if constant else BracketedRoot.Numbers(),
        heat_capacity=math.inf,
    )
    return Scene(
        escape=Periodic.Numbers(),
        velocities=UniformX.Numbers(0.0),
        laws=laws,
        cooling=None,
        engine=engine,
        particles=len(case.position),
        half_width=HALF_WIDTH,
        radius=RADIUS,
        mass=MASS,
        temperature=300.0,
        end_time=END_TIME,
    )


class ConvergenceOrder(NamedTuple):
    """Order of convergence, error ∝ step^order, and its standard error."""

    order: float
    standard_error: float


def convergence_order(
    steps: ArrayLike, errors: ArrayLike, standard_errors: ArrayLike
) -> ConvergenceOrder:
    """Return the slope of a straight line through the logarithms of mean errors.

    All points weigh the same. The order's standard error is the larger of two: from the points'
    own standard errors, and from their scatter about the line, which also holds what averaging
    does not remove.

    Parameters
    ----------
    steps, errors, standard_errors
        Positive, the last not negative, shape (points,), at least 3 points.
    """
    x, y = np.log(np.asarray(steps, float)), np.log(np.asarray(errors, float))
    own = np.asarray(standard_errors, float) / np.asarray(errors, float)
    away = x - np.mean(x)
    spread = float(np.sum(away**2))
    order = float(np.sum(away * y)) / spread
    scatter = float(np.sum((y - np.mean(y) - order * away) ** 2)) / (len(x) - 2)
    variance = max(scatter / spread, float(np.sum((away * own) ** 2)) / spread**2)
    return ConvergenceOrder(order, math.sqrt(variance))


class StudySettings(NamedTuple):
    """Numbers of fixed steps, shortest adaptive steps in s, and runs with each of them."""

    steps: tuple[int, ...]
    floors: tuple[float, ...]
    runs: int


FULL: Final = StudySettings(
    (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000),
    (1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8),
    128,
)


def engines(settings: StudySettings) -> list[tuple[str, float, Any]]:
    """Return name, step in s and engine of each engine to run; the event engine's step is nan."""
    return [
        ("event", math.nan, EventDriven.Numbers(BUDGET)),
        *(("fixed", END_TIME / steps, FixedSteps.Numbers(steps)) for steps in settings.steps),
        *(("adaptive", floor, AdaptiveSteps.Numbers(floor, CEILING)) for floor in settings.floors),
    ]


def study(
    cases: list[FewBodyCase], settings: StudySettings, random: np.random.Generator
) -> "pd.DataFrame":
    """Run every case with every engine and step; one row each."""
    import pandas as pd

    return pd.DataFrame(
        [
            {"scene": case.name, "engine": name, "step (s)": step}
            | measure(case, engine, random.uniform(0.0, LONGEST_DELAY, settings.runs))
            for case in cases
            for name, step, engine in engines(settings)
        ]
    )


def measure(case: FewBodyCase, engine: Any, delays: Floats) -> dict[str, float]:
    """Compare the ends of one case with the exact ones, from starts delayed by `delays` in s."""
    starts = initial_states(case, delays)
    ends = run_all(scene_of(case, engine), starts)
    position, velocity = [], []
    for run in range(len(delays)):
        r, v = exact_end(case, starts, run)
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
        order, standard_error = convergence_order(
            step, error, good[f"{what} error, standard error"]
        )
    return {
        f"{what}, order": order,
        f"{what}, order, standard error": standard_error,
        f"{what}, error over step (1/s)": float((error / step).median()),
    }


def _length(vectors: Any) -> float:
    """Root mean square length of vectors, shape (3, spheres)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=0))))
