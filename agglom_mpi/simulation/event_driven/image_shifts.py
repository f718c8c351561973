"""Shifts: the image of a sheared box passes another cell of its neighbour.

From one shift to the next the rows of cells at the faces of y see the same columns of the image
beyond, one more than in a box at rest. A shift is an event of the box: whoever is in the lowest
row, and the oversize particles, look again; they find those of the highest row.
"""

import math

from agglom_mpi.compilation.stages import inlined, not_inlined
from agglom_mpi.simulation.boundary import is_sheared, shift_time
from agglom_mpi.simulation.event_driven.cells import (
    NEXT_SHIFT,
    PER_AXIS,
    SHIFTS,
    append_cell,
    append_oversize,
)
from agglom_mpi.simulation.event_driven.event_queue import earliest_time


@inlined
def begin_shifts(scene, cells, now):
    """Count the shifts up to `now` in s of cells that have been chosen."""
    if is_sheared(scene.escape):
        shifts = now / shift_time(scene.escape, 1, max(1, cells.shape[PER_AXIS]))
        count_shifts(scene, cells, math.floor(shifts))


@inlined
def count_shifts(scene, cells, shifts):
    """Enter the number of shifts, and when the next one is; never if there are no cells."""
    cells.shape[SHIFTS], cells.limit[NEXT_SHIFT] = shifts, math.inf
    if cells.shape[PER_AXIS] > 0:
        cells.limit[NEXT_SHIFT] = shift_time(scene.escape, shifts + 1, cells.shape[PER_AXIS])


@inlined
def next_time(scene, events):
    """Time of the next event in s."""
    time = earliest_time(events.event_queue)
    return min(time, events.cells.limit[NEXT_SHIFT]) if is_sheared(scene.escape) else time


@inlined
def is_shift(scene, events, now):
    """Whether the event at `now` in s is a shift."""
    return is_sheared(scene.escape) and events.cells.limit[NEXT_SHIFT] <= now


@inlined
def shift(scene, events):
    """Shift the image; return how many particles are due: all that may see others now."""
    count_shifts(scene, events.cells, events.cells.shape[SHIFTS] + 1)
    return lowest_row(events.cells, events.due)


@not_inlined
def lowest_row(cells, due):
    """Write the lowest row of particles along y into `due`, and oversize ones; their number."""
    per_axis, offset, count = cells.shape[PER_AXIS], cells.offset, 0
    for a in range(per_axis):
        for c in range(per_axis):
            number = offset[0, a] + offset[1, 0] + offset[2, c]
            count = append_cell(cells, number, due, count)
    return append_oversize(cells, due, count)
