"""Particles of one sample as a struct of arrays, with the energies exchanged."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import ANY, dispatch_allocating, inlined, inlined_allocating, not_inlined
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling
from agglom_mpi.physics.restitution import (
    ContactTimeRestitution,
)

# Indices into the arrays of a `Ledger`.
REACTION: Final = 0
RADIATED: Final = 1
SURFACE: Final = 2
DISSIPATED: Final = 3
UNRESOLVED: Final = 4
EXCHANGED: Final = 5
"""Places in `Ledger.energy`: what a temperature is too coarse for (float64 has 3e-14 K left at
300 K), and what was radiated and absorbed together, without signs."""

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

    An array that a scene has no use for is `None`.

    Attributes
    ----------
    size
        Slots in use, shape (1,).
    position, velocity
        Shape (3, capacity), m and m/s.
    radius, mass
        Shape (capacity,), m and kg.
    temperature
        Shape (capacity,), K; without it the scene's holds for all.
    cooled_to
        Time in s up to which `temperature` holds, shape (capacity,).
    last_impact
        Time of the last impact in s, −inf before the first, shape (capacity,).
    grains
        Original grains in each particle, shape (capacity,); what cannot break need not count them.
    label, labels_given
        Who is who, shape (capacity,), and how many labels were given, shape (1,); see `Frames`.
    """

    size: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    temperature: np.ndarray | None
    cooled_to: np.ndarray | None
    last_impact: np.ndarray | None
    grains: np.ndarray | None
    label: np.ndarray | None = None
    labels_given: np.ndarray | None = None


@inlined_allocating
def new_ledger() -> Ledger:
    """Return an empty ledger."""
    return Ledger(np.zeros(EXCHANGED + 1), np.zeros(EXHAUSTED + 1, np.int64), np.zeros(1))


@inlined
def record_cooling(ledger, energy):
    """Enter `energy` in J that a particle has lost to its surroundings in the ledger."""
    ledger.energy[RADIATED] += energy
    ledger.energy[EXCHANGED] += abs(energy)


@inlined
def value_or(values, i, otherwise):
    """`values[i]`, or `otherwise` where the scene has no such array."""
    if values is None:
        return otherwise
    return values[i]


@inlined
def set_value(values, i, value):
    """Let `values[i]` be `value`, where the scene has such an array."""
    if values is not None:
        values[i] = value


@inlined
def new_label(label, labels_given, i):
    """Give slot i a label that nobody had before, where there are labels."""
    if label is not None:
        label[i] = labels_given[0]
        labels_given[0] += 1


@inlined
def copy_value(values, source, others, target):
    """Let `others[target]` be `values[source]`, where the scene has such arrays."""
    if values is not None:
        others[target] = values[source]


@inlined
def copy_slot_to(particles: Particles, source: int, others: Particles, target: int) -> None:
    """Copy one particle into a slot of other particles."""
    for axis in range(3):
        others.position[axis, target] = particles.position[axis, source]
        others.velocity[axis, target] = particles.velocity[axis, source]
    others.radius[target] = particles.radius[source]
    others.mass[target] = particles.mass[source]
    copy_value(particles.temperature, source, others.temperature, target)
    copy_value(particles.cooled_to, source, others.cooled_to, target)
    copy_value(particles.last_impact, source, others.last_impact, target)
    copy_value(particles.grains, source, others.grains, target)
    copy_value(particles.label, source, others.label, target)


@inlined
def copy_slot(particles: Particles, source: int, target: int) -> None:
    """Copy one particle into another slot."""
    copy_slot_to(particles, source, particles, target)


@inlined
def empty_slot(particles: Particles, i: int) -> None:
    """Take a particle out; `compact` closes the gap."""
    particles.mass[i] = 0.0
    particles.radius[i] = 0.0
    for axis in range(3):
        particles.position[axis, i] = np.inf


@not_inlined
def compact(particles: Particles) -> None:
    """Close the gaps that merged particles left, keeping the order of the others."""
    kept = 0
    for i in range(particles.size[0]):
        if particles.mass[i] > 0.0:
            if kept < i:
                copy_slot(particles, i, kept)
            kept += 1
    particles.size[0] = kept


@not_inlined
def permute(values, order, count, scratch):
    """Let `values[k]` be what `values[order[k]]` was, for the first `count`, if it is there."""
    if values is None:
        return
    for k in range(count):
        scratch[k] = values[order[k]]
    for k in range(count):
        values[k] = scratch[k]


@inlined_allocating
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
    permute(particles.cooled_to, order, count, scratch)
    permute(particles.last_impact, order, count, scratch)
    whole = np.empty(count, np.int64)
    permute(particles.grains, order, count, whole)
    permute(particles.label, order, count, whole)


@dispatch_allocating
def new_cooling_times(cooling, capacity):
    """Return times in s up to which temperatures hold, shape (capacity,), or None."""


@new_cooling_times.register(None, EulerCooling)
def _never_behind(cooling, capacity):
    return None


@new_cooling_times.register(ExactCooling)
def _behind(cooling, capacity):
    return np.zeros(capacity)


@dispatch_allocating
def new_impact_times(restitution, capacity):
    """Return times of last impacts in s, shape (capacity,), or None."""


@new_impact_times.register(ANY)
def _forgotten(restitution, capacity):
    return None


@new_impact_times.register(ContactTimeRestitution)
def _remembered(restitution, capacity):
    return np.full(capacity, -np.inf)


@dispatch_allocating
def new_grains(fragmentation, capacity):
    """Return grains in each particle, shape (capacity,), or None."""


@new_grains.register(None)
def _uncounted(fragmentation, capacity):
    return None


@new_grains.register(ANY)
def _counted(fragmentation, capacity):
    return np.ones(capacity, np.int64)


@inlined_allocating
def new_temperatures(heating, cooling, capacity, start):
    """Return temperatures in K, shape (capacity,), or None where nothing changes them."""
    if heating is None and cooling is None:
        return None
    return np.full(capacity, start)


@inlined_allocating
def new_labels(frames, capacity):
    """Return the numbers of the slots, shape (capacity,), or None where no frames are taken."""
    if frames is None:
        return None
    return np.arange(capacity)


@inlined_allocating
def new_count(frames, start):
    """Return a count that begins at `start`, shape (1,), or None where no frames are taken."""
    if frames is None:
        return None
    return np.full(1, start)


@inlined_allocating
def new_particles(scene, capacity, frames):
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


@inlined
def largest_radius(particles):
    """Largest radius in m."""
    largest = 0.0
    for i in range(particles.size[0]):
        largest = max(largest, particles.radius[i])
    return largest
