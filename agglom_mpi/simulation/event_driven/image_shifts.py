"""Shifts: the image of a sheared box passes another cell of its neighbour.

From one shift to the next the rows of cells at the faces of y see the same columns of the image
beyond, one more than in a box at rest. A shift is an event of the box: whoever is in the lowest
row, and the oversize particles, look again; they find those of the highest row.
"""

import math

from agglom_mpi.compilation.stages import inlined, not_inlined
from agglom_mpi.simulation.boundary import is_sheared, shift_time
from agglom_mpi.simulation.event_driven.cells import OVERSIZE, PER_AXIS, SHIFTS
from agglom_mpi.simulation.event_driven.event_queue import earliest_time


@inlined
def begin_shifts(scene, cells, now):
    """Count the shifts up to `now` in s of cells that have been chosen."""
    if is_sheared(scene.escape):
        shifts = now / shift_time(scene.escape, 1, max(1, cells.shape[PER_AXIS]))
        cells.shape[SHIFTS] = math.floor(shifts)


@inlined
def next_shift(scene, cells):
    """Time of the next shift in s; inf where nothing shears, or there are no cells."""
    if cells.shape[PER_AXIS] == 0:
        return math.inf
    return shift_time(scene.escape, cells.shape[SHIFTS] + 1, cells.shape[PER_AXIS])


@inlined
def next_time(scene, events):
    """Time of the next event in s."""
    time = earliest_time(events.event_queue)
    return min(time, next_shift(scene, events.cells)) if is_sheared(scene.escape) else time


@inlined
def is_shift(scene, events, now):
    """Whether the event at `now` in s is a shift."""
    return is_sheared(scene.escape) and next_shift(scene, events.cells) <= now


@not_inlined
def shift(events):
    """Shift the image; return how many particles are due: all that may see others now."""
    cells, due, count = events.cells, events.due, 0
    per_axis, offset = cells.shape[PER_AXIS], cells.offset
    cells.shape[SHIFTS] += 1
    for a in range(per_axis):
        for c in range(per_axis):
            i = cells.head[offset[0, a] + offset[1, 0] + offset[2, c]]
            while i >= 0:
                due[count] = i
                count += 1
                i = cells.next_in_cell[i]
    for k in range(cells.shape[OVERSIZE]):
        due[count + k] = cells.oversize[k]
    return count + cells.shape[OVERSIZE]
