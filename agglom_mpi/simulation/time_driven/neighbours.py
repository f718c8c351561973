"""Who is nearest?  Candidate lists, rebuilt only when needed, or a look at everybody.

A list holds everything within `reach` of a particle when it is built. While no particle has moved
farther than half of the skin, relative to the mean drift, whatever is nearer than reach − skin is
in the list; a particle that sees nothing that near looks at all others.
Lists are read once a step, before its contacts; what these displace is looked up among all.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, inlined_allocating
from agglom_mpi.simulation.boundary import (
    Periodic,
    cell_of,
    distance_along,
    sort_into_cells,
    wrapped_cell,
)

FEW: Final = 40
"""Up to this many particles it is faster to look at all; by measurement."""

FEW_WHILE_FAST: Final = 250
"""The same where lists are out of date after fewer than `LASTING` steps."""

LASTING: Final = 4

CERTAIN: Final = 1.15
SKIN: Final = 0.35
"""How far lists are complete at most, and their skin, over the mean spacing (volume/N)^⅓."""

ROOM: Final = 64
"""Room for the candidates of one particle; 13 are the rule. Whoever lacks it looks at all."""


class NeighbourList(NamedTuple):
    """Candidate lists and what tells whether they hold.

    Attributes
    ----------
    candidates, found
        The candidates of particle i are the first `found[i]` of row i; −1 if they are too many.
    home
        Positions in m when the lists were built, shape (3, capacity).
    drift
        Mean velocity in m/s then, shape (3,).
    moved, is_moved
        Particles that the contacts of this step merged or made: their number is in `tally`.
    tally
        Particles with lists (0: look at all), number of `moved`, steps that the lists have lasted.
    scale
        Distance in m below which lists are complete, skin in m, time in s when they were built.
    row
        Work space: squared distances in m².
    """

    candidates: np.ndarray
    found: np.ndarray
    home: np.ndarray
    drift: np.ndarray
    moved: np.ndarray
    is_moved: np.ndarray
    tally: np.ndarray
    scale: np.ndarray
    row: np.ndarray


LISTED: Final = 0
MOVED: Final = 1
AGE: Final = 2
"""Places in `Neighbours.tally`."""

NEAR: Final = 0
SLACK: Final = 1
BUILT_AT: Final = 2
"""Places in `Neighbours.scale`."""


@inlined_allocating
def new_neighbour_list(capacity):
    """Room for the lists of `capacity` particles, out of date; none where they are few for ever."""
    listed = capacity if capacity > FEW else 0
    return NeighbourList(
        np.empty((listed, ROOM), np.int32),
        np.empty(listed, np.int32),
        np.empty((3, listed)),
        np.zeros(3),
        np.empty(capacity, np.int64),
        np.zeros(capacity, np.bool_),
        np.zeros(3, np.int64),
        np.zeros(3),
        np.empty(capacity),
    )


@inlined
def update_neighbours(scene, particles, neighbours, time, compacted, wanted):
    """Make the lists hold at `time` in s for neighbours nearer than `wanted` in m, or less far.

    `compacted` says that particles changed their places.
    """
    for k in range(neighbours.tally[MOVED]):
        neighbours.is_moved[neighbours.moved[k]] = False
    neighbours.tally[MOVED] = 0
    neighbours.tally[AGE] += 1
    if compacted or out_of_date(scene, particles, neighbours, time):
        rebuild(scene, particles, neighbours, time, wanted)


@inlined
def out_of_date(scene, particles, neighbours, time):
    """Whether particles were added, or one moved beyond half of the skin, since the lists."""
    count = particles.size[0]
    if count != neighbours.tally[LISTED]:
        return neighbours.tally[LISTED] > 0 or (count > FEW and neighbours.tally[AGE] >= LASTING)
    elapsed = time - neighbours.scale[BUILT_AT]
    width = 2.0 * scene.half_width
    x, y, z = particles.position[0], particles.position[1], particles.position[2]
    u, v, w = neighbours.home[0], neighbours.home[1], neighbours.home[2]
    drift = neighbours.drift
    worst = 0.0
    for i in range(count):
        dx = unwrapped(x[i] - u[i] - drift[0] * elapsed, width)
        dy = unwrapped(y[i] - v[i] - drift[1] * elapsed, width)
        dz = unwrapped(z[i] - w[i] - drift[2] * elapsed, width)
        worst = max(worst, dx * dx + dy * dy + dz * dz)
    return worst > (0.5 * neighbours.scale[SLACK]) ** 2


@inlined
def unwrapped(difference, width):
    """Shortest equivalent of a displacement in m in a box of `width` in m."""
    return difference - width * np.rint(difference / width)


@inlined
def rebuild(scene, particles, neighbours, time, wanted):
    """Make new lists, or none where looking at all is faster."""
    count = particles.size[0]
    few = FEW if neighbours.tally[AGE] >= LASTING else FEW_WHILE_FAST
    neighbours.tally[AGE] = 0
    neighbours.tally[LISTED] = 0
    if count <= few:
        return
    width = 2.0 * scene.half_width
    spacing = width / count ** (1.0 / 3.0)
    near = min(wanted, CERTAIN * spacing)
    reach = near + SKIN * spacing
    neighbours.tally[LISTED] = count
    neighbours.scale[NEAR] = near
    neighbours.scale[SLACK] = SKIN * spacing
    neighbours.scale[BUILT_AT] = time
    for axis in range(3):
        total = 0.0
        for i in range(count):
            neighbours.home[axis, i] = particles.position[axis, i]
            total += particles.velocity[axis, i]
        neighbours.drift[axis] = total / count
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
    x, y, z = particles.position[0], particles.position[1], particles.position[2]
    candidates = neighbours.candidates
    for i in range(particles.size[0]):
        found = 0
        a, b, c = cell_of(x[i], cells, half), cell_of(y[i], cells, half), cell_of(z[i], cells, half)
        for p in range(a - span, a + span + 1):
            for q in range(b - span, b + span + 1):
                row = (wrapped_cell(p, cells) * cells + wrapped_cell(q, cells)) * cells
                low, high = start[row + max(0, c - 1)], start[row + min(cells, c + 2)]
                found = add_near(x, y, z, order, low, high, i, half, reach, candidates, found)
                if span == 1 and (c == 0 or c == cells - 1):
                    far = row + cells - 1 - c
                    low, high = start[far], start[far + 1]
                    found = add_near(x, y, z, order, low, high, i, half, reach, candidates, found)
        neighbours.found[i] = found if found < ROOM else -1


@inlined
def add_near(x, y, z, order, low, high, i, half, reach, candidates, found):
    """Add those of `order[low:high]` within `reach` in m to the list of i; its new length.

    Distances are by minimum image under either escape: who re-enters keeps those across the face as
    candidates, and what is near is decided on use. A list as long as `ROOM` may lack some.
    """
    limit = reach * reach
    for k in range(low, high):
        j = order[k]
        square = square_of(Periodic(), x[i] - x[j], y[i] - y[j], z[i] - z[j], half)
        candidates[i, min(found, ROOM - 1)] = j
        found += int((square < limit) & (j != i))
    return found


@inlined
def note_moved(neighbours, i):
    """Remember that a contact merged something into particle i, or made it."""
    if not neighbours.is_moved[i]:
        neighbours.is_moved[i] = True
        neighbours.moved[neighbours.tally[MOVED]] = i
        neighbours.tally[MOVED] += 1


@inlined
def square_of(escape, dx, dy, dz, half_width):
    """Square in m² of the distance between two centres; inf to an empty slot."""
    dx = distance_along(escape, dx, half_width)
    dy = distance_along(escape, dy, half_width)
    dz = distance_along(escape, dz, half_width)
    return dx * dx + dy * dy + dz * dz


@inlined
def squared_distance(escape, position, i, j, half_width):
    """Square in m² of the distance between two particles' centres."""
    return square_of(
        escape,
        position[0, i] - position[0, j],
        position[1, i] - position[1, j],
        position[2, i] - position[2, j],
        half_width,
    )


@inlined
def nearest_of_all(escape, x, y, z, half_width, row, count, i):
    """Squared distance in m² to the nearest particle among all, and who; −1 if i is alone."""
    for j in range(count):
        row[j] = square_of(escape, x[i] - x[j], y[i] - y[j], z[i] - z[j], half_width)
    row[i] = np.inf
    best, partner = np.inf, -1
    for j in range(count):
        if row[j] < best:
            best, partner = row[j], j
    return best, partner


@inlined
def nearest_listed(escape, x, y, z, half_width, candidates, found, i):
    """Squared distance in m² to the nearest candidate of i, and who; −1 without candidates."""
    best, partner = np.inf, -1
    for k in range(found[i]):
        j = candidates[i, k]
        square = square_of(escape, x[i] - x[j], y[i] - y[j], z[i] - z[j], half_width)
        if square < best:
            best, partner = square, int(j)
    return best, partner


@inlined
def find_partners(scene, particles, neighbours, partner, squared, reach):
    """Fill in everybody's nearest neighbour by centre distance, and the squared distance in m².

    Certain for those nearer than `reach` in m plus the particle's own radius; −1 if there is none.
    """
    escape, half, count = scene.escape, scene.half_width, particles.size[0]
    x, y, z = particles.position[0], particles.position[1], particles.position[2]
    radius, row = particles.radius, neighbours.row
    candidates, found = neighbours.candidates, neighbours.found
    if neighbours.tally[LISTED] == 0:
        for i in range(count):
            squared[i], partner[i] = nearest_of_all(escape, x, y, z, half, row, count, i)
        return
    near = neighbours.scale[NEAR]
    for i in range(count):
        squared[i], partner[i] = nearest_listed(escape, x, y, z, half, candidates, found, i)
        doubtful = squared[i] > near * near and radius[i] + reach > near
        if doubtful or found[i] < 0:
            squared[i], partner[i] = nearest_of_all(escape, x, y, z, half, row, count, i)


@inlined
def update_partner(scene, particles, neighbours, partner, squared, i):
    """Bring the nearest neighbour of i up to date after contacts merged or made particles.

    Looks at all where the old one is gone, changed or was uncertain, else at the changed ones.
    """
    j = partner[i]
    near = neighbours.scale[NEAR] if neighbours.tally[LISTED] > 0 else np.inf
    doubtful = squared[i] > near * near
    if (
        j < 0
        or doubtful
        or neighbours.is_moved[i]
        or neighbours.is_moved[j]
        or particles.mass[j] == 0.0
    ):
        x, y, z = particles.position[0], particles.position[1], particles.position[2]
        squared[i], partner[i] = nearest_of_all(
            scene.escape, x, y, z, scene.half_width, neighbours.row, particles.size[0], i
        )
        return
    for k in range(neighbours.tally[MOVED]):
        j = neighbours.moved[k]
        if j != i:
            square = squared_distance(scene.escape, particles.position, i, j, scene.half_width)
            if square < squared[i]:
                squared[i], partner[i] = square, j
