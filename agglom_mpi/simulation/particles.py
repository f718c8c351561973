"""The particles of one sample as a struct of arrays, and their ledger."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, rare_stage, stage

# Indices into the arrays of a `Ledger`.
REACTION: Final = 0
RADIATED: Final = 1
SURFACE: Final = 2
DISSIPATED: Final = 3

COLLISIONS: Final = 0
MERGES: Final = 1
BREAKUPS: Final = 2
CAPPED: Final = 3
FLOORED: Final = 4
STEPS: Final = 5
PARTICLE_STEPS: Final = 6
EXHAUSTED: Final = 7


class Ledger(NamedTuple):
    """What a sample books: energies in J, counts, and the largest solver residual."""

    energy: np.ndarray
    tally: np.ndarray
    residual: np.ndarray


class Particles(NamedTuple):
    """Particles 0 … `size[0]`−1; a slot with mass 0, infinitely far, is empty until compaction.

    Attributes
    ----------
    size
        Slots in use, shape (1,).
    position, velocity
        Shape (3, capacity), m and m/s.
    radius, mass, temperature
        Shape (capacity,), m, kg, K.
    touched
        Time in s up to which `temperature` holds, shape (capacity,).
    struck
        Time of the last impact in s, −inf before the first, shape (capacity,).
    grains
        Original grains in each particle, shape (capacity,).
    """

    size: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    temperature: np.ndarray
    touched: np.ndarray
    struck: np.ndarray
    grains: np.ndarray


@allocating
def new_ledger() -> Ledger:
    """Return an empty ledger."""
    return Ledger(np.zeros(4), np.zeros(8, np.int64), np.zeros(1))


@allocating
def new_particles(size: int, capacity: int, radius: float, mass: float, temperature: float):  # type: ignore[no-untyped-def]
    """Return `size` equal grains, not placed yet, with room for `capacity`."""
    particles = Particles(
        np.zeros(1, np.int64),
        np.zeros((3, capacity)),
        np.zeros((3, capacity)),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros(capacity),
        np.full(capacity, -np.inf),
        np.zeros(capacity, np.int64),
    )
    particles.size[0] = size
    for i in range(size):
        particles.radius[i] = radius
        particles.mass[i] = mass
        particles.temperature[i] = temperature
        particles.grains[i] = 1
    return particles


@stage
def copy_slot(particles: Particles, source: int, target: int) -> None:
    """Copy one particle into another slot."""
    for axis in range(3):
        particles.position[axis, target] = particles.position[axis, source]
        particles.velocity[axis, target] = particles.velocity[axis, source]
    particles.radius[target] = particles.radius[source]
    particles.mass[target] = particles.mass[source]
    particles.temperature[target] = particles.temperature[source]
    particles.touched[target] = particles.touched[source]
    particles.struck[target] = particles.struck[source]
    particles.grains[target] = particles.grains[source]


@stage
def empty_slot(particles: Particles, i: int) -> None:
    """Take a particle out; `compact` closes the gap."""
    particles.mass[i] = 0.0
    particles.radius[i] = 0.0
    for axis in range(3):
        particles.position[axis, i] = np.inf


@rare_stage
def compact(particles: Particles) -> None:
    """Close the gaps that merged particles left, keeping the order of the others."""
    kept = 0
    for i in range(particles.size[0]):
        if particles.mass[i] > 0.0:
            if kept < i:
                copy_slot(particles, i, kept)
            kept += 1
    particles.size[0] = kept


@rare_stage
def permute(values, order, count, scratch):  # type: ignore[no-untyped-def]
    """Let `values[k]` be what `values[order[k]]` was, for the first `count`."""
    for k in range(count):
        scratch[k] = values[order[k]]
    for k in range(count):
        values[k] = scratch[k]


@allocating
def reorder(particles: Particles, order: np.ndarray) -> None:
    """Let slot k be what slot `order[k]` was, for all slots in use."""
    count = particles.size[0]
    scratch = np.empty(count)
    for axis in range(3):
        permute(particles.position[axis], order, count, scratch)
        permute(particles.velocity[axis], order, count, scratch)
    permute(particles.radius, order, count, scratch)
    permute(particles.mass, order, count, scratch)
    permute(particles.temperature, order, count, scratch)
    permute(particles.touched, order, count, scratch)
    permute(particles.struck, order, count, scratch)
    permute(particles.grains, order, count, np.empty(count, np.int64))
