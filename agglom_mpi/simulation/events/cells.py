"""Who can be hit?  Cells hold the many, a list holds the few that are too large for cells.

A particle of at most one cell's edge in diameter lives in a cell, and what touches it is in the 27
cells around. A giant is compared with everybody. So one aggregate, however large, costs each of the
others one more pair; and a few particles are all giants, without any cells.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, rare_stage, stage
from agglom_mpi.simulation.cells import cell_of

MOST_GIANTS: Final = 48
"""Giants beside which cells are considered; more are rarely the cheapest choice."""

BLOCK: Final = 4
"""Cells along an axis of a block."""


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
        Distance in m along an axis that a giant beside cells moves between looks, shape (1,).
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
        np.zeros(2),
        np.empty(MOST_GIANTS + 1),
    )


@rare_stage
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
def number_of(cells, plan):  # type: ignore[no-untyped-def]
    """Return the number of the cell that a particle is in."""
    place, along = cells.place, cells.shape[ALONG]
    return place[0, along + plan["a"]] + place[1, along + plan["b"]] + place[2, along + plan["c"]]


@stage
def link(cells, plan, i):  # type: ignore[no-untyped-def]
    """Put particle i into its cell."""
    number = number_of(cells, plan)
    first = cells.head[number]
    cells.head[number] = i
    cells.following[i] = first
    cells.preceding[i] = -1
    if first >= 0:
        cells.preceding[first] = i


@stage
def unlink(cells, plan, i):  # type: ignore[no-untyped-def]
    """Take particle i out of its cell."""
    before, after = cells.preceding[i], cells.following[i]
    if before >= 0:
        cells.following[before] = after
    else:
        cells.head[number_of(cells, plan)] = after
    if after >= 0:
        cells.preceding[after] = before


@stage
def enter(scene, cells, movers, i):  # type: ignore[no-untyped-def]
    """Put particle i where its position and its size want it: into a cell, or among the giants."""
    path, plan = movers.path[i], movers.plan[i]
    along = cells.shape[ALONG]
    if path["radius"] * along <= scene.half_width and along > 0:
        plan["giant"] = -1
        plan["a"] = cell_of(path["x"], along, scene.half_width)
        plan["b"] = cell_of(path["y"], along, scene.half_width)
        plan["c"] = cell_of(path["z"], along, scene.half_width)
        link(cells, plan, i)
    else:
        plan["giant"] = cells.shape[GIANTS]
        cells.giants[cells.shape[GIANTS]] = i
        cells.largest[0] = max(cells.largest[0], path["radius"])
        cells.shape[GIANTS] += 1


@stage
def leave(cells, movers, i):  # type: ignore[no-untyped-def]
    """Take particle i out of its cell or of the giants."""
    place = movers.plan[i]["giant"]
    if place < 0:
        unlink(cells, movers.plan[i], i)
        return
    cells.shape[GIANTS] -= 1
    last = cells.giants[cells.shape[GIANTS]]
    cells.giants[place] = last
    movers.plan[last]["giant"] = place
