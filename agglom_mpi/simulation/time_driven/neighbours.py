"""Nearest neighbours: Verlet candidate lists, rebuilt only when needed, or all particles.

A list holds everything within `reach` of a particle when it is built. While no particle has moved
farther than half of the skin, relative to the mean drift, whatever is nearer than reach − skin is
in the list; a particle that sees nothing that near looks at all others.
Lists are read once a step, before its contacts; what these displace is looked up among all.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import inlined, inlined_allocating
from agglom_mpi.simulation.boundary import (
    Periodic,
    cells_of,
    distance_along,
    sort_into_cells,
    wrapped_cell,
)
from agglom_mpi.simulation.particles import velocity_of

PERIODIC: Final = Periodic().build({})
"""A periodic box as kernels see it, for distances by minimum image."""

MAX_ALL_PAIRS: Final = 40
"""Particles up to which it is faster to look at all; by measurement."""

MAX_ALL_PAIRS_SHORT_LIVED: Final = 250
"""The same where lists are out of date after fewer than `MIN_LIFETIME` steps."""

MIN_LIFETIME: Final = 4

COMPLETE_REACH: Final = 1.15
SKIN: Final = 0.35
"""How far lists are complete at most, and their skin, over the mean spacing (volume/N)^⅓."""

MAX_CANDIDATES: Final = 64
"""Room for the candidates of one particle; 13 are the rule. One with more looks at all."""


class NeighbourList(NamedTuple):
    """Candidate lists and what tells whether they hold.

    Attributes
    ----------
    candidates, found
        The candidates of particle i are the first `found[i]` of row i; −1 if they are too many.
    position
        Positions in m side by side, so that many distances are computed at once, shape (3,
        capacity); whoever moves particles after `update_neighbours` copies theirs.
    built_position
        Positions in m when the lists were built, shape (3, capacity).
    drift
        Mean velocity in m/s then, shape (3,).
    changed, is_changed
        Particles that the contacts of this step merged or made: their number is in `counts`.
    counts
        Particles with lists (0: look at all), number of `changed`, steps since the last rebuild.
    validity
        Distance in m below which lists are complete, skin in m, time in s when they were built.
    work
        Work space: squared distances in m², shape (capacity,).
    """

    candidates: np.ndarray
    found: np.ndarray
    position: np.ndarray
    built_position: np.ndarray
    drift: np.ndarray
    changed: np.ndarray
    is_changed: np.ndarray
    counts: np.ndarray
    validity: np.ndarray
    work: np.ndarray


LISTED: Final = 0
CHANGED: Final = 1
AGE: Final = 2
"""Places in `NeighbourList.counts`."""

COMPLETE_WITHIN: Final = 0
SKIN_WIDTH: Final = 1
BUILT_AT: Final = 2
"""Places in `NeighbourList.validity`."""


def new_neighbour_list(capacity: int) -> NeighbourList:
    """Return lists for `capacity` particles, out of date; without room if they are always few."""
    listed = capacity if capacity > MAX_ALL_PAIRS else 0
    return NeighbourList(
        np.empty((listed, MAX_CANDIDATES), np.int32),
        np.empty(listed, np.int32),
        np.empty((3, capacity)),
        np.empty((3, listed)),
        np.zeros(3),
        np.empty(capacity, np.int64),
        np.zeros(capacity, np.bool_),
        np.zeros(3, np.int64),
        np.zeros(3),
        np.empty(capacity),
    )


@inlined
def reset_neighbour_list(neighbours):
    """Leave the lists out of date and nothing changed, whatever run they were used in before."""
    neighbours.drift[:] = 0.0
    neighbours.is_changed[:] = False
    neighbours.counts[:] = 0
    neighbours.validity[:] = 0.0


@inlined
def update_neighbours(scene, particles, neighbours, time, compacted, needed):
    """Make the lists hold at `time` in s for neighbours nearer than `needed` in m, or less far.

    `compacted` says that particles changed their slots.
    """
    for k in range(neighbours.counts[CHANGED]):
        neighbours.is_changed[neighbours.changed[k]] = False
    neighbours.counts[CHANGED] = 0
    neighbours.counts[AGE] += 1
    for i in range(particles.size[0]):
        copy_position(particles, neighbours, i)
    if compacted or is_out_of_date(scene, particles, neighbours, time):
        rebuild_lists(scene, particles, neighbours, time, needed)


@inlined
def copy_position(particles, neighbours, i):
    """Copy the position of particle i to those side by side."""
    particle = particles.records[i]
    neighbours.position[0, i] = particle["x"]
    neighbours.position[1, i] = particle["y"]
    neighbours.position[2, i] = particle["z"]


@inlined
def is_out_of_date(scene, particles, neighbours, time):
    """Whether particles were added, or one moved beyond half of the skin, since the rebuild."""
    count = particles.size[0]
    if count != neighbours.counts[LISTED]:
        return neighbours.counts[LISTED] > 0 or (
            count > MAX_ALL_PAIRS and neighbours.counts[AGE] >= MIN_LIFETIME
        )
    elapsed = time - neighbours.validity[BUILT_AT]
    width = 2.0 * scene.half_width
    x, y, z = neighbours.position[0], neighbours.position[1], neighbours.position[2]
    u, v, w = (
        neighbours.built_position[0],
        neighbours.built_position[1],
        neighbours.built_position[2],
    )
    drift = neighbours.drift
    worst = 0.0
    for i in range(count):
        dx = unwrapped(x[i] - u[i] - drift[0] * elapsed, width)
        dy = unwrapped(y[i] - v[i] - drift[1] * elapsed, width)
        dz = unwrapped(z[i] - w[i] - drift[2] * elapsed, width)
        worst = max(worst, dx * dx + dy * dy + dz * dz)
    return worst > (0.5 * neighbours.validity[SKIN_WIDTH]) ** 2


@inlined
def unwrapped(difference, width):
    """Shortest equivalent of a displacement in m in a box of `width` in m."""
    return difference - width * np.rint(difference / width)


@inlined
def rebuild_lists(scene, particles, neighbours, time, needed):
    """Make new lists, or none where looking at all is faster."""
    count = particles.size[0]
    few = MAX_ALL_PAIRS if neighbours.counts[AGE] >= MIN_LIFETIME else MAX_ALL_PAIRS_SHORT_LIVED
    neighbours.counts[AGE] = 0
    neighbours.counts[LISTED] = 0
    if count <= few:
        return
    width = 2.0 * scene.half_width
    spacing = width / count ** (1.0 / 3.0)
    near = min(needed, COMPLETE_REACH * spacing)
    reach = near + SKIN * spacing
    neighbours.counts[LISTED] = count
    neighbours.validity[COMPLETE_WITHIN] = near
    neighbours.validity[SKIN_WIDTH] = SKIN * spacing
    neighbours.validity[BUILT_AT] = time
    neighbours.drift[:] = 0.0
    for i in range(count):
        for axis in range(3):
            neighbours.built_position[axis, i] = neighbours.position[axis, i]
        velocity = velocity_of(particles.records[i])
        neighbours.drift[0] += velocity[0]
        neighbours.drift[1] += velocity[1]
        neighbours.drift[2] += velocity[2]
    for axis in range(3):
        neighbours.drift[axis] /= count
    list_from_cells(scene, particles, neighbours, max(1, int(width / reach)), reach)


@inlined_allocating
def list_from_cells(scene, particles, neighbours, cells, reach):
    """Collect everything within `reach` in m of each particle from the 27 cells around it.

    Three cells in a row of z lie side by side in memory unless the row crosses a face.
    """
    half = scene.half_width
    span = 1
    if cells < 3:
        cells, span = 1, 0
    order, start = sort_into_cells(particles, cells, half)
    x, y, z = neighbours.position[0], neighbours.position[1], neighbours.position[2]
    candidates = neighbours.candidates
    for i in range(particles.size[0]):
        found = 0
        a, b, c = cells_of(particles.records[i], cells, half)
        for p in range(a - span, a + span + 1):
            for q in range(b - span, b + span + 1):
                row = (wrapped_cell(p, cells) * cells + wrapped_cell(q, cells)) * cells
                low, high = start[row + max(0, c - 1)], start[row + min(cells, c + 2)]
                found = add_candidates(x, y, z, order, low, high, i, half, reach, candidates, found)
                if span == 1 and (c == 0 or c == cells - 1):
                    far = row + cells - 1 - c
                    low, high = start[far], start[far + 1]
                    found = add_candidates(
                        x, y, z, order, low, high, i, half, reach, candidates, found
                    )
        neighbours.found[i] = found if found < MAX_CANDIDATES else -1


@inlined
def add_candidates(x, y, z, order, low, high, i, half, reach, candidates, found):
    """Add those of `order[low:high]` within `reach` in m to the list of i; return its new length.

    Distances are by minimum image under either escape: particles that re-enter keep those across
    the face as candidates, and what is near is decided on use. A list as long as `MAX_CANDIDATES`
    may lack some.
    """
    limit = reach * reach
    for k in range(low, high):
        j = order[k]
        square = square_of(PERIODIC, x[i] - x[j], y[i] - y[j], z[i] - z[j], half)
        candidates[i, min(found, MAX_CANDIDATES - 1)] = j
        found += int((square < limit) & (j != i))
    return found


@inlined
def mark_changed(neighbours, i):
    """Mark particle i, which a contact merged something into or made."""
    if not neighbours.is_changed[i]:
        neighbours.is_changed[i] = True
        neighbours.changed[neighbours.counts[CHANGED]] = i
        neighbours.counts[CHANGED] += 1


@inlined
def square_of(escape, dx, dy, dz, half_width):
    """Square in m² of the distance between two centres; inf to an empty slot."""
    dx = distance_along(escape, dx, half_width)
    dy = distance_along(escape, dy, half_width)
    dz = distance_along(escape, dz, half_width)
    return dx * dx + dy * dy + dz * dz


@inlined
def squared_distance(escape, one, other, half_width):
    """Square in m² of the distance between two particles' centres."""
    return square_of(
        escape, one["x"] - other["x"], one["y"] - other["y"], one["z"] - other["z"], half_width
    )


@inlined
def nearest_of_all(escape, x, y, z, half_width, work, count, i):
    """Squared distance in m² to the nearest particle among all, and its slot; −1 if i is alone."""
    for j in range(count):
        work[j] = square_of(escape, x[i] - x[j], y[i] - y[j], z[i] - z[j], half_width)
    work[i] = np.inf
    best, partner = np.inf, -1
    for j in range(count):
        if work[j] < best:
            best, partner = work[j], j
    return best, partner


@inlined
def nearest_listed(escape, x, y, z, half_width, candidates, found, i):
    """Squared distance in m² to the nearest candidate of i, and its slot; −1 without candidates."""
    best, partner = np.inf, -1
    for k in range(found[i]):
        j = candidates[i, k]
        square = square_of(escape, x[i] - x[j], y[i] - y[j], z[i] - z[j], half_width)
        if square < best:
            best, partner = square, int(j)
    return best, partner


@inlined
def find_partners(scene, particles, neighbours, partner, squared, reach):
    """Find the nearest neighbour of every particle by centre distance, and the square of it in m².

    Certain for those nearer than `reach` in m plus the particle's own radius; −1 if there is none.
    """
    escape, half, count = scene.escape, scene.half_width, particles.size[0]
    x, y, z = neighbours.position[0], neighbours.position[1], neighbours.position[2]
    work = neighbours.work
    candidates, found = neighbours.candidates, neighbours.found
    if neighbours.counts[LISTED] == 0:
        for i in range(count):
            squared[i], partner[i] = nearest_of_all(escape, x, y, z, half, work, count, i)
        return
    near = neighbours.validity[COMPLETE_WITHIN]
    for i in range(count):
        squared[i], partner[i] = nearest_listed(escape, x, y, z, half, candidates, found, i)
        doubtful = squared[i] > near * near and particles.records[i]["radius"] + reach > near
        if doubtful or found[i] < 0:
            squared[i], partner[i] = nearest_of_all(escape, x, y, z, half, work, count, i)


@inlined
def update_partner(scene, particles, neighbours, partner, squared, i):
    """Find the nearest neighbour of i again after contacts merged or made particles.

    Looks at all where the old one is gone, changed or was uncertain, else at the changed ones.
    """
    j = partner[i]
    near = neighbours.validity[COMPLETE_WITHIN] if neighbours.counts[LISTED] > 0 else np.inf
    doubtful = squared[i] > near * near
    if (
        j < 0
        or doubtful
        or neighbours.is_changed[i]
        or neighbours.is_changed[j]
        or particles.records[j]["mass"] == 0.0
    ):
        x, y, z = neighbours.position[0], neighbours.position[1], neighbours.position[2]
        squared[i], partner[i] = nearest_of_all(
            scene.escape, x, y, z, scene.half_width, neighbours.work, particles.size[0], i
        )
        return
    for k in range(neighbours.counts[CHANGED]):
        j = neighbours.changed[k]
        if j != i:
            one, other = particles.records[i], particles.records[j]
            square = squared_distance(scene.escape, one, other, scene.half_width)
            if square < squared[i]:
                squared[i], partner[i] = square, j
