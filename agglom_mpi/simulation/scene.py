"""A scene as kernels see it, and the interface of an engine."""

from typing import NamedTuple

import numpy as np

from agglom_mpi.kernels import Submodel, dispatch, dispatch_allocating
from agglom_mpi.physics.restitution import (
    ImpactLaws,
)
from agglom_mpi.simulation.particles import Ledger, Particles


class FixedSteps(NamedTuple):
    """`steps` equal time steps over the run  [A]."""

    steps: int


class AdaptiveSteps(NamedTuple):
    """Steps of the smallest gap over approach speed within [floor, ceiling], s  [B 6.14]."""

    floor: float
    ceiling: float


class EventDriven(NamedTuple):
    """Exact times; at most `budget` events per grain, crossings of cells included."""

    budget: int


class Scene(NamedTuple):
    """Everything that one sample is a function of, random numbers aside.

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
    """Run a placed scene to its end time, or until `abort[0]` is set; the time reached in s.

    What a `recorder` wants to see between start and end is taken on the way.
    """


@dispatch_allocating
def initialize(engine: Submodel, scene: Submodel, particles: Particles) -> Submodel:
    """Return what an engine keeps beside particles that start at the time 0, for `advance_to`."""


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
    """Let happen what happens up to `until` in s, as `run_to_end` does; the time reached in s.

    Nothing is brought to an end there, so that in how many stretches a run is done does not change
    a bit of it; `copy_at` says where the particles are.
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
