"""The event-driven engine: the event loop, frames between events, runs in parts.

Each particle knows its earliest hit and when it leaves its cell; an event queue finds the earliest.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, not_inlined
from agglom_mpi.simulation.boundary import clamped
from agglom_mpi.simulation.collision import BONDED, merge, resolve_contact
from agglom_mpi.simulation.event_driven.cell_crossing import cross_cell, schedule_crossing
from agglom_mpi.simulation.event_driven.cells import remove
from agglom_mpi.simulation.event_driven.event_queue import earliest, earliest_time, set_time
from agglom_mpi.simulation.event_driven.flights import (
    RANGE,
    catch_up_position,
    load_velocity,
    void_event,
)
from agglom_mpi.simulation.event_driven.prediction import predict_collision
from agglom_mpi.simulation.event_driven.state import (
    Events,
    compact_after_merge,
    new_events,
    rebuild,
    settle_all,
    settle_in,
)
from agglom_mpi.simulation.particles import EXHAUSTED, STEPS, compact
from agglom_mpi.simulation.scene import EventDriven, advance_to, copy_at, initialize, run_to_end
from agglom_mpi.simulation.time_driven.stepping import aborted
from agglom_mpi.simulation.trajectory import copy_all, finish, next_frame


@inlined
def record_flight(recorder, scene, particles, flights, following):
    """Take the frames before the `following` event, whose time is in s."""
    if recorder is not None:
        while next_frame(recorder, scene.end_time) < following:
            take_in_flight(recorder, scene, particles, flights)


@not_inlined
def take_in_flight(recorder, scene, particles, flights):
    """Take the next frame, before which nothing happens any more."""
    time = next_frame(recorder, scene.end_time)
    copy_in_flight(recorder, scene, particles, flights, time)
    finish(recorder, scene, time)


@not_inlined
def copy_in_flight(recorder, scene, particles, flights, time):
    """Copy the particles to where they are at `time` in s, before which nothing happens."""
    copy = copy_all(recorder, particles)
    for i in range(copy.size[0]):
        if copy.mass[i] > 0.0:
            copy_position(scene, copy, flights, i, time)


@inlined
def copy_position(scene, copy, flights, i, now):
    """Move the copy of particle i to where the particle is at `now` in s; not the particle."""
    trajectory, r, half = flights.trajectory[i], copy.position, scene.half_width
    flight = now - trajectory["time"]
    r[0, i] = clamped(scene.escape, trajectory["x"] + trajectory["u"] * flight, half)
    r[1, i] = clamped(scene.escape, trajectory["y"] + trajectory["v"] * flight, half)
    r[2, i] = clamped(scene.escape, trajectory["z"] + trajectory["w"] * flight, half)


NOBODY: Final = -1


class Event(NamedTuple):
    """An event.

    Attributes
    ----------
    due
        How many have to look around now; `Events.due` says who.
    face
        The face through which the only one due came into its cell, or `RANGE`: look everywhere.
    kind
        What `resolve_contact` returned, or `NO_HIT`.
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
"""Kind of an event that is no contact, beside those of `resolve_contact`."""


@run_to_end.register(EventDriven)
def _event_driven(engine, scene, particles, ledger, abort, recorder):
    events = new_events(particles)
    due = rebuild(scene, particles, events, 0.0)
    end = scene.end_time
    time = run_events(engine, scene, particles, ledger, events, due, end, abort, recorder)
    settle_all(scene, particles, events, time)
    compact(particles)
    return time


@inlined
def run_events(engine, scene, particles, ledger, events, due, end, abort, recorder):
    """Let one event happen after another up to `end` in s; the time reached in s.

    `due` is how many have to look around first: all at the start, nobody when a run goes on.
    """
    budget = engine.budget * particles.size[0]
    time = 0.0
    event = nothing_hit(due, RANGE)
    while True:
        look_around(scene, events, event, time)
        time = next_time(events)
        record_flight(recorder, scene, particles, events.flights, time)
        if time > end or aborted(abort):
            return min(time, end)
        if ledger.tally[STEPS] >= budget:
            ledger.tally[EXHAUSTED] = 1
            return time
        event = take_event(scene, particles, ledger, events, time)


@inlined
def next_time(events):
    """Time of the next event in s."""
    return earliest_time(events.event_queue)


@inlined
def nothing_hit(due, face):
    """Return an event that is no hit."""
    return Event(due, face, NO_HIT, NOBODY, NOBODY, False)


@inlined
def look_around(scene, events, event, now):
    """Let all that are due after an event find what they hit next."""
    for k in range(event.due):
        i = events.due[k]
        barred = NOBODY
        if event.parted:
            barred = event.j if i == event.i else event.i
        predict_collision(
            scene, events.cells, events.flights, events.event_queue, i, now, event.face, barred
        )


@inlined
def take_event(scene, particles, ledger, events, now):
    """Let the next event happen."""
    ledger.tally[STEPS] += 1
    i = earliest(events.event_queue)
    next_event = events.flights.next_event[i]
    j = np.int64(next_event["partner"])
    events.due[0] = i
    if next_event["turn_time"] <= next_event["hit_time"]:
        face = cross_cell(scene, particles, events.cells, events.flights, i, now)
        return nothing_hit(1, face)
    if events.flights.next_event[j]["version"] != next_event["hit_version"]:
        next_event["hit_time"] = np.inf
        next_event["partner"] = NOBODY
        return nothing_hit(1, RANGE)
    return process_collision(scene, particles, ledger, events, min(i, j), max(i, j), now)


@inlined
def process_collision(scene, particles, ledger, events, i, j, now):
    """Let particles i < j collide; both, or what became of them, are due."""
    flights, cells = events.flights, events.cells
    catch_up_position(scene, particles, flights, i, now)
    catch_up_position(scene, particles, flights, j, now)
    size = particles.size[0]
    kind = resolve_contact(scene, particles, ledger, i, j, now)
    events.due[0], events.due[1] = i, j
    if kind != BONDED and particles.size[0] == size:
        for k in range(2):
            load_velocity(flights, particles, events.due[k])
            schedule_crossing(scene, cells, flights, events.due[k])
        return Event(2, RANGE, kind, i, j, True)
    due = predict_again(scene, particles, ledger, events, i, j, kind, size, now)
    return Event(due, RANGE, kind, i, j, False)


@not_inlined
def predict_again(scene, particles, ledger, events, i, j, kind, size, now):
    """Bond particles i and j that hit, or take in the pieces beyond `size`; how many are due."""
    flights, cells = events.flights, events.cells
    remove(cells, flights, i)
    remove(cells, flights, j)
    due = 2 + particles.size[0] - size
    if kind == BONDED:
        merge(scene, particles, ledger, i, j, now)
        void_event(flights.next_event[j])
        set_time(events.event_queue, j, np.inf)
        due = 1
    for k in range(2, due):
        events.due[k] = size + k - 2
    for k in range(due):
        settle_in(scene, particles, events, events.due[k], now)
    events.alive[0] += due - 2
    return compact_after_merge(scene, particles, events, due, now)


class EventEngineState(NamedTuple):
    """What is kept between stretches: `due`, shape (1,), have not looked around yet."""

    events: Events
    due: np.ndarray


@initialize.register(EventDriven)
def _start(engine, scene, particles):
    events = new_events(particles)
    due = np.empty(1, np.int64)
    due[0] = rebuild(scene, particles, events, 0.0)
    return EventEngineState(events, due)


@advance_to.register(EventDriven)
def _more_events(engine, scene, particles, ledger, engine_state, until, abort):
    due = engine_state.due[0]
    engine_state.due[0] = 0
    return run_events(
        engine, scene, particles, ledger, engine_state.events, due, until, abort, None
    )


@copy_at.register(EventDriven)
def _in_flight(engine, scene, particles, engine_state, recorder, time):
    copy_in_flight(recorder, scene, particles, engine_state.events.flights, time)
