"""Linked cells of the event engine, the particles too large for them, and the choice of their size.

A particle of at most one cell's edge in diameter lives in a cell, and what touches it is in the 27
cells around. An oversize particle is compared with all others. So one aggregate, however large,
costs each of the others one more pair; a few particles are all oversize, without any cells.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import inlined, not_inlined
from agglom_mpi.physics.restitution import lets_particles_bond
from agglom_mpi.simulation.boundary import cell_of, is_periodic, is_sheared

MAX_OVERSIZE: Final = 128
"""Oversize particles beside which cells are considered; more are rarely the cheapest choice."""

BLOCK: Final = 4
"""Cells along an axis of a block."""


class Cells(NamedTuple):
    """Linked lists of the particles in each cell, and the list of oversize particles.

    Attributes
    ----------
    shape
        Cells per axis n (0: all particles are oversize), number of oversize particles, whole cells
        that the image above a sheared box is ahead; shape (3,).
    head
        First particle of each cell, else −1. Cell (a, b, c) has the number offset[0, n + a] +
        offset[1, n + b] + offset[2, n + c].
    offset
        Shares of the axes in the number of a cell, for indices from −n to 2n − 1, which come back
        to the box across its faces, shape (3, 3·most). Cells are numbered in blocks of 4³, so
        that neighbours in space are neighbours in memory.
    next_in_cell, previous_in_cell
        Neighbours in the list of a particle's cell, else −1, shape (capacity,).
    oversize
        Particles that live in no cell, shape (capacity,).
    candidates
        Work space: the particles to be compared with, shape (capacity + 1,).
    flights
        Trajectories side by side, first of the oversize particles: x, y, z, u, v, w, time, radius,
        shape (8, capacity + 8).
    comparison
        Work space: what `compare` finds of each of them, shape (2, capacity + 8).
    likely_times
        Work space: time in s before which a candidate does not collide, shape (capacity + 1,).
    largest
        Largest radius of an oversize particle in m, shape (1,).
    range
        Distance in m along an axis that an oversize particle moves between two predictions, inf
        without a limit, shape (1,).
    limit
        Cost of a prediction above which other cells are considered, number of particles below
        which they are, and time of the next shift in s (`image_shifts`), shape (3,).
    largest_radii
        Radii of the largest particles in m, descending, shape (MAX_OVERSIZE + 1,).
    """

    shape: np.ndarray
    head: np.ndarray
    offset: np.ndarray
    next_in_cell: np.ndarray
    previous_in_cell: np.ndarray
    oversize: np.ndarray
    candidates: np.ndarray
    flights: np.ndarray
    comparison: np.ndarray
    likely_times: np.ndarray
    largest: np.ndarray
    range: np.ndarray
    limit: np.ndarray
    largest_radii: np.ndarray


PER_AXIS: Final = 0
OVERSIZE: Final = 1
SHIFTS: Final = 2
"""Places in `Cells.shape`."""

NEXT_SHIFT: Final = 2
"""Place of the time in `Cells.limit`."""


def _max_cells(count):
    """Cells per axis that memory is kept for: two per particle and axis."""
    return int(2.0 * count ** (1.0 / 3.0)) + 1


def _padded(per_axis):
    """Cells per axis with the last block filled up."""
    return (per_axis + BLOCK - 1) // BLOCK * BLOCK


max_cells = inlined(_max_cells)
padded = inlined(_padded)


def new_cells(count: int, capacity: int) -> Cells:
    """Return cells with room for `count` particles at first and at most `capacity`."""
    most = _max_cells(count)
    return Cells(
        np.zeros(3, np.int64),
        np.empty(_padded(most) ** 3, np.int32),
        np.empty((3, 3 * most), np.int64),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
        np.empty(capacity + 1, np.uint32),
        np.zeros((8, capacity + 8)),  # those beyond the last are compared, too
        np.empty((2, capacity + 8)),
        np.empty(capacity + 1),
        np.zeros(1),
        np.zeros(1),
        np.zeros(3),
        np.empty(MAX_OVERSIZE + 1),
    )


@not_inlined
def reset_cells(cells, per_axis):
    """Empty the cells and number `per_axis`³ of them."""
    cells.shape[PER_AXIS] = per_axis
    cells.shape[OVERSIZE] = 0
    cells.largest[0] = 0.0
    blocks = padded(per_axis) // BLOCK
    for index in range(3 * per_axis):
        inner = index % per_axis
        block, rest = inner // BLOCK, inner % BLOCK
        cells.offset[0, index] = (block * blocks * blocks * BLOCK + rest) * (BLOCK * BLOCK)
        cells.offset[1, index] = (block * blocks * BLOCK * BLOCK + rest) * BLOCK
        cells.offset[2, index] = block * BLOCK * BLOCK * BLOCK + rest
    edge = blocks * BLOCK
    for number in range(edge * edge * edge):
        cells.head[number] = -1


@inlined
def cell_number(cells, next_event):
    """Return the number of the cell that a particle is in."""
    offset, per_axis = cells.offset, cells.shape[PER_AXIS]
    return (
        offset[0, per_axis + next_event["a"]]
        + offset[1, per_axis + next_event["b"]]
        + offset[2, per_axis + next_event["c"]]
    )


@inlined
def link(cells, next_event, i):
    """Put particle i into the list of its cell."""
    number = cell_number(cells, next_event)
    first = cells.head[number]
    cells.head[number] = i
    cells.next_in_cell[i] = first
    cells.previous_in_cell[i] = -1
    if first >= 0:
        cells.previous_in_cell[first] = i


@inlined
def unlink(cells, next_event, i):
    """Remove particle i from the list of its cell."""
    before, after = cells.previous_in_cell[i], cells.next_in_cell[i]
    if before >= 0:
        cells.next_in_cell[before] = after
    else:
        cells.head[cell_number(cells, next_event)] = after
    if after >= 0:
        cells.previous_in_cell[after] = before


@inlined
def insert(scene, cells, flights, i):
    """Insert particle i into its cell or, if too large, the list of oversize particles."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    per_axis = cells.shape[PER_AXIS]
    if trajectory["radius"] * per_axis <= scene.half_width and per_axis > 0:
        next_event["oversize"] = -1
        next_event["a"] = cell_of(trajectory["x"], per_axis, scene.half_width)
        next_event["b"] = cell_of(trajectory["y"], per_axis, scene.half_width)
        next_event["c"] = cell_of(trajectory["z"], per_axis, scene.half_width)
        link(cells, next_event, i)
    else:
        next_event["oversize"] = cells.shape[OVERSIZE]
        cells.oversize[cells.shape[OVERSIZE]] = i
        copy_flight(cells, cells.shape[OVERSIZE], trajectory)
        cells.largest[0] = max(cells.largest[0], trajectory["radius"])
        cells.shape[OVERSIZE] += 1


@inlined
def copy_flight(cells, k, trajectory):
    """Copy a trajectory to place `k` of those that lie side by side."""
    block = cells.flights
    block[0, k], block[1, k], block[2, k] = trajectory["x"], trajectory["y"], trajectory["z"]
    block[3, k], block[4, k], block[5, k] = trajectory["u"], trajectory["v"], trajectory["w"]
    block[6, k], block[7, k] = trajectory["time"], trajectory["radius"]


@inlined
def copy_if_oversize(cells, flights, i):
    """Copy the changed trajectory of a particle to where it is compared, if it is oversize."""
    index = flights.next_event[i]["oversize"]
    if index >= 0:
        copy_flight(cells, index, flights.trajectory[i])


@inlined
def remove(cells, flights, i):
    """Remove particle i from its cell or from the list of oversize particles."""
    index = flights.next_event[i]["oversize"]
    if index < 0:
        unlink(cells, flights.next_event[i], i)
        return
    cells.shape[OVERSIZE] -= 1
    last = cells.oversize[cells.shape[OVERSIZE]]
    cells.oversize[index] = last
    flights.next_event[last]["oversize"] = index
    copy_flight(cells, index, flights.trajectory[last])


@inlined
def append_cell(cells, number, due, count):
    """Write the particles of a cell behind `count` others; return how many there are then."""
    i = cells.head[number]
    while i >= 0:
        due[count] = i
        count += 1
        i = cells.next_in_cell[i]
    return count


@inlined
def append_oversize(cells, due, count):
    """Write the oversize particles behind `count` others; return how many there are then."""
    for k in range(cells.shape[OVERSIZE]):
        due[count + k] = cells.oversize[k]
    return count + cells.shape[OVERSIZE]


MAX_ALL_PAIRS: Final = 64
"""Particles up to which all pairs are compared, if they are going to stay as many."""

MAX_ALL_PAIRS_MERGING: Final = 128
"""Those up to which they are if they merge: the 100 of a sample of [A] are 10 before cells pay.

Anything from 100 to 256 makes samples of both papers as fast; 32 and 64 make them slower.
"""

MIN_CELLS: Final = 4
"""Cells per axis from which the nearest image is the only one in reach."""

MIN_CELLS_SHEARED: Final = 6
"""The same in shear: an image that moves is in reach of one more cell, and moves by one."""

MERGE_GROWTH: Final = 2.0 ** (1.0 / 3.0)
"""Radius after two equals have merged, over that of one."""

SIDE_BY_SIDE: Final = 0.3
"""Time of a pair with a particle side by side with others, over that of one with one in a cell."""

CELL_ADVANTAGE: Final = 0.5
"""Cost of a prediction with cells, over that of all pairs, below which cells are used; a guess."""

FITTING_SHARE: Final = 1.0 - 1e-12
"""Share of the cells that fit into the box, lest rounding make a particle oversize that fits."""

CROSSING_COST: Final = 16.0
"""Time of one cell crossing over that of one pair of particles; 16 to 24 measured fastest."""


@inlined
def best_edge(count, diameter, half_width):
    """Edge s in m of the cells that cost least, for `count` equal particles of `diameter` in m.

    A collision costs three searches of 27 cells, and as many crossings as cells fit into the mean
    free path λ = 1/(√2 π n d² χ), each with a search of nine; χ is the contact value of Carnahan
    and Starling. In pairs, with C = CROSSING_COST and n particles per volume, that is
    81 n s³ + 3 λ/s (C + 9 n s³), least at the root of 81 n s⁴ + 18 λ n s³ = λ C, which Newton's
    method approaches from above.
    """
    density = count / (8.0 * half_width**3)
    fraction = min(0.5, density * math.pi / 6.0 * diameter**3)
    contact_value = (1.0 - 0.5 * fraction) / (1.0 - fraction) ** 3
    mean_free_path = 1.0 / (math.sqrt(2.0) * math.pi * density * diameter**2 * contact_value)
    edge = (CROSSING_COST / (18.0 * density)) ** (1.0 / 3.0)
    for _ in range(20):
        excess = (
            81.0 * edge + 18.0 * mean_free_path
        ) * density * edge**3 - mean_free_path * CROSSING_COST
        edge -= excess / ((324.0 * edge + 54.0 * mean_free_path) * density * edge**2)
    return edge


@inlined
def prediction_cost(count, per_axis, oversize):
    """Time of a prediction for one of `count` particles, in pairs with one in a cell."""
    if per_axis == 0:
        return SIDE_BY_SIDE * count
    return 27.0 * (count - oversize) / (per_axis * per_axis * per_axis) + SIDE_BY_SIDE * oversize


@inlined
def find_largest_radii(particles, largest_radii, count):
    """Write the largest radii in m into `largest_radii`, descending; return the mean radius."""
    largest_radii[:] = 0.0
    total, last = 0.0, largest_radii.size - 1
    for i in range(particles.size[0]):
        radius = particles.records[i]["radius"]
        total += radius
        if radius > largest_radii[last]:
            k = last
            while k > 0 and largest_radii[k - 1] < radius:
                largest_radii[k] = largest_radii[k - 1]
                k -= 1
            largest_radii[k] = radius
    return total / count


@inlined
def max_all_pairs(restitution):
    """Particles up to which all pairs are compared, by whether the law lets them merge."""
    return MAX_ALL_PAIRS_MERGING if lets_particles_bond(restitution) else MAX_ALL_PAIRS


@not_inlined
def best_cells(scene, particles, cells, count):
    """Cells per axis with the cheapest predictions for the particles now, and their cost."""
    all_pairs = prediction_cost(count, 0, count)
    if count <= max_all_pairs(scene.laws.restitution):
        return 0, all_pairs
    mean = find_largest_radii(particles, cells.largest_radii, count)
    edge = best_edge(count, 2.0 * mean, scene.half_width)
    most = min(max_cells(count), cells.offset.shape[1] // 3)
    fewest = MIN_CELLS_SHEARED if is_sheared(scene.escape) else MIN_CELLS
    chosen, cheapest = 0, all_pairs
    for oversize in range(MAX_OVERSIZE + 1):
        side = max(edge, 2.0 * cells.largest_radii[oversize])
        per_axis = min(most, int(FITTING_SHARE * 2.0 * scene.half_width / side))
        cost = prediction_cost(count, per_axis, oversize)
        if per_axis >= fewest and cost < min(cheapest, CELL_ADVANTAGE * all_pairs):
            chosen, cheapest = per_axis, cost
    return chosen, cheapest


@inlined
def choose_range(scene, cells, largest):
    """Choose how far oversize particles move before they are compared with all in reach again.

    At most by a cell; and, with the `largest` radius in m, so little that the nearest image stays
    the only one in reach, where an eighth of D is enough for that. Without cells only images need
    a range; where it would not do, there is none.
    """
    half = scene.half_width
    if cells.shape[PER_AXIS] > 0:
        spare = 0.5 * (half - 2.0 * MERGE_GROWTH * largest)
        edge = 2.0 * half / cells.shape[PER_AXIS]
        cells.range[0] = min(edge, max(0.125 * half, min(0.25 * half, spare)))
    elif is_periodic(scene.escape) and 2.0 * MERGE_GROWTH * largest <= 0.5 * half:
        cells.range[0] = 0.25 * half
    else:
        cells.range[0] = np.inf
