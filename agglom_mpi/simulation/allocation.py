"""Which arrays does a scene need?  What it has no use for is `None`, known when it is compiled."""

import numpy as np

from agglom_mpi.compilation import allocating, allocating_question
from agglom_mpi.physics.cooling import Exact, ForwardEuler
from agglom_mpi.physics.fragmentation import OwnEnergyFragmentation, PairEnergyFragmentation
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    ContactTimeRestitution,
    PressureRestitution,
)
from agglom_mpi.simulation.particles import Particles


@allocating_question
def new_cooling_times(cooling, capacity):  # type: ignore[no-untyped-def]
    """Return times in s up to which temperatures hold, shape (capacity,), or None."""


@new_cooling_times.answer(None, ForwardEuler)
def _never_behind(cooling, capacity):  # type: ignore[no-untyped-def]
    return None


@new_cooling_times.answer(Exact)
def _behind(cooling, capacity):  # type: ignore[no-untyped-def]
    return np.zeros(capacity)


@allocating_question
def new_impact_times(restitution, capacity):  # type: ignore[no-untyped-def]
    """Return times of last impacts in s, shape (capacity,), or None."""


@new_impact_times.answer(PressureRestitution, ConstantRestitution)
def _forgotten(restitution, capacity):  # type: ignore[no-untyped-def]
    return None


@new_impact_times.answer(ContactTimeRestitution)
def _remembered(restitution, capacity):  # type: ignore[no-untyped-def]
    return np.full(capacity, -np.inf)


@allocating_question
def new_grains(fragmentation, capacity):  # type: ignore[no-untyped-def]
    """Return grains in each particle, shape (capacity,), or None."""


@new_grains.answer(None)
def _uncounted(fragmentation, capacity):  # type: ignore[no-untyped-def]
    return None


@new_grains.answer(PairEnergyFragmentation, OwnEnergyFragmentation)
def _counted(fragmentation, capacity):  # type: ignore[no-untyped-def]
    return np.ones(capacity, np.int64)


@allocating
def new_temperatures(heating, cooling, capacity, start):  # type: ignore[no-untyped-def]
    """Return temperatures in K, shape (capacity,), or None where nothing changes them."""
    if heating is None and cooling is None:
        return None
    return np.full(capacity, start)


@allocating
def new_labels(frames, capacity):  # type: ignore[no-untyped-def]
    """Return the numbers of the slots, shape (capacity,), or None where no frames are taken."""
    if frames is None:
        return None
    return np.arange(capacity)


@allocating
def new_count(frames, start):  # type: ignore[no-untyped-def]
    """Return a count that begins at `start`, shape (1,), or None where no frames are taken."""
    if frames is None:
        return None
    return np.full(1, start)


@allocating
def new_particles(scene, capacity, frames):  # type: ignore[no-untyped-def]
    """Return the grains of a scene, not placed yet, with room for `capacity`.

    They have labels if there are `frames` to be taken.
    """
    laws = scene.laws
    particles = Particles(
        np.zeros(1, np.int64),
        np.zeros((3, capacity)),
        np.zeros((3, capacity)),
        np.zeros(capacity),
        np.zeros(capacity),
        new_temperatures(laws.heating, scene.cooling, capacity, scene.temperature),
        new_cooling_times(scene.cooling, capacity),
        new_impact_times(laws.restitution, capacity),
        new_grains(laws.fragmentation, capacity),
        new_labels(frames, capacity),
        new_count(frames, scene.particles),
    )
    particles.size[0] = scene.particles
    for i in range(scene.particles):
        particles.radius[i] = scene.radius
        particles.mass[i] = scene.mass
    return particles
