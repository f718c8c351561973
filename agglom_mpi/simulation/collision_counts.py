"""Collisions and exposures by mass and time: what kernels of population balances are made of.

A rate coefficient is a number of collisions over the time that pairs had for them, so both are
counted: collisions of each pair of bins of mass, and the integrals over time of how many particles
and pairs there are, of their mass and of their kinetic energy. The event engine counts them where a
`Ledger` has room for it; elsewhere nothing of this is compiled.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.stages import dispatch, inlined, not_inlined
from agglom_mpi.simulation.collision import BONDED, RECEDING, line_of_centres
from agglom_mpi.simulation.vectors import dot, relative_velocity

HITS: Final = 0
STICKS: Final = 1
BREAKS: Final = 2
SPEED: Final = 3
SQUARED_SPEED: Final = 4
LOST: Final = 5
SQUARED_SPEED_OF_STICKS: Final = 6
LOST_BY_STICKS: Final = 7
"""Places in `CollisionCounts.impacts`: collisions, those after which there is one particle, those
that broke one; sums of the normal speed in m/s, its square, and the kinetic energy lost in J; the
last two of collisions that stick alone."""

NUMBER: Final = 0
MASS: Final = 1
ENERGY: Final = 2
"""Places in `CollisionCounts.present` and `CollisionCounts.exposure`: particles, mass in kg,
kinetic energy in J."""

WINDOW: Final = 0
"""Place in `CollisionCounts.place`."""


class CollisionCounts(NamedTuple):
    """Collisions of samples, added up by bins of mass and windows of time.

    Bins are equal in the logarithm of the mass; the first and the last hold what lies beyond, too.

    Attributes
    ----------
    grid
        Mass in the middle of the first bin in kg, and bins a decade, shape (2,).
    ends
        Ends of the windows in s, shape (windows,).
    impacts
        Shape (windows, bins, bins, 8); the lower bin comes first.
    exposure
        Integrals of `present` over time, shape (windows, bins, 3).
    pairs
        Integral of the number of pairs over time in s, shape (windows, bins, bins).
    pieces
        Pieces of broken particles by the bins of whole and piece, shape (windows, bins, bins).
    start, present
        What is in each bin at the start and now, shape (bins, 3).
    since
        Times up to which the exposure of each bin, and in the last place pairs, are added, shape
        (bins + 1,), s.
    place
        Window under way, shape (1,).
    """

    grid: NDArray[np.float64]
    ends: NDArray[np.float64]
    impacts: NDArray[np.float64]
    exposure: NDArray[np.float64]
    pairs: NDArray[np.float64]
    pieces: NDArray[np.float64]
    start: NDArray[np.float64]
    present: NDArray[np.float64]
    since: NDArray[np.float64]
    place: NDArray[np.int64]


def new_collision_counts(
    mass: float, per_decade: float, bins: int, ends: NDArray[np.float64]
) -> CollisionCounts:
    """Return room for counts, all zero.

    Parameters
    ----------
    mass
        In the middle of the first bin, kg.
    per_decade
        Bins a decade of mass.
    bins
        Number of bins.
    ends
        Ends of the windows in s, shape (windows,); the last one is that of the samples.
    """
    windows = len(ends)
    return CollisionCounts(
        np.array([mass, per_decade]),
        np.array(ends, np.float64),
        np.zeros((windows, bins, bins, LOST_BY_STICKS + 1)),
        np.zeros((windows, bins, ENERGY + 1)),
        np.zeros((windows, bins, bins)),
        np.zeros((windows, bins, bins)),
        np.zeros((bins, ENERGY + 1)),
        np.zeros((bins, ENERGY + 1)),
        np.zeros(bins + 1),
        np.zeros(1, np.int64),
    )


@inlined
def bin_of(counts, mass):
    """Bin of a mass in kg."""
    bins = counts.present.shape[0]
    place = math.floor(counts.grid[1] * math.log10(mass / counts.grid[0]) + 0.5)
    return int(max(0.0, min(bins - 1.0, place)))


@inlined
def kinetic_energy(particle):
    """Kinetic energy of the motion of a particle in J."""
    u, v, w = particle["u"], particle["v"], particle["w"]
    return 0.5 * particle["mass"] * (u * u + v * v + w * w)


@dispatch
def begin_counts(counts: Any, particles: Any) -> None:
    """Begin a sample: put its particles into their bins; nothing where nothing is counted."""


@begin_counts.register(None)
def _no_counts(counts, particles):
    return None


@begin_counts.register(CollisionCounts)
def _fill_bins(counts, particles):
    counts.place[WINDOW] = 0
    counts.since[:] = 0.0
    counts.present[:] = 0.0
    for i in range(particles.size[0]):
        add_particle(counts, particles.records[i], 1.0)
    for k in range(counts.present.shape[0]):
        for place in range(ENERGY + 1):
            counts.start[k, place] = counts.present[k, place]


@inlined
def add_particle(counts, particle, number):
    """Add a particle to its bin, or take it out with a `number` of −1."""
    present = counts.present[bin_of(counts, particle["mass"])]
    present[NUMBER] += number
    present[MASS] += number * particle["mass"]
    present[ENERGY] += number * kinetic_energy(particle)


@inlined
def add_exposure(counts, k, now):
    """Add what bin k has had since the last time, up to `now` in s."""
    present, exposure = counts.present[k], counts.exposure[counts.place[WINDOW], k]
    elapsed = now - counts.since[k]
    counts.since[k] = now
    for place in range(ENERGY + 1):
        exposure[place] += present[place] * elapsed


@not_inlined
def add_exposures(counts, now):
    """Add what all bins and pairs of them have had since the last time, up to `now` in s."""
    bins = counts.present.shape[0]
    pairs, elapsed = counts.pairs[counts.place[WINDOW]], now - counts.since[bins]
    counts.since[bins] = now
    for k in range(bins):
        add_exposure(counts, k, now)
        number = counts.present[k, NUMBER]
        if number > 0.0:
            pairs[k, k] += 0.5 * number * (number - 1.0) * elapsed
            for other in range(k + 1, bins):
                pairs[k, other] += number * counts.present[other, NUMBER] * elapsed


@inlined
def pass_windows(counts, now):
    """End the windows that are over at `now` in s."""
    while counts.place[WINDOW] < len(counts.ends) - 1 and now >= counts.ends[counts.place[WINDOW]]:
        add_exposures(counts, counts.ends[counts.place[WINDOW]])
        counts.place[WINDOW] += 1


def end_counts(counts: CollisionCounts, now: float) -> None:
    """End a sample at `now` in s."""
    pass_windows(counts, now)
    add_exposures(counts, now)


@dispatch
def pair_before(counts, scene, one, other):
    """Return what counting needs of a pair before its impact; None where nothing is counted."""


@pair_before.register(None)
def _nothing_before(counts, scene, one, other):
    return None


@pair_before.register(CollisionCounts)
def _seen_before(counts, scene, one, other):
    speed = dot(relative_velocity(one, other), line_of_centres(scene, one, other))
    masses, energies = (one["mass"], other["mass"]), (kinetic_energy(one), kinetic_energy(other))
    return speed, masses, energies


@dispatch
def count_bounce(counts, before, one, other, kind, now):
    """Count a collision at `now` in s after which the pair has the masses of `pair_before`."""


@count_bounce.register(None)
def _count_no_bounce(counts, before, one, other, kind, now):
    return None


@count_bounce.register(CollisionCounts)
def _count_bounce(counts, before, one, other, kind, now):
    if kind == RECEDING:
        return
    speed, masses, energies = before
    pass_windows(counts, now)
    i, j = bin_of(counts, masses[0]), bin_of(counts, masses[1])
    change_i, change_j = kinetic_energy(one) - energies[0], kinetic_energy(other) - energies[1]
    add_impact(counts, i, j, HITS, speed, -change_i - change_j)
    add_exposure(counts, i, now)
    add_exposure(counts, j, now)
    counts.present[i, ENERGY] += change_i
    counts.present[j, ENERGY] += change_j


@inlined
def add_impact(counts, i, j, kind, speed, lost):
    """Count a collision of bins i and j at a normal speed in m/s that loses an energy in J.

    `kind` is `STICKS` or `BREAKS`, or `HITS` for neither.
    """
    impacts = counts.impacts[counts.place[WINDOW], min(i, j), max(i, j)]
    impacts[HITS] += 1.0
    impacts[SPEED] += speed
    impacts[SQUARED_SPEED] += speed * speed
    impacts[LOST] += lost
    if kind != HITS:
        impacts[kind] += 1.0
    if kind == STICKS:
        impacts[SQUARED_SPEED_OF_STICKS] += speed * speed
        impacts[LOST_BY_STICKS] += lost


@dispatch
def count_change(counts, before, particles, i, j, kind, first_piece, now):
    """Count a collision at `now` in s that merged particles i and j, or broke them into pieces.

    Further pieces are in the slots from `first_piece` on.
    """


@count_change.register(None)
def _count_no_change(counts, before, particles, i, j, kind, first_piece, now):
    return None


@count_change.register(CollisionCounts)
def _count_change(counts, before, particles, i, j, kind, first_piece, now):
    speed, masses, energies = before
    pass_windows(counts, now)
    add_exposures(counts, now)
    bins = bin_of(counts, masses[0]), bin_of(counts, masses[1])
    lost = energies[0] + energies[1]
    for k in range(2):
        present = counts.present[bins[k]]
        present[NUMBER] -= 1.0
        present[MASS] -= masses[k]
        present[ENERGY] -= energies[k]
    add_particle(counts, particles.records[i], 1.0)
    lost -= kinetic_energy(particles.records[i])
    if kind != BONDED:
        add_particle(counts, particles.records[j], 1.0)
        lost -= kinetic_energy(particles.records[j])
    for slot in range(first_piece, particles.size[0]):
        add_particle(counts, particles.records[slot], 1.0)
        lost -= kinetic_energy(particles.records[slot])
    add_impact(counts, bins[0], bins[1], STICKS if kind == BONDED else BREAKS, speed, lost)
    if kind != BONDED:
        for k in range(2):
            piece = particles.records[i if k == 0 else j]["mass"]
            count_pieces(counts, bins[k], masses[k], piece)


@inlined
def count_pieces(counts, whole, mass, piece):
    """Count the equal pieces of a mass in kg from bin `whole`, if it has broken into them."""
    if piece < mass:
        pieces = counts.pieces[counts.place[WINDOW], whole]
        pieces[bin_of(counts, piece)] += np.rint(mass / piece)
