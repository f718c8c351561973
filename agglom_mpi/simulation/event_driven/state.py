"""What the event engine keeps beside the particles, and how it starts over."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, inlined_allocating, not_inlined
from agglom_mpi.simulation.event_driven.cell_crossing import schedule_crossing
from agglom_mpi.simulation.event_driven.cells import (
    ALONG,
    FEW,
    OVERSIZE,
    Cells,
    best_cells,
    choose_range,
    cost_of_look,
    insert,
    lay_out,
    new_cells,
    padded,
)
from agglom_mpi.simulation.event_driven.event_queue import EventQueue, new_event_queue, set_time
from agglom_mpi.simulation.event_driven.flights import (
    NEXT_EVENT,
    TRAJECTORY,
    Flights,
    catch_up_position,
    load_flight,
)
from agglom_mpi.simulation.particles import compact, largest_radius, reorder

GAIN: Final = 1.5
"""How much cheaper a look must become for everybody to look around once more; 1.25 to 2.5 do."""

FEWER: Final = 8
"""Part of the particles left at which cells are chosen anew, since theirs are too small by now."""

MANY: Final = 4096
"""Particles beyond which they are sorted by their place, for the sake of the caches.

It makes no difference at 10⁴ yet, and a quarter at 10⁶.
"""

OVERHEAD: Final = 10.0
"""Time of a look without any pair, over that of one pair; an estimate, nothing hangs on it."""


class Events(NamedTuple):
    """What the event engine keeps beside the particles.

    Attributes
    ----------
    flights, cells, event_queue
        Who flies where, who is near whom, and who is next.
    due
        Who has to look around after the last event, shape (capacity,).
    alive
        Particles there are, shape (1,).
    """

    flights: Flights
    cells: Cells
    event_queue: EventQueue
    due: np.ndarray
    alive: np.ndarray


@inlined_allocating
def new_events(particles):
    """Return empty events for as many particles as there is room for."""
    capacity = particles.mass.size
    celled = particles.size[0] if capacity > FEW else 0
    return Events(
        Flights(np.zeros(capacity, TRAJECTORY), np.zeros(capacity, NEXT_EVENT)),
        new_cells(celled, capacity),
        new_event_queue(capacity),
        np.empty(capacity, np.int64),
        np.zeros(1, np.int64),
    )


@inlined
def settle_in(scene, particles, events, i, now):
    """Start particle i, which is new in its place or its size, at `now` in s."""
    load_flight(events.flights, particles, i, now)
    insert(scene, events.cells, events.flights, i)
    schedule_crossing(scene, events.cells, events.flights, i)


@inlined
def compact_after_merge(scene, particles, events, due, now):
    """Start over if other cells are worth it by now, or empty slots have used up the room.

    Returns how many are due: all, after a fresh start, else `due`.
    """
    cells, alive = events.cells, events.alive[0]
    cost = cost_of_look(alive, cells.shape[ALONG], cells.shape[OVERSIZE])
    full = particles.size[0] - alive >= scene.particles
    fewer = cells.shape[ALONG] > 0 and alive < cells.limit[1]
    if cost > cells.limit[0] or full or fewer:
        _, best = best_cells(scene, particles, cells, alive)
        if full or fewer or cost > GAIN * best:
            settle_all(scene, particles, events, now)
            return rebuild(scene, particles, events, now)
        cells.limit[0] = GAIN * cost
    return due


@not_inlined
def settle_all(scene, particles, events, now):
    """Move everybody to where they are at `now` in s."""
    for i in range(particles.size[0]):
        if particles.mass[i] > 0.0:
            catch_up_position(scene, particles, events.flights, i, now)


@not_inlined
def rebuild(scene, particles, events, now):
    """Close the gaps, choose cells, forget all predictions; how many are due: all."""
    before = particles.size[0]
    compact(particles)
    count = particles.size[0]
    events.alive[0] = count
    cells = events.cells
    along, cost = best_cells(scene, particles, cells, count)
    cells.limit[0] = GAIN * (cost + OVERHEAD)
    cells.limit[1] = max(FEW + 1, count / FEWER)
    lay_out(cells, along)
    choose_range(cells, largest_radius(particles), scene.half_width)
    if count > MANY:
        sort_by_place(scene, particles, events)
        lay_out(cells, along)
    for i in range(count, before):
        set_time(events.event_queue, i, np.inf)
    for i in range(count):
        settle_in(scene, particles, events, i, now)
        events.due[i] = i
    return count


@not_inlined
def sort_by_place(scene, particles, events):
    """Sort the particles by the cells they are in; `Events.due` holds the order meanwhile."""
    flights, cells, order = events.flights, events.cells, events.due
    for i in range(particles.size[0]):
        load_flight(flights, particles, i, 0.0)
        insert(scene, cells, flights, i)
    count = 0
    for number in range(padded(cells.shape[ALONG]) ** 3):
        i = cells.head[number]
        while i >= 0:
            order[count] = i
            count += 1
            i = cells.following[i]
    for k in range(cells.shape[OVERSIZE]):
        order[count + k] = cells.oversize[k]
    reorder(particles, order)
