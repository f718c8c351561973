"""Linked cells of the event engine, the particles too large for them, and the choice of the size.

A particle of at most one cell's edge in diameter lives in a cell, and what touches it is in the 27
cells around. An oversize particle is compared with all others. So one aggregate, however
large, costs each of the others one more pair; a few particles are all oversize, without any cells.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, inlined_allocating, not_inlined
from agglom_mpi.simulation.boundary import cell_of

MOST_OVERSIZE: Final = 48
"""Oversize particles beside which cells are considered; more are rarely the cheapest choice."""

BLOCK: Final = 4
"""Cells along an axis of a block."""


class Cells(NamedTuple):
    """Linked lists of the particles in each cell, and the list of oversize particles.

    Attributes
    ----------
    shape
        Cells along an axis (0: all particles are oversize), number of oversize particles,
        shape (2,).
    head
        First particle of each cell, else −1. Cell (a, b, c) has the number place[0, n + a] +
        place[1, n + b] + place[2, n + c].
    place
        Shares of the axes in the number of a cell, for indices from −n to 2n − 1, which come back
        to the box across its faces, shape (3, 3·most). Cells are numbered in blocks of 4³, so
        that neighbours in space are neighbours in memory.
    following, preceding
        Neighbours in the list of a particle's cell, else −1, shape (capacity,).
    oversize
        Particles that live in no cell, shape (capacity,).
    near
        Where the particles to be compared with are gathered, shape (capacity + 1,).
    largest
        Largest radius of an oversize particle in m, shape (1,).
    range
        Distance in m along an axis that an oversize particle moves between two predictions,
        shape (1,).
    limit
        Cost of a look beyond which other cells are considered, and number of particles below which
        they are, shape (2,).
    rank
        Radii of the largest particles in m, descending, shape (MOST_GIANTS + 1,).
    """

    shape: np.ndarray
    head: np.ndarray
    place: np.ndarray
    following: np.ndarray
    preceding: np.ndarray
    oversize: np.ndarray
    near: np.ndarray
    largest: np.ndarray
    range: np.ndarray
    limit: np.ndarray
    rank: np.ndarray


ALONG: Final = 0
OVERSIZE: Final = 1


@inlined
def most_cells(count):
    """Cells along an axis that memory is kept for: two per particle and axis."""
    return int(2.0 * count ** (1.0 / 3.0)) + 1


@inlined
def padded(along):
    """Cells along an axis with the last block filled up."""
    return (along + BLOCK - 1) // BLOCK * BLOCK


@inlined_allocating
def new_cells(count, capacity):
    """Return room for `count` particles at first and at most `capacity`."""
    return Cells(
        np.zeros(2, np.int64),
        np.empty(padded(most_cells(count)) ** 3, np.int32),
        np.empty((3, 3 * most_cells(count)), np.int64),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
        np.empty(capacity + 1, np.uint32),
        np.zeros(1),
        np.zeros(1),
        np.zeros(2),
        np.empty(MOST_OVERSIZE + 1),
    )


@not_inlined
def lay_out(cells, along):
    """Lay out `along`³ empty cells and number them."""
    cells.shape[ALONG] = along
    cells.shape[OVERSIZE] = 0
    cells.largest[0] = 0.0
    blocks = padded(along) // BLOCK
    for index in range(3 * along):
        inner = index % along
        block, rest = inner // BLOCK, inner % BLOCK
        cells.place[0, index] = (block * blocks * blocks * BLOCK + rest) * BLOCK**2
        cells.place[1, index] = (block * blocks * BLOCK**2 + rest) * BLOCK
        cells.place[2, index] = block * BLOCK**3 + rest
    for number in range(padded(along) ** 3):
        cells.head[number] = -1


@inlined
def number_of(cells, next_event):
    """Return the number of the cell that a particle is in."""
    place, along = cells.place, cells.shape[ALONG]
    return (
        place[0, along + next_event["a"]]
        + place[1, along + next_event["b"]]
        + place[2, along + next_event["c"]]
    )


@inlined
def link(cells, next_event, i):
    """Put particle i into its cell."""
    number = number_of(cells, next_event)
    first = cells.head[number]
    cells.head[number] = i
    cells.following[i] = first
    cells.preceding[i] = -1
    if first >= 0:
        cells.preceding[first] = i


@inlined
def unlink(cells, next_event, i):
    """Take particle i out of its cell."""
    before, after = cells.preceding[i], cells.following[i]
    if before >= 0:
        cells.following[before] = after
    else:
        cells.head[number_of(cells, next_event)] = after
    if after >= 0:
        cells.preceding[after] = before


@inlined
def insert(scene, cells, flights, i):
    """Insert particle i into its cell or, if too large, the list of oversize particles."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    along = cells.shape[ALONG]
    if trajectory["radius"] * along <= scene.half_width and along > 0:
        next_event["oversize"] = -1
        next_event["a"] = cell_of(trajectory["x"], along, scene.half_width)
        next_event["b"] = cell_of(trajectory["y"], along, scene.half_width)
        next_event["c"] = cell_of(trajectory["z"], along, scene.half_width)
        link(cells, next_event, i)
    else:
        next_event["oversize"] = cells.shape[OVERSIZE]
        cells.oversize[cells.shape[OVERSIZE]] = i
        cells.largest[0] = max(cells.largest[0], trajectory["radius"])
        cells.shape[OVERSIZE] += 1


@inlined
def remove(cells, flights, i):
    """Remove particle i from its cell or from the list of oversize particles."""
    place = flights.next_event[i]["oversize"]
    if place < 0:
        unlink(cells, flights.next_event[i], i)
        return
    cells.shape[OVERSIZE] -= 1
    last = cells.oversize[cells.shape[OVERSIZE]]
    cells.oversize[place] = last
    flights.next_event[last]["oversize"] = place


FEW: Final = 32
"""Particles up to which all pairs are as cheap as cells; measured, anything from 12 to 48 is."""

FEWEST_CELLS: Final = 4
"""Cells along an axis from which the nearest image is the only one in reach."""

ROOM_TO_GROW: Final = 2.0 ** (1.0 / 3.0)
"""Radius after two equals have merged, over that of one."""

WORTH: Final = 0.5
"""Cost of a look in cells, relative to comparing all, below which cells are worth it; a guess."""

BARELY: Final = 1.0 - 1e-12
"""Share of the cells that fit into the box, lest rounding make a particle oversize that fits."""

CROSSING_COST: Final = 16.0
"""Time of one cell crossing over that of one pair of particles; 16 to 24 measured fastest."""


@inlined
def best_edge(count, diameter, half_width):
    """Edge s in m of the cells that cost least, for many equal particles.

    A collision costs three searches of 27 cells, and as many crossings as cells fit into the mean
    free path λ = 1/(√2 π n d² χ), each with a search of nine. In pairs, with C = CROSSING_COST
    and n particles per volume, that is 81 n s³ + 3 λ/s (C + 9 n s³), least at the root of
    81 n s⁴ + 18 λ n s³ = λ C, which Newton's method approaches from above.
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
def cost_of_look(count, along, oversize):
    """Pairs that one particle of `count` has to be compared with, on average."""
    if along == 0:
        return float(count)
    return 27.0 * (count - oversize) / along**3 + oversize


@inlined
def rank_largest(particles, rank, count):
    """Sort the largest radii in m into `rank`, descending; the mean radius of `count` particles."""
    rank[:] = 0.0
    total, last = 0.0, rank.size - 1
    for i in range(particles.size[0]):
        radius = particles.radius[i]
        total += radius
        if radius > rank[last]:
            k = last
            while k > 0 and rank[k - 1] < radius:
                rank[k] = rank[k - 1]
                k -= 1
            rank[k] = radius
    return total / count


@not_inlined
def best_cells(scene, particles, cells, count):
    """Cells along an axis that make a look cheapest for the `count` particles as they are."""
    if count <= FEW:
        return 0, float(count)
    mean = rank_largest(particles, cells.rank, count)
    edge = best_edge(count, 2.0 * mean, scene.half_width)
    most = min(most_cells(count), cells.place.shape[1] // 3)
    chosen, cheapest = 0, float(count)
    for oversize in range(MOST_OVERSIZE + 1):
        side = max(edge, 2.0 * cells.rank[oversize])
        along = min(most, int(BARELY * 2.0 * scene.half_width / side))
        cost = cost_of_look(count, along, oversize)
        if along >= FEWEST_CELLS and cost < min(cheapest, WORTH * count):
            chosen, cheapest = along, cost
    return chosen, cheapest


@inlined
def choose_range(cells, largest, half_width):
    """Choose how far oversize particles move before they look into the cells around them again.

    At most by a cell; and, with the `largest` radius in m, so little that the nearest image stays
    the only one in reach, where an eighth of D is enough for that.
    """
    if cells.shape[ALONG] > 0:
        spare = 0.5 * (half_width - 2.0 * ROOM_TO_GROW * largest)
        edge = 2.0 * half_width / cells.shape[ALONG]
        cells.range[0] = min(edge, max(0.125 * half_width, min(0.25 * half_width, spare)))
