"""Particles of one sample as a struct of arrays, and the ledger of energies and counts."""

from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.kernels import Submodel, inlined, inlined_allocating, not_inlined
from agglom_mpi.physics.cooling import ExactCooling
from agglom_mpi.physics.restitution import ContactTimeRestitution

FloatsOrNone: TypeAlias = NDArray[np.float64] | None
IntegersOrNone: TypeAlias = NDArray[np.int64] | None

# Indices into the arrays of a `Ledger`.
REACTION: Final = 0
RADIATED: Final = 1
SURFACE: Final = 2
DISSIPATED: Final = 3
UNRESOLVED: Final = 4
EXCHANGED: Final = 5
"""Places in `Ledger.energy`, J. UNRESOLVED: heat too small for a temperature to change by (float64
resolves 3e-14 K at 300 K); EXCHANGED: sum of |radiated|, the scale of the closure error."""

COLLISIONS: Final = 0
MERGES: Final = 1
BREAKUPS: Final = 2
CAPPED: Final = 3
FLOORED: Final = 4
STEPS: Final = 5
PARTICLE_STEPS: Final = 6
EXHAUSTED: Final = 7


class Ledger(NamedTuple):
    """What a sample adds up: energies in J, counts, and the largest solver residual."""

    energy: np.ndarray
    counts: np.ndarray
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
        Time in s up to which `temperature` is cooled, shape (capacity,).
    last_impact
        Time of the last impact in s, −inf before the first, shape (capacity,).
    grains
        Original grains in each particle, shape (capacity,); only counted where particles can break
        or grains differ in size: elsewhere the mass says it.
    label, labels_given
        Identities, shape (capacity,), and how many were given, shape (1,); see `Frames`. Every
        scene has them, so that one machine code serves with frames and without.
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
    label: np.ndarray
    labels_given: np.ndarray


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
    """Set `values[i]`, where the scene has such an array."""
    if values is not None:
        values[i] = value


@inlined
def new_label(particles, i):
    """Give slot i a label that no particle had before."""
    particles.label[i] = particles.labels_given[0]
    particles.labels_given[0] += 1


@inlined
def copy_value(values, source, others, target):
    """Copy `values[source]` to `others[target]`, where the scene has such arrays."""
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
    others.label[target] = particles.label[source]


@inlined
def copy_slot(particles: Particles, source: int, target: int) -> None:
    """Copy one particle into another slot."""
    copy_slot_to(particles, source, particles, target)


@inlined
def empty_slot(particles: Particles, i: int) -> None:
    """Empty the slot of a particle; `compact` closes the gap."""
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
    """Reorder the first `count` values: `values[k]` becomes `values[order[k]]`; None stays None."""
    if values is None:
        return
    for k in range(count):
        scratch[k] = values[order[k]]
    for k in range(count):
        values[k] = scratch[k]


@inlined_allocating
def reorder(particles: Particles, order: np.ndarray) -> None:
    """Reorder all slots in use: slot k becomes what slot `order[k]` was."""
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


def new_ledger() -> Ledger:
    """Return an empty ledger."""
    return Ledger(np.zeros(EXCHANGED + 1), np.zeros(EXHAUSTED + 1, np.int64), np.zeros(1))


def new_cooling_times(cooling: Submodel | None, capacity: int) -> FloatsOrNone:
    """Return times in s up to which temperatures are cooled, shape (capacity,); None if unused."""
    return np.zeros(capacity) if isinstance(cooling, ExactCooling) else None


def new_impact_times(restitution: Submodel, capacity: int) -> FloatsOrNone:
    """Return times of last impacts in s, shape (capacity,); None if unused."""
    remembers = isinstance(restitution, ContactTimeRestitution)
    return np.full(capacity, -np.inf) if remembers else None


def new_grains(fragmentation: Submodel | None, sizes: Any, capacity: int) -> IntegersOrNone:
    """Return grains in each particle, shape (capacity,); None where none can break or differ."""
    counted = fragmentation is not None or sizes is not None
    return np.ones(capacity, np.int64) if counted else None


def new_temperatures(
    heating: Submodel | None, cooling: Submodel | None, capacity: int, start: float
) -> FloatsOrNone:
    """Return temperatures in K, shape (capacity,); None where nothing changes them."""
    return None if heating is None and cooling is None else np.full(capacity, start)


def new_particles(scene: Any, capacity: int) -> Particles:
    """Return the grains of a `Scene`, not placed yet, with room for `capacity` particles."""
    grains = scene.particles
    particles = Particles(
        size=np.full(1, grains),
        position=np.zeros((3, capacity)),
        velocity=np.zeros((3, capacity)),
        radius=np.zeros(capacity),
        mass=np.zeros(capacity),
        temperature=new_temperatures(
            scene.laws.heating, scene.cooling, capacity, scene.temperature
        ),
        cooled_to=new_cooling_times(scene.cooling, capacity),
        last_impact=new_impact_times(scene.laws.restitution, capacity),
        grains=new_grains(scene.laws.fragmentation, scene.sizes, capacity),
        label=np.arange(capacity),
        labels_given=np.full(1, grains),
    )
    particles.radius[:grains] = scene.radius
    particles.mass[:grains] = scene.mass
    return particles


@inlined
def largest_radius(particles):
    """Largest radius in m."""
    largest = 0.0
    for i in range(particles.size[0]):
        largest = max(largest, particles.radius[i])
    return largest
