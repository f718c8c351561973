"""The event-driven engine: every hit at its exact time, and work only for who is touched.

Each particle knows its earliest hit and when it leaves its cell; a tournament tells who is next.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, stage
from agglom_mpi.simulation.contact import BONDED, collide, merge
from agglom_mpi.simulation.engines import advance
from agglom_mpi.simulation.event_cells import (
    ALONG,
    GIANTS,
    Cells,
    best_cells,
    choose_range,
    cost_of_look,
    enter,
    lay_out,
    leave,
    new_cells,
    padded,
)
from agglom_mpi.simulation.frame import enter_frame, leave_frame
from agglom_mpi.simulation.movers import (
    MOVER,
    RANGE,
    catch_up_position,
    load_mover,
    load_velocity,
    void,
)
from agglom_mpi.simulation.particles import EXHAUSTED, STEPS, compact, reorder
from agglom_mpi.simulation.prediction import look
from agglom_mpi.simulation.scene import EventDriven
from agglom_mpi.simulation.stepping import aborted, largest_radius
from agglom_mpi.simulation.tournament import (
    Tournament,
    earliest,
    earliest_time,
    new_tournament,
    set_time,
)
from agglom_mpi.simulation.turns import set_turn, turn

NOBODY: Final = -1

GAIN: Final = 1.5
"""How much cheaper a look must become for everybody to look around once more."""

MANY: Final = 4096
"""Particles beyond which they are sorted by their place, for the sake of the caches; measured."""

OVERHEAD: Final = 10.0
"""Time of a look without any pair, over that of one pair; measured."""


class Events(NamedTuple):
    """What the event engine keeps beside the particles.

    Attributes
    ----------
    movers
        Records of `MOVER`, shape (capacity,).
    cells, tournament
        Who is near whom, and who is next.
    due
        Who has to look around after the last event, shape (capacity,).
    alive
        Particles there are, shape (1,).
    """

    movers: np.ndarray
    cells: Cells
    tournament: Tournament
    due: np.ndarray
    alive: np.ndarray


class Happening(NamedTuple):
    """An event.

    Attributes
    ----------
    due
        How many have to look around now; `Events.due` says who.
    face
        The face through which the only one due came into its cell, or `RANGE`: look everywhere.
    kind
        What `collide` returned, or `NO_HIT`.
    i, j
        The slots that were hit, i < j, or −1.
    parted
        Whether the two go on as two, and so do not look at each other.
    """

    due: int
    face: int
    kind: int
    i: int
    j: int
    parted: bool


NO_HIT: Final = 3
"""Kind of an event that is no contact, beside those of `collide`."""


@advance.answer(EventDriven)
def _event_driven(engine, scene, particles, ledger, abort):  # type: ignore[no-untyped-def]
    drift = enter_frame(scene, particles)
    events = new_events(particles)
    time = run_events(engine, scene, particles, ledger, events, abort)
    settle_all(scene, particles, events, time)
    compact(particles)
    leave_frame(scene, particles, drift, time)
    return time


@stage
def run_events(engine, scene, particles, ledger, events, abort):  # type: ignore[no-untyped-def]
    """Let one event happen after another until the end; the time reached in s."""
    budget = engine.budget * particles.size[0]
    time = 0.0
    happening = nothing_hit(start_over(scene, particles, events, 0.0), RANGE)
    while True:
        look_around(scene, events, happening, time)
        time = next_time(events)
        if time > scene.end_time or aborted(abort):
            return min(time, scene.end_time)
        if ledger.tally[STEPS] >= budget:
            ledger.tally[EXHAUSTED] = 1
            return time
        happening = take_event(scene, particles, ledger, events, time)


@allocating
def new_events(particles):  # type: ignore[no-untyped-def]
    """Return empty events for as many particles as there is room for."""
    capacity = particles.mass.size
    return Events(
        np.zeros(capacity, MOVER),
        new_cells(particles.size[0], capacity),
        new_tournament(capacity),
        np.empty(capacity, np.int64),
        np.zeros(1, np.int64),
    )


@stage
def next_time(events):  # type: ignore[no-untyped-def]
    """Time of the next event in s."""
    return earliest_time(events.tournament)


@stage
def nothing_hit(due, face):  # type: ignore[no-untyped-def]
    """Return an event that is no hit."""
    return Happening(due, face, NO_HIT, NOBODY, NOBODY, False)


@stage
def look_around(scene, events, happening, now):  # type: ignore[no-untyped-def]
    """Let all that are due after an event find what they hit next."""
    for k in range(happening.due):
        i = events.due[k]
        barred = NOBODY
        if happening.parted:
            barred = happening.j if i == happening.i else happening.i
        look(scene, events.cells, events.movers, events.tournament, i, now, happening.face, barred)


@stage
def take_event(scene, particles, ledger, events, now):  # type: ignore[no-untyped-def]
    """Let the next event happen."""
    ledger.tally[STEPS] += 1
    i = earliest(events.tournament)
    mover = events.movers[i]
    j = np.int64(mover["partner"])
    events.due[0] = i
    if mover["turn_time"] <= mover["hit_time"]:
        face = turn(scene, particles, events.cells, events.movers, i, now)
        return nothing_hit(1, face)
    if events.movers[j]["version"] != mover["hit_version"]:
        mover["hit_time"] = np.inf
        mover["partner"] = NOBODY
        return nothing_hit(1, RANGE)
    return hit(scene, particles, ledger, events, min(i, j), max(i, j), now)


@stage
def hit(scene, particles, ledger, events, i, j, now):  # type: ignore[no-untyped-def]
    """Let particles i < j collide; both, or what became of them, are due."""
    movers, cells = events.movers, events.cells
    catch_up_position(scene, particles, movers, i, now)
    catch_up_position(scene, particles, movers, j, now)
    size = particles.size[0]
    kind = collide(scene, particles, ledger, i, j, now)
    if kind == BONDED:
        leave(cells, movers, i)
        leave(cells, movers, j)
        merge(scene, particles, ledger, i, j, now)
        void(movers[j])
        set_time(events.tournament, j, np.inf)
        events.alive[0] -= 1
        settle_in(scene, particles, events, i, now)
        events.due[0] = i
        return Happening(tidy(scene, particles, events, 1, now), RANGE, kind, i, j, False)
    if particles.size[0] > size:
        leave(cells, movers, i)
        leave(cells, movers, j)
        events.alive[0] += particles.size[0] - size
        settle_in(scene, particles, events, i, now)
        settle_in(scene, particles, events, j, now)
        events.due[0], events.due[1] = i, j
        for k in range(size, particles.size[0]):
            settle_in(scene, particles, events, k, now)
            events.due[2 + k - size] = k
        due = 2 + particles.size[0] - size
        return Happening(tidy(scene, particles, events, due, now), RANGE, kind, i, j, False)
    load_velocity(movers, particles, i)
    load_velocity(movers, particles, j)
    set_turn(scene, cells, movers, i)
    set_turn(scene, cells, movers, j)
    events.due[0], events.due[1] = i, j
    return Happening(2, RANGE, kind, i, j, True)


@stage
def settle_in(scene, particles, events, i, now):  # type: ignore[no-untyped-def]
    """Start particle i, which is new in its place or its size, at `now` in s."""
    load_mover(events.movers, particles, i, now)
    enter(scene, events.cells, events.movers, i)
    set_turn(scene, events.cells, events.movers, i)


@stage
def tidy(scene, particles, events, due, now):  # type: ignore[no-untyped-def]
    """Start over if other cells are worth it by now, or empty slots have used up the room.

    Returns how many are due: all, after a fresh start, else `due`.
    """
    cells, alive = events.cells, events.alive[0]
    cost = cost_of_look(alive, cells.shape[ALONG], cells.shape[GIANTS])
    full = particles.size[0] - alive >= scene.particles
    if cost > cells.limit[0] or full:
        _, best = best_cells(scene, particles, cells, alive)
        if full or cost > GAIN * best:
            settle_all(scene, particles, events, now)
            return start_over(scene, particles, events, now)
        cells.limit[0] = GAIN * cost
    return due


@stage
def settle_all(scene, particles, events, now):  # type: ignore[no-untyped-def]
    """Move everybody to where they are at `now` in s."""
    for i in range(particles.size[0]):
        if particles.mass[i] > 0.0:
            catch_up_position(scene, particles, events.movers, i, now)


@stage
def start_over(scene, particles, events, now):  # type: ignore[no-untyped-def]
    """Close the gaps, choose cells, forget all predictions; how many are due: all."""
    before = particles.size[0]
    compact(particles)
    count = particles.size[0]
    events.alive[0] = count
    cells = events.cells
    along, cost = best_cells(scene, particles, cells, count)
    cells.limit[0] = GAIN * (cost + OVERHEAD)
    lay_out(cells, along)
    choose_range(cells, largest_radius(particles), scene.half_width)
    if count > MANY:
        sort_by_place(scene, particles, events)
        lay_out(cells, along)
    for i in range(count, before):
        set_time(events.tournament, i, np.inf)
    for i in range(count):
        settle_in(scene, particles, events, i, now)
        events.due[i] = i
    return count


@stage
def sort_by_place(scene, particles, events):  # type: ignore[no-untyped-def]
    """Sort the particles by the cells they are in."""
    movers, cells, order = events.movers, events.cells, events.due
    for i in range(particles.size[0]):
        load_mover(movers, particles, i, 0.0)
        enter(scene, cells, movers, i)
    count = 0
    for number in range(padded(cells.shape[ALONG]) ** 3):
        i = cells.head[number]
        while i >= 0:
            order[count] = i
            count += 1
            i = cells.following[i]
    for k in range(cells.shape[GIANTS]):
        order[count + k] = cells.giants[k]
    reorder(particles, order)
