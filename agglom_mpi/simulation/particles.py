"""Particles of one sample as records of what its scene uses, and the ledger of what is added up."""

import functools
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.stages import (
    inlined,
    inlined_allocating,
    law_of,
    laws_in,
    not_inlined,
    optional_field,
)
from agglom_mpi.physics.cooling import ExactCooling

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

# Indices into the arrays of a `Ledger`.
REACTION: Final = 0
RADIATED: Final = 1
SURFACE: Final = 2
DISSIPATED: Final = 3
UNRESOLVED: Final = 4
EXCHANGED: Final = 5
LEFT_TO_STRUCTURE: Final = 6
WORK: Final = 9
"""Places in `Ledger.energy`, J. UNRESOLVED: heat too small for a temperature to change by (float64
resolves 3e-14 K at 300 K); EXCHANGED: sum of |radiated|, the scale of the closure error. From
LEFT_TO_STRUCTURE on, three components in J s: angular momentum that no rotation had the energy
for. WORK: of a shear, on the box."""

COLLISIONS: Final = 0
MERGES: Final = 1
BREAKUPS: Final = 2
CAPPED: Final = 3
FLOORED: Final = 4
STEPS: Final = 5
PARTICLE_STEPS: Final = 6
EXHAUSTED: Final = 7
SPIN_CAPS: Final = 8
"""Places in `Ledger.counts`; SPIN_CAPS: merges and breakups that left angular momentum behind."""


class Ledger(NamedTuple):
    """What a sample adds up: energies in J, counts, and the largest solver residual.

    `collisions` are `CollisionCounts` where collisions are counted by mass.
    """

    energy: np.ndarray
    counts: np.ndarray
    residual: np.ndarray
    collisions: Any = None


class Particles(NamedTuple):
    """Particles 0 … `size[0]`−1; a slot with mass 0, infinitely far, is empty until compaction.

    Attributes
    ----------
    size
        Slots in use, shape (1,).
    records
        Records of a `particle_type`, shape (capacity,).
    labels_given
        How many labels were given, shape (1,).
    """

    size: NDArray[np.int64]
    records: NDArray[Any]
    labels_given: NDArray[np.int64]

    @property
    def position(self) -> Floats:
        """View of the positions in m, shape (3, capacity)."""
        return self._vectors("x")

    @property
    def velocity(self) -> Floats:
        """View of the velocities in m/s, shape (3, capacity)."""
        return self._vectors("u")

    @property
    def spin(self) -> Floats | None:
        """View of the angular velocities in rad/s, shape (3, capacity); None: none spins."""
        return None if self._field("spin_x") is None else self._vectors("spin_x")

    @property
    def radius(self) -> Floats:
        """View of the radii in m, shape (capacity,)."""
        return self.records["radius"]

    @property
    def mass(self) -> Floats:
        """View of the masses in kg, shape (capacity,)."""
        return self.records["mass"]

    @property
    def label(self) -> Integers:
        """View of the labels, shape (capacity,)."""
        return self.records["label"]

    @property
    def temperature(self) -> Floats | None:
        """View of the temperatures in K, shape (capacity,); None: the scene's."""
        return self._field("temperature")

    @property
    def last_impact(self) -> Floats | None:
        """View of the times in s of last impacts, shape (capacity,); None if unused."""
        return self._field("last_impact")

    @property
    def grains(self) -> Integers | None:
        """View of the numbers of grains, shape (capacity,); None where the mass says them."""
        return self._field("grains")

    def _field(self, name: str) -> NDArray[Any] | None:
        names = self.records.dtype.names
        return self.records[name] if names is not None and name in names else None

    def _vectors(self, first: str) -> Floats:
        """Return a view of three fields side by side, shape (3, capacity)."""
        step = self.records.itemsize
        fields = self.records.dtype.fields
        assert fields is not None
        return np.ndarray(
            (3, self.records.size), np.float64, self.records, fields[first][1], (8, step)
        )


SPIN: Final = ("spin_x", "spin_y", "spin_z")
"""Fields of the angular velocity of a particle that spins, rad/s."""


@functools.cache
def particle_type(
    temperature: bool, cooled_to: bool, last_impact: bool, grains: bool, spin: bool = False
) -> np.dtype[np.void]:
    """Return the type of a particle's record: what all scenes use, and what one uses besides.

    Fields are position (x, y, z) in m, velocity (u, v, w) in m/s, `radius` in m, `mass` in kg and a
    `label`, its identity (see `Frames`), which every scene has, so that one machine code serves
    with frames and without.

    Parameters
    ----------
    temperature
        Whether there is a `temperature` in K; without it the scene's holds for all.
    cooled_to
        Whether there is the time in s up to which the temperature is cooled.
    last_impact
        Whether there is the time of the last impact in s, −inf before the first.
    grains
        Whether original `grains` in a particle are counted; else its mass says them.
    spin
        Whether there is an angular velocity (spin_x, spin_y, spin_z) in rad/s.
    """
    # The same object each time: a kernel knows its types by them. The label comes last, so that no
    # type begins with all fields of another: Numba would take one for the other.
    fields = [(name, "f8") for name in ("x", "y", "z", "u", "v", "w", "radius", "mass")]
    fields += [("temperature", "f8")] if temperature else []
    fields += [("cooled_to", "f8")] if cooled_to else []
    fields += [("last_impact", "f8")] if last_impact else []
    fields += [("grains", "i8")] if grains else []
    fields += [(name, "f8") for name in SPIN] if spin else []
    return np.dtype([*fields, ("label", "i8")])


temperature_or, set_temperature = optional_field("temperature")
last_impact_or, set_last_impact = optional_field("last_impact")
grains_or, set_grains = optional_field("grains")


@inlined
def position_of(particle):
    """Position of a particle in m, three components."""
    return particle["x"], particle["y"], particle["z"]


@inlined
def velocity_of(particle):
    """Velocity of a particle in m/s, three components."""
    return particle["u"], particle["v"], particle["w"]


@inlined
def moved_by(particle, factor, displacement):
    """Position in m that a particle has after `factor` times a displacement in m."""
    return (
        particle["x"] + factor * displacement[0],
        particle["y"] + factor * displacement[1],
        particle["z"] + factor * displacement[2],
    )


@inlined
def set_position(particle, position):
    """Set the position of a particle in m, three components."""
    particle["x"], particle["y"], particle["z"] = position


@inlined
def set_velocity(particle, velocity):
    """Set the velocity of a particle in m/s, three components."""
    particle["u"], particle["v"], particle["w"] = velocity


@inlined
def spin_of(particle):
    """Angular velocity in rad/s of a particle that spins, three components."""
    return particle["spin_x"], particle["spin_y"], particle["spin_z"]


@inlined
def set_spin(particle, spin):
    """Set the angular velocity of a particle that spins in rad/s, three components."""
    particle["spin_x"], particle["spin_y"], particle["spin_z"] = spin


@inlined
def record_cooling(ledger, energy):
    """Enter `energy` in J that a particle has lost to its surroundings in the ledger."""
    ledger.energy[RADIATED] += energy
    ledger.energy[EXCHANGED] += abs(energy)


@inlined
def new_label(particles, i):
    """Give slot i a label that no particle had before."""
    particles.records[i]["label"] = particles.labels_given[0]
    particles.labels_given[0] += 1


@inlined
def copy_slot(particles: Particles, source: int, target: int) -> None:
    """Copy one particle into another slot."""
    particles.records[target] = particles.records[source]


@inlined
def empty_slot(particles: Particles, i: int) -> None:
    """Empty the slot of a particle; `compact` closes the gap."""
    particle = particles.records[i]
    particle["mass"] = 0.0
    particle["radius"] = 0.0
    set_position(particle, (np.inf, np.inf, np.inf))


@not_inlined
def compact(particles: Particles) -> None:
    """Close the gaps that merged particles left, keeping the order of the others."""
    kept = 0
    for i in range(particles.size[0]):
        if particles.records[i]["mass"] > 0.0:
            if kept < i:
                copy_slot(particles, i, kept)
            kept += 1
    particles.size[0] = kept


@inlined_allocating
def reorder(particles: Particles, order: np.ndarray) -> None:
    """Reorder all slots in use: slot k becomes what slot `order[k]` was."""
    before = particles.records.copy()
    for k in range(particles.size[0]):
        particles.records[k] = before[order[k]]


def new_ledger() -> Ledger:
    """Return an empty ledger."""
    return Ledger(np.zeros(WORK + 1), np.zeros(SPIN_CAPS + 1, np.int64), np.zeros(1))


def particle_type_of(scene: Any, shown: bool = False) -> np.dtype[np.void]:
    """Return the type of the records of a `Scene`, without fields that it has no use for.

    Where particles are `shown` to somebody, they have temperatures and grains in any scene.
    """
    laws = scene.laws
    return particle_type(
        temperature=shown or laws.heating is not None or scene.cooling is not None,
        cooled_to=isinstance(scene.cooling, ExactCooling),
        last_impact=any(law_of(each).contacts_last for each in laws_in((laws.restitution,))),
        grains=shown or laws.fragmentation is not None or scene.sizes is not None,
        spin=scene.has_spins,
    )


def empty_particles(kind: np.dtype[np.void], capacity: int) -> Particles:
    """Return room for `capacity` particles with records of a `particle_type`; none is there yet."""
    particles = Particles(np.zeros(1, np.int64), np.zeros(capacity, kind), np.zeros(1, np.int64))
    if particles.last_impact is not None:
        particles.last_impact[:] = -np.inf
    return particles


def new_particles(scene: Any, capacity: int) -> Particles:
    """Return the grains of a `Scene`, not placed yet, with room for `capacity` particles."""
    particles, grains = empty_particles(particle_type_of(scene), capacity), scene.particles
    particles.size[0] = particles.labels_given[0] = grains
    particles.label[:] = np.arange(capacity)
    particles.radius[:grains] = scene.radius
    particles.mass[:grains] = scene.mass
    if particles.temperature is not None:
        particles.temperature[:] = scene.temperature
    if particles.grains is not None:
        particles.grains[:] = 1
    return particles


@inlined
def largest_radius(particles):
    """Largest radius in m."""
    largest = 0.0
    for i in range(particles.size[0]):
        largest = max(largest, particles.records[i]["radius"])
    return largest
