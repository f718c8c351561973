"""A scene as kernels see it, and the interface of an engine."""

from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import Submodel, dispatch, dispatch_allocating, inlined, law_of
from agglom_mpi.physics.restitution import ImpactLaws
from agglom_mpi.physics.rough import SpinningFriction
from agglom_mpi.simulation.particles import Ledger, Particles


class Scene(NamedTuple):
    """All that one sample is a function of, apart from its random numbers.

    `particles` grains of `radius` in m and `mass` in kg in a cube of half-width `half_width` in m,
    for `end_time` in s from `temperature` in K. By a law `sizes` that is the mean radius, and the
    mass of a grain of it; once they are placed it is True. None: all are equal.
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
    sizes: Submodel | None = None

    @property
    def has_temperature(self) -> bool:
        """Whether grains have a temperature; where no law needs one it is 0 K in all kernels."""
        return self.temperature > 0.0 or self.laws.heating is not None or self.cooling is not None

    @property
    def has_spins(self) -> bool:
        """Whether grains spin."""
        friction = self.laws.friction
        return friction is not None and issubclass(law_of(friction), SpinningFriction)


@dispatch
def new_engine_state(engine: Submodel, scene: Submodel, capacity: int) -> Submodel:
    """Return what an engine keeps beside particles, with room for `capacity` of them.

    Called from Python, so that kernels make no arrays of it.
    """


@dispatch_allocating
def begin(engine: Submodel, scene: Submodel, particles: Particles, engine_state: Submodel) -> None:
    """Begin a run of the particles at the time 0."""


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
    """Process what happens up to `until` in s, or until `abort[0]` is set.

    The particles are not moved to `until`, so that the number of parts a run is done in does not
    change a bit of it; `copy_at` gives where they are. Returns the time reached in s.
    """


@dispatch
def finish(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    ledger: Ledger,
    engine_state: Submodel,
    time: float,
) -> None:
    """Move the particles to `time` in s, up to which the run has come, and close their gaps."""


@dispatch
def copy_at(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    engine_state: Submodel,
    observer: Submodel,
    time: float,
) -> None:
    """Copy the particles, and move the copies to where they are at `time` in s."""


@inlined
def run_to_end(scene, particles, ledger, engine_state, abort):
    """Run particles from where they are to the scene's end; return the time reached in s."""
    begin(scene.engine, scene, particles, engine_state)
    time = advance_to(scene.engine, scene, particles, ledger, engine_state, scene.end_time, abort)
    finish(scene.engine, scene, particles, ledger, engine_state, time)
    return time


@inlined
def is_aborted(abort):
    """Whether the run was asked to stop."""
    return abort[0] != np.uint8(0)
