"""State of the event engine beside the particles, and its rebuilding."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined, not_inlined
from agglom_mpi.simulation.event_driven.cells import (
    MAX_ALL_PAIRS,
    OVERSIZE,
    PER_AXIS,
    Cells,
    append_cell,
    append_oversize,
    best_cells,
    choose_range,
    insert,
    max_all_pairs,
    new_cells,
    padded,
    prediction_cost,
    reset_cells,
)
from agglom_mpi.simulation.event_driven.event_queue import EventQueue, new_event_queue, set_time
from agglom_mpi.simulation.event_driven.flights import (
    Flights,
    load_particle,
    new_flights,
    synchronise_particle,
)
from agglom_mpi.simulation.event_driven.image_shifts import begin_shifts
from agglom_mpi.simulation.event_driven.prefetching import new_winners
from agglom_mpi.simulation.particles import compact, largest_radius, reorder
from agglom_mpi.simulation.shear import put_into_box

REBUILD_GAIN: Final = 1.5
"""Factor by which predictions must become cheaper for a rebuild to pay; 1.25 to 2.5 do."""

REBUILD_FRACTION: Final = 8
"""Particles shrink to 1/8 of their number before cells, by now too small, are chosen again."""

SORT_ABOVE: Final = 4096
"""Particles beyond which they are sorted by their cell, for the sake of the caches.

It makes no difference at 10⁴ yet, and a quarter at 10⁶.
"""

PREDICTION_OVERHEAD: Final = 10.0
"""Time of a prediction without pairs, over that of one pair; an estimate, nothing hangs on it."""


class Events(NamedTuple):
    """What the event engine keeps beside the particles.

    Attributes
    ----------
    flights, cells, event_queue
        Trajectories and next events; positions by cell; order of the events.
    due
        Slots of the particles to predict for after the last event, shape (capacity,).
    winners
        Winners of the upper matches of the queue for which memory was prefetched, by node; None for
        few particles.
    counts
        Particles present, and how many of those due are in no cell yet when a run begins, shape
        (2,).
    """

    flights: Flights
    cells: Cells
    event_queue: EventQueue
    due: np.ndarray
    winners: np.ndarray | None
    counts: np.ndarray


ALIVE: Final = 0
NEW: Final = 1
"""Places in `Events.counts`."""


def new_events(count: int, capacity: int) -> Events:
    """Return room for the events of `count` particles at first and at most `capacity`."""
    celled = count if capacity > MAX_ALL_PAIRS else 0
    return Events(
        new_flights(capacity),
        new_cells(celled, capacity),
        new_event_queue(capacity),
        np.empty(capacity, np.int64),
        new_winners(count),
        np.zeros(2, np.int64),
    )


@inlined
def compact_after_merge(scene, particles, ledger, events, due, now):
    """Rebuild if other cells would be cheaper by now, or empty slots have used up the room.

    Returns how many are due: all after a rebuild, else `due`.
    """
    cells, alive = events.cells, events.counts[ALIVE]
    cost = prediction_cost(alive, cells.shape[PER_AXIS], cells.shape[OVERSIZE])
    full = particles.size[0] - alive >= scene.particles
    fewer = cells.shape[PER_AXIS] > 0 and alive < cells.limit[1]
    if cost > cells.limit[0] or full or fewer:
        _, best = best_cells(scene, particles, cells, alive)
        if full or fewer or cost > REBUILD_GAIN * best:
            synchronise(scene, particles, ledger, events, now)
            return rebuild(scene, particles, events, now)
        cells.limit[0] = REBUILD_GAIN * cost
    return due


@not_inlined
def synchronise(scene, particles, ledger, events, now):
    """Move all particles to where they are at `now` in s."""
    for i in range(particles.size[0]):
        if particles.records[i]["mass"] > 0.0:
            synchronise_particle(scene, particles, ledger, events.flights, i, now)
            put_into_box(scene, particles.records[i], ledger, now)


@kernel
def rebuild(scene, particles, events, now):
    """Close the gaps, choose cells and discard all predictions; return how many are due: all.

    They are in no cell yet. A kernel of its own, which is compiled beside the engine.
    """
    before = particles.size[0]
    compact(particles)
    count = particles.size[0]
    events.counts[ALIVE] = count
    cells = events.cells
    per_axis, cost = best_cells(scene, particles, cells, count)
    cells.limit[0] = REBUILD_GAIN * (cost + PREDICTION_OVERHEAD)
    few = max_all_pairs(scene.laws.restitution)
    cells.limit[1] = max(few + 1, count / REBUILD_FRACTION)
    reset_cells(cells, per_axis)
    begin_shifts(scene, cells, now)
    choose_range(scene, cells, largest_radius(particles))
    if count > SORT_ABOVE:
        sort_by_cell(scene, particles, events)
        reset_cells(cells, per_axis)
    for i in range(count, before):
        set_time(events.event_queue, i, np.inf)
    for i in range(count):
        load_particle(events.flights, particles, i, now)
        events.due[i] = i
    return count


@not_inlined
def sort_by_cell(scene, particles, events):
    """Sort the particles by the cells they are in; `Events.due` holds the order meanwhile."""
    flights, cells, order = events.flights, events.cells, events.due
    for i in range(particles.size[0]):
        load_particle(flights, particles, i, 0.0)
        insert(scene, cells, flights, i)
    count, edge = 0, padded(cells.shape[PER_AXIS])
    for number in range(edge * edge * edge):
        count = append_cell(cells, number, order, count)
    append_oversize(cells, order, count)
    reorder(particles, order)
