"""Who can be hit?  Cells hold the many, a list holds the few that are too large for cells.

A particle of at most one cell's edge in diameter lives in a cell, and what touches it is in the 27
cells around. A giant is compared with everybody. So one aggregate, however large, costs each of the
others one more pair; and a few particles are all giants, without any cells.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, stage
from agglom_mpi.simulation.cells import cell_of

FEW: Final = 32
"""Particles up to which all pairs are cheaper than cells; measured."""

MOST_GIANTS: Final = 48
"""Giants beside which cells are considered."""

FEWEST_CELLS: Final = 4
"""Cells along an axis from which the nearest image is the only one in reach."""

ROOM_TO_GROW: Final = 2.0 ** (1.0 / 3.0)
"""Radius after two equals have merged, over that of one."""

BLOCK: Final = 4
"""Cells along an axis of a block."""

WORTH: Final = 0.5
"""Cost of a look in cells, relative to comparing all, below which cells are worth it."""

CROSSING_COST: Final = 16.0
"""Time of one cell crossing over that of one pair of particles; measured."""


class Cells(NamedTuple):
    """Linked lists of the particles in each cell, and the list of giants.

    Attributes
    ----------
    shape
        Cells along an axis (0: everybody is a giant), number of giants, shape (2,).
    head
        First particle of each cell, else −1. Cell (a, b, c) has the number place[0, n + a] +
        place[1, n + b] + place[2, n + c].
    place
        Shares of the axes in the number of a cell, for indices from −n to 2n − 1, which come back
        to the box across its faces, shape (3, 3·most). Cells are numbered in blocks of 4³, so
        that neighbours in space are neighbours in memory.
    following, preceding
        Neighbours in the list of a particle's cell, else −1, shape (capacity,).
    giants
        Particles that live in no cell, shape (capacity,).
    near
        Where the particles to be compared with are gathered, shape (capacity + 1,).
    largest
        Largest radius of a giant in m, shape (1,).
    range
        Distance in m along an axis that a giant moves before it looks around again, shape (1,).
    limit
        Cost of a look beyond which other cells are considered, shape (1,).
    rank
        Radii of the largest particles in m, descending, shape (MOST_GIANTS + 1,).
    """

    shape: np.ndarray
    head: np.ndarray
    place: np.ndarray
    following: np.ndarray
    preceding: np.ndarray
    giants: np.ndarray
    near: np.ndarray
    largest: np.ndarray
    range: np.ndarray
    limit: np.ndarray
    rank: np.ndarray


ALONG: Final = 0
GIANTS: Final = 1


@stage
def most_cells(count):  # type: ignore[no-untyped-def]
    """Cells along an axis that memory is kept for: two per particle and axis."""
    return int(2.0 * count ** (1.0 / 3.0)) + 1


@stage
def padded(along):  # type: ignore[no-untyped-def]
    """Cells along an axis with the last block filled up."""
    return (along + BLOCK - 1) // BLOCK * BLOCK


@allocating
def new_cells(count, capacity):  # type: ignore[no-untyped-def]
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
        np.zeros(1),
        np.empty(MOST_GIANTS + 1),
    )


@stage
def best_edge(count, diameter, half_width):  # type: ignore[no-untyped-def]
    """Edge s in m of the cells that cost least, for many equal particles.

    A collision costs three searches of 27 cells, and as many crossings as cells fit into the mean
    free path λ = 1/(√2 π n d² χ), each with a search of nine. In pairs, with C = CROSSING_COST and
    n particles per volume, that is 81 n s³ + 3 λ/s (C + 9 n s³), least at the root of
    81 n s⁴ + 18 λ n s³ = λ C, which Newton's method approaches from above.
    """
    density = count / (8.0 * half_width**3)
    fraction = min(0.5, density * math.pi / 6.0 * diameter**3)
    contact_value = (1.0 - 0.5 * fraction) / (1.0 - fraction) ** 3
    path = 1.0 / (math.sqrt(2.0) * math.pi * density * diameter**2 * contact_value)
    edge = (CROSSING_COST / (18.0 * density)) ** (1.0 / 3.0)
    for _ in range(20):
        excess = (81.0 * edge + 18.0 * path) * density * edge**3 - path * CROSSING_COST
        edge -= excess / ((324.0 * edge + 54.0 * path) * density * edge**2)
    return edge


@stage
def cost_of_look(count, along, giants):  # type: ignore[no-untyped-def]
    """Pairs that one particle of `count` has to be compared with, on average."""
    if along == 0:
        return float(count)
    return 27.0 * (count - giants) / along**3 + giants


@stage
def rank_largest(particles, rank):  # type: ignore[no-untyped-def]
    """Sort the largest radii in m into `rank`, descending; the mean radius of all."""
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
    return total / particles.size[0]


@stage
def best_cells(scene, particles, cells, count):  # type: ignore[no-untyped-def]
    """Cells along an axis that make a look cheapest for the `count` particles as they are."""
    if count <= FEW:
        return 0, float(count)
    mean = rank_largest(particles, cells.rank)
    edge = best_edge(count, 2.0 * mean, scene.half_width)
    most = min(most_cells(count), cells.place.shape[1] // 3)
    chosen, cheapest = 0, float(count)
    for giants in range(MOST_GIANTS + 1):
        side = max(edge, 2.0 * cells.rank[giants])
        along = min(most, int(2.0 * scene.half_width / side))
        cost = cost_of_look(count, along, giants)
        if along >= FEWEST_CELLS and cost < min(cheapest, WORTH * count):
            chosen, cheapest = along, cost
    return chosen, cheapest


@stage
def lay_out(cells, along):  # type: ignore[no-untyped-def]
    """Lay out `along`³ empty cells and number them."""
    cells.shape[ALONG] = along
    cells.shape[GIANTS] = 0
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


@stage
def choose_range(cells, largest, half_width):  # type: ignore[no-untyped-def]
    """Let giants look around often enough for the nearest image to be the only one in reach.

    That holds for sums of radii up to D minus what two of them move; `largest` radius in m, which
    may grow by a merge. Beyond, `heed_images` takes care.
    """
    spare = 0.5 * (half_width - 2.0 * ROOM_TO_GROW * largest)
    cells.range[0] = min(max(0.125 * half_width, spare), 0.25 * half_width)
    if cells.shape[ALONG] > 0:
        cells.range[0] = min(cells.range[0], 2.0 * half_width / cells.shape[ALONG])


@stage
def number_of(cells, mover):  # type: ignore[no-untyped-def]
    """Return the number of the cell that a particle is in."""
    place, along = cells.place, cells.shape[ALONG]
    return (
        place[0, along + mover["a"]] + place[1, along + mover["b"]] + place[2, along + mover["c"]]
    )


@stage
def link(cells, mover, i):  # type: ignore[no-untyped-def]
    """Put particle i into its cell."""
    number = number_of(cells, mover)
    first = cells.head[number]
    cells.head[number] = i
    cells.following[i] = first
    cells.preceding[i] = -1
    if first >= 0:
        cells.preceding[first] = i


@stage
def unlink(cells, mover, i):  # type: ignore[no-untyped-def]
    """Take particle i out of its cell."""
    before, after = cells.preceding[i], cells.following[i]
    if before >= 0:
        cells.following[before] = after
    else:
        cells.head[number_of(cells, mover)] = after
    if after >= 0:
        cells.preceding[after] = before


@stage
def enter(scene, cells, movers, i):  # type: ignore[no-untyped-def]
    """Put particle i where its position and its size want it: into a cell, or among the giants."""
    mover = movers[i]
    along = cells.shape[ALONG]
    if mover["radius"] * along <= scene.half_width and along > 0:
        mover["giant"] = -1
        mover["a"] = cell_of(mover["x"], along, scene.half_width)
        mover["b"] = cell_of(mover["y"], along, scene.half_width)
        mover["c"] = cell_of(mover["z"], along, scene.half_width)
        link(cells, mover, i)
    else:
        mover["giant"] = cells.shape[GIANTS]
        cells.giants[cells.shape[GIANTS]] = i
        cells.largest[0] = max(cells.largest[0], mover["radius"])
        cells.shape[GIANTS] += 1


@stage
def leave(cells, movers, i):  # type: ignore[no-untyped-def]
    """Take particle i out of its cell or of the giants."""
    place = movers[i]["giant"]
    if place < 0:
        unlink(cells, movers[i], i)
        return
    cells.shape[GIANTS] -= 1
    last = cells.giants[cells.shape[GIANTS]]
    cells.giants[place] = last
    movers[last]["giant"] = place
