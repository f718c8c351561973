"""Whom may a particle hit?  Those in the cells around it, and the giants."""

import math

import numpy as np

from agglom_mpi.compilation import stage
from agglom_mpi.simulation.box import is_periodic
from agglom_mpi.simulation.events.cells import ALONG, GIANTS


@stage
def low_end(scene, low):  # type: ignore[no-untyped-def]
    """First cell of a range along an axis, cut off at a face that contacts do not cross."""
    return low if is_periodic(scene.escape) else max(low, 0)


@stage
def high_end(scene, along, high):  # type: ignore[no-untyped-def]
    """Last cell of a range along an axis, cut off at a face that contacts do not cross."""
    return high if is_periodic(scene.escape) else min(high, along - 1)


@stage
def gather_box(scene, cells, a0, a1, b0, b1, c0, c1):  # type: ignore[no-untyped-def]
    """Write the particles of the cells from (a0, b0, c0) to (a1, b1, c1) into `near`; how many.

    Without a branch per cell: most cells are empty or hold one, in no order a processor could
    foresee.
    """
    along = cells.shape[ALONG]
    near, head, following, place = cells.near, cells.head, cells.following, cells.place
    a0, a1 = low_end(scene, a0), high_end(scene, along, a1)
    b0, b1 = low_end(scene, b0), high_end(scene, along, b1)
    c0, c1 = low_end(scene, c0), high_end(scene, along, c1)
    count = 0
    for a in range(along + a0, along + a1 + 1):
        for b in range(along + b0, along + b1 + 1):
            row = place[0, a] + place[1, b]
            for c in range(along + c0, along + c1 + 1):
                j = head[row + place[2, c]]
                near[count] = j
                count += 1 if j >= 0 else 0
    k = 0
    while k < count:
        j = following[near[k]]
        near[count] = j
        count += 1 if j >= 0 else 0
        k += 1
    return count


@stage
def span_of_giant(scene, cells, coordinate, radius):  # type: ignore[no-untyped-def]
    """First and last cell along an axis where a giant may be touched before its range ends."""
    along = cells.shape[ALONG]
    edge = 2.0 * scene.half_width / along
    reach = radius + 0.5 * edge + cells.range[0]
    low = math.floor((coordinate - reach + scene.half_width) / edge)
    high = math.floor((coordinate + reach + scene.half_width) / edge)
    if high - low + 1 >= along:
        return 0, along - 1
    return low, high


@stage
def gather(scene, cells, path, plan, x, y, z, face):  # type: ignore[no-untyped-def]
    """Write whom a particle at (x, y, z) in m may hit into `near`; how many.

    `face` is `RANGE` for everybody, or the face through which the particle came into its cell: then
    the nine cells that it had not beside it before, and the giants.
    """
    count = 0
    if plan["giant"] >= 0:
        if cells.shape[ALONG] > 0:
            a0, a1 = span_of_giant(scene, cells, x, path["radius"])
            b0, b1 = span_of_giant(scene, cells, y, path["radius"])
            c0, c1 = span_of_giant(scene, cells, z, path["radius"])
            count = gather_box(scene, cells, a0, a1, b0, b1, c0, c1)
    else:
        a, b, c = np.int64(plan["a"]), np.int64(plan["b"]), np.int64(plan["c"])
        a0 = a + 1 if face == 1 else a - 1
        a1 = a - 1 if face == 0 else a + 1
        b0 = b + 1 if face == 3 else b - 1
        b1 = b - 1 if face == 2 else b + 1
        c0 = c + 1 if face == 5 else c - 1
        c1 = c - 1 if face == 4 else c + 1
        count = gather_box(scene, cells, a0, a1, b0, b1, c0, c1)
    for k in range(cells.shape[GIANTS]):
        cells.near[count + k] = cells.giants[k]
    return count + cells.shape[GIANTS]
