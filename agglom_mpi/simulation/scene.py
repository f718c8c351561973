"""A scene as kernels see it, and the interface of an engine."""

from typing import NamedTuple

import numpy as np

from agglom_mpi.kernels import Submodel, dispatch, dispatch_allocating
from agglom_mpi.physics.restitution import ImpactLaws
from agglom_mpi.simulation.particles import Ledger, Particles


class FixedSteps(NamedTuple):
    """`steps` equal time steps over the run  [A]."""

    steps: int


class AdaptiveSteps(NamedTuple):
    """Steps of the smallest gap over approach speed within [floor, ceiling] in s  [B 6.14]."""

    floor: float
    ceiling: float


class EventDriven(NamedTuple):
    """Collisions at exact times; at most `budget` events per grain, cell crossings included."""

    budget: int


class Scene(NamedTuple):
    """All that one sample is a function of, apart from its random numbers.

    `particles` equal grains of `radius` in m and `mass` in kg in a cube of half-width
    `half_width` in m, for `end_time` in s from `temperature` in K.
    """

    escape: Submodel
    velocities: Submodel
    laws: ImpactLaws
    cooling: Submodel | None
    engine: Submodel
    particles: int
    half_width: float
    radius: float
    mass: float
    temperature: float
    end_time: float


@dispatch_allocating
def run_to_end(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    ledger: Ledger,
    abort: np.ndarray,
    recorder: Submodel | None,
) -> float:
    """Run a placed scene to its end time, or until `abort[0]` is set; return the time reached in s.

    Frames that a `recorder` has to take between start and end are taken on the way.
    """


@dispatch_allocating
def initialize(engine: Submodel, scene: Submodel, particles: Particles) -> Submodel:
    """Return the state that an engine keeps beside particles at the time 0, for `advance_to`."""


@dispatch_allocating
def advance_to(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    ledger: Ledger,
    engine_state: Submodel,
    until: float,
    abort: np.ndarray,
) -> float:
    """Process what happens up to `until` in s, as `run_to_end` does; return the time reached in s.

    The particles are not moved to `until`, so that the number of parts a run is done in does not
    change a bit of it; `copy_at` gives where they are.
    """


@dispatch
def copy_at(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    engine_state: Submodel,
    recorder: Submodel,
    time: float,
) -> None:
    """Copy the particles, and move the copies to where they are at `time` in s."""
