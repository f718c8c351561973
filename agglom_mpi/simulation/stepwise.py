"""A run in parts, from a given state: the kernels behind `agglom_mpi.coupling`.

The engines are those of a sample. Observations are made on copies, so that neither their number nor
the number of parts changes what follows.
"""

from typing import Final

import numpy as np

import agglom_mpi.simulation.event_driven.engine
import agglom_mpi.simulation.time_driven.steppers  # noqa: F401  (all register their engines)
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.measurement import (
    count_overlaps,
    is_finite,
    mean_temperature,
    radius_moments,
)
from agglom_mpi.simulation.particles import (
    RADIATED,
    Particles,
    empty_particles,
    new_ledger,
    particle_type_of,
)
from agglom_mpi.simulation.reference_frame import (
    fluctuation_energy,
    to_mass_frame,
    total_momentum,
)
from agglom_mpi.simulation.scene import Scene, advance_to, begin, copy_at
from agglom_mpi.simulation.trajectory import Observer, cool_copies, return_copies_to_box

OBSERVATION: Final = np.dtype(
    [(name, "f8") for name in ("mean_radius", "radius_variance", "mass", "x", "y", "z")]
    + [(name, "f8") for name in ("fluctuation", "temperature", "pending", "reached")]
    + [("particles", "i8"), ("finite", "u1")]
)
"""Observed quantities, SI: radii, mass, momentum, kinetic energy about the mean velocity,
mass-weighted temperature, radiated heat not yet in a ledger (`pending`), the time reached."""


def room_for_particles(scene: Scene, capacity: int) -> Particles:
    """Return room for `capacity` particles, with temperatures and grains in any scene."""
    return empty_particles(particle_type_of(scene, shown=True), capacity)


def empty_observer(scene: Scene, capacity: int) -> Observer:
    """Return an observer whose copy, of `capacity` particles, shows an observation."""
    return Observer(np.zeros(3), room_for_particles(scene, capacity), new_ledger())


@kernel
def overlaps_of(scene, particles):
    """Count the pairs of particles that overlap by more than rounding."""
    return count_overlaps(scene, particles, 0.0)


@kernel
def start_run(scene, particles, engine_state, observer, observation):
    """Start a run at the time 0 with particles as they are, and observe them.

    Parameters
    ----------
    scene : Scene
    particles : Particles, the engine's own from now on
    engine_state : what `new_engine_state` returned for the scene
    observer : Observer; its copy shows the particles from now on
    observation : array of `OBSERVATION`, shape (1,), filled
    """
    drift = to_mass_frame(scene, particles)
    for axis in range(3):
        observer.drift[axis] = drift[axis]
    begin(scene.engine, scene, particles, engine_state)
    observe(scene, particles, engine_state, observer, 0.0, observation[0])


@kernel
def advance_run(scene, particles, engine_state, observer, ledger, until, abort, observation):
    """Advance a run to `until` in s, and observe the particles; arguments as for `start_run`.

    Adds to the ledger. The time reached, in the observation, is earlier if a budget was used up.
    """
    reached = advance_to(scene.engine, scene, particles, ledger, engine_state, until, abort)
    observe(scene, particles, engine_state, observer, reached, observation[0])


@inlined
def observe(scene, particles, engine_state, observer, time, observation):
    """Copy the particles as they are at `time` in s, and measure the copies."""
    observer.ledger.energy[RADIATED] = 0.0
    copy_at(scene.engine, scene, particles, engine_state, observer, time)
    cool_copies(observer, scene, time)
    copy = observer.copy
    energy, _ = fluctuation_energy(scene.escape, copy)
    return_copies_to_box(observer, scene, time)
    momentum, mass = total_momentum(scene.escape, copy)
    mean, variance, _, _ = radius_moments(copy, 1.0)
    observation["mean_radius"] = mean
    observation["radius_variance"] = variance
    observation["mass"] = mass
    observation["x"] = momentum[0]
    observation["y"] = momentum[1]
    observation["z"] = momentum[2]
    observation["fluctuation"] = energy
    observation["temperature"] = mean_temperature(scene, copy)
    observation["pending"] = observer.ledger.energy[RADIATED]
    observation["reached"] = time
    observation["particles"] = copy.size[0]
    observation["finite"] = np.uint8(is_finite(copy))
