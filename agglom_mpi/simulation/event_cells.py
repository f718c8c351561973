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

MOST_GIANTS: Final = 8
"""Giants that cells are chosen for, and beyond which they are chosen anew."""

FEWEST_CELLS: Final = 4
"""Cells along an axis from which the nearest image is the only one in reach."""

CROSSING_COST: Final = 16.0
"""Time of one cell crossing over that of one pair of particles; measured."""


class Cells(NamedTuple):
    """Linked lists of the particles in each cell, and the list of giants.

    Attributes
    ----------
    shape
        Cells along an axis (0: everybody is a giant), number of giants, number of particles when
        the cells were chosen, shape (3,).
    head
        First particle of each cell, else −1; cell (a, b, c) has the number (a·n + b)·n + c.
    following, preceding
        Neighbours in the list of a particle's cell, else −1, shape (capacity,).
    giants
        Particles that live in no cell, shape (capacity,).
    near
        Where the particles to be compared with are gathered, shape (capacity + 1,).
    largest
        Largest radius of a giant in m, shape (1,).
    """

    shape: np.ndarray
    head: np.ndarray
    following: np.ndarray
    preceding: np.ndarray
    giants: np.ndarray
    near: np.ndarray
    largest: np.ndarray


ALONG: Final = 0
GIANTS: Final = 1
FORMER: Final = 2


@stage
def most_cells(count):  # type: ignore[no-untyped-def]
    """Cells along an axis that memory is kept for: two per particle and axis."""
    return int(2.0 * count ** (1.0 / 3.0)) + 1


@allocating
def new_cells(count, capacity):  # type: ignore[no-untyped-def]
    """Return room for `count` particles at first and at most `capacity`."""
    return Cells(
        np.zeros(3, np.int64),
        np.empty(most_cells(count) ** 3, np.int32),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
        np.empty(capacity + 1, np.uint32),
        np.zeros(1),
    )


@stage
def best_edge(count, diameter, half_width):  # type: ignore[no-untyped-def]
    """Edge in m of the cells that cost least, for many equal particles.

    A collision costs two to three searches of 27 cells, and as many crossings of cell walls as fit
    into the mean free path λ = 1/(√2 π n d² χ). The sum, 81 n s³ pairs and 3λ/s crossings per
    collision, is least at s⁴ = λ CROSSING_COST/(81 n).
    """
    volume = 8.0 * half_width**3
    density = count / volume
    fraction = min(0.5, density * math.pi / 6.0 * diameter**3)
    crowding = (1.0 - 0.5 * fraction) / (1.0 - fraction) ** 3
    path = 1.0 / (math.sqrt(2.0) * math.pi * density * diameter**2 * crowding)
    return (path * CROSSING_COST / (81.0 * density)) ** 0.25


@allocating
def choose_cells(scene, particles, cells):  # type: ignore[no-untyped-def]
    """Choose the size of the cells, and with it the giants, for the particles as they are."""
    count = particles.size[0]
    cells.shape[GIANTS] = 0
    cells.shape[FORMER] = count
    cells.shape[ALONG] = 0
    if count <= FEW:
        return
    largest = np.zeros(MOST_GIANTS + 1)
    total = 0.0
    for i in range(count):
        radius = particles.radius[i]
        total += radius
        k = MOST_GIANTS
        if radius > largest[k]:
            while k > 0 and largest[k - 1] < radius:
                largest[k] = largest[k - 1]
                k -= 1
            largest[k] = radius
    edge = best_edge(count, 2.0 * total / count, scene.half_width)
    cheapest = float(count)
    for giants in range(MOST_GIANTS + 1):
        side = max(edge, 2.0 * largest[giants])
        along = min(most_cells(count), int(2.0 * scene.half_width / side))
        along = min(along, round(cells.head.size ** (1.0 / 3.0)))
        cost = 27.0 * count / max(1, along) ** 3 + giants
        if along >= FEWEST_CELLS and cost < 0.5 * cheapest:
            cheapest = cost
            cells.shape[ALONG] = along


@stage
def clear_cells(cells):  # type: ignore[no-untyped-def]
    """Empty all cells."""
    for number in range(cells.shape[ALONG] ** 3):
        cells.head[number] = -1
    cells.shape[GIANTS] = 0
    cells.largest[0] = 0.0


@stage
def cell_number(along, a, b, c):  # type: ignore[no-untyped-def]
    """Number of the cell (a, b, c) of `along`³."""
    return (a * along + b) * along + c


@stage
def link(cells, mover, i):  # type: ignore[no-untyped-def]
    """Put particle i into its cell."""
    number = cell_number(cells.shape[ALONG], mover["a"], mover["b"], mover["c"])
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
        cells.head[cell_number(cells.shape[ALONG], mover["a"], mover["b"], mover["c"])] = after
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
