"""The event-driven engine: the event loop, in as many parts as is asked for.

Each particle keeps its earliest collision and the time at which it leaves its cell (Lubachevsky,
J. Comput. Phys. 94, 1991, 255); an event queue finds the earliest.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import inlined, not_inlined
from agglom_mpi.simulation.boundary import clamped_position
from agglom_mpi.simulation.collision import BONDED, merge, resolve_contact
from agglom_mpi.simulation.collision_counts import count_bounce, count_change, pair_before
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.event_driven.cell_crossing import cross_cell, schedule_crossing
from agglom_mpi.simulation.event_driven.cells import copy_if_oversize, insert, remove
from agglom_mpi.simulation.event_driven.event_queue import (
    earliest,
    reset_event_queue,
    set_time,
)
from agglom_mpi.simulation.event_driven.flights import (
    BELOW,
    RANGE,
    invalidate_prediction,
    load_particle,
    load_velocity,
    synchronise_particle,
)
from agglom_mpi.simulation.event_driven.image_shifts import is_shift, next_time, shift
from agglom_mpi.simulation.event_driven.prediction import predict_collision
from agglom_mpi.simulation.event_driven.prefetching import prefetch_events
from agglom_mpi.simulation.event_driven.state import (
    ALIVE,
    NEW,
    compact_after_merge,
    new_events,
    rebuild,
    synchronise,
)
from agglom_mpi.simulation.particles import (
    EXHAUSTED,
    STEPS,
    compact,
    moved_by,
    set_position,
    velocity_of,
)
from agglom_mpi.simulation.scene import (
    advance_to,
    begin,
    copy_at,
    finish,
    is_aborted,
    new_engine_state,
)
from agglom_mpi.simulation.shear import bring_together, put_back, put_into_box
from agglom_mpi.simulation.trajectory import copy_particles


@not_inlined
def copy_particles_at(observer, scene, particles, flights, time):
    """Copy the particles to where they are at `time` in s, before which nothing happens."""
    copy = copy_particles(observer, particles)
    for i in range(copy.size[0]):
        if copy.records[i]["mass"] > 0.0:
            copy_position(scene, copy.records[i], flights.trajectory[i], time)


@inlined
def copy_position(scene, copy, trajectory, now):
    """Move the copy of a particle to where its trajectory is at `now` in s."""
    moved = moved_by(trajectory, now - trajectory["time"], velocity_of(trajectory))
    set_position(copy, clamped_position(scene.escape, scene, moved))
    put_into_box(scene, copy, None, now)


NO_PARTICLE: Final = -1


class Event(NamedTuple):
    """A processed event, and which particles need new predictions.

    Attributes
    ----------
    due
        Number of particles to predict for; `Events.due` holds their slots.
    face
        Face through which the only one due came into its cell, or `RANGE`: predict with all.
    kind
        What `resolve_contact` returned, or `NO_CONTACT`.
    i, j
        Slots of the pair in contact, i < j, or −1.
    pair_excluded
        Whether i and j only bounced: their next collision cannot be with each other.
    inserts
        Whether those due are in no cell yet.
    """

    due: int
    face: int
    kind: int
    i: int
    j: int
    pair_excluded: bool
    inserts: bool


DUE_UNASKED: Final = 4096
"""Particles to predict for, some milliseconds, between questions whether the run is to end."""

NO_CONTACT: Final = 3
"""Kind of an event that is no contact, beside those of `resolve_contact`."""


@new_engine_state.register(EventDriven)
def _new_events(engine, scene, capacity):
    return new_events(scene.particles, capacity)


@begin.register(EventDriven)
def _begin_events(engine, scene, particles, events):
    reset_event_queue(events.event_queue)
    events.counts[NEW] = rebuild(scene, particles, events, 0.0)


@advance_to.register(EventDriven)
def _advance_events(engine, scene, particles, ledger, events, until, abort):
    budget = engine.budget * scene.particles
    time = 0.0
    event = entry(events.counts[NEW])
    events.counts[NEW] = 0
    while True:
        predict_due(scene, events, event, time, abort)
        prefetch_events(scene, particles, events, events.winners, event.due)
        time = next_time(scene, events)
        if time > until or is_aborted(abort):
            return min(time, until)
        if ledger.counts[STEPS] >= budget:
            ledger.counts[EXHAUSTED] = 1
            return time
        event = process_event(scene, particles, ledger, events, time)


@finish.register(EventDriven)
def _finish_events(engine, scene, particles, ledger, events, time):
    synchronise(scene, particles, ledger, events, time)
    compact(particles)


@copy_at.register(EventDriven)
def _copy_between_events(engine, scene, particles, events, observer, time):
    copy_particles_at(observer, scene, particles, events.flights, time)


@inlined
def entry(due):
    """Return an event after which `due` particles enter their cells."""
    return Event(due, RANGE, NO_CONTACT, NO_PARTICLE, NO_PARTICLE, False, True)


@inlined
def no_contact(face):
    """Return an event of one particle that is no contact."""
    return Event(1, face, NO_CONTACT, NO_PARTICLE, NO_PARTICLE, False, False)


@inlined
def predict_due(scene, events, event, now, abort):
    """Predict the next crossing and collision of all particles that are due after an event.

    Those that are in no cell yet enter it just before, so that each pair of them is compared once:
    when the later one comes. A run that is to end leaves out the rest.
    """
    for k in range(event.due):
        if k % DUE_UNASKED == DUE_UNASKED - 1 and is_aborted(abort):
            return
        i = events.due[k]
        if event.inserts:
            insert(scene, events.cells, events.flights, i)
        schedule_crossing(scene, events.cells, events.flights, i)
        excluded = NO_PARTICLE
        if event.pair_excluded:
            excluded = event.j if i == event.i else event.i
        predict_collision(
            scene, events.cells, events.flights, events.event_queue, i, now, event.face, excluded
        )


@inlined
def process_event(scene, particles, ledger, events, now):
    """Process the earliest event, which is at `now` in s."""
    ledger.counts[STEPS] += 1
    if is_shift(scene, events, now):
        due = shift(scene, events)
        return Event(due, BELOW, NO_CONTACT, NO_PARTICLE, NO_PARTICLE, False, False)
    i = earliest(events.event_queue)
    next_event = events.flights.next_event[i]
    j = np.int64(next_event["partner"])
    events.due[0] = i
    if next_event["crossing_time"] <= next_event["collision_time"]:
        face = cross_cell(scene, particles, ledger, events.cells, events.flights, i, now)
        return no_contact(face)
    if events.flights.next_event[j]["version"] != next_event["partner_version"]:
        next_event["collision_time"] = np.inf
        next_event["partner"] = NO_PARTICLE
        return no_contact(RANGE)
    return process_collision(scene, particles, ledger, events, min(i, j), max(i, j), now)


@inlined
def process_collision(scene, particles, ledger, events, i, j, now):
    """Resolve the contact of particles i < j; both, or what became of them, are due."""
    flights = events.flights
    synchronise_particle(scene, particles, ledger, flights, i, now)
    synchronise_particle(scene, particles, ledger, flights, j, now)
    images = bring_together(scene, particles.records[i], particles.records[j], ledger, now)
    size, one, other = particles.size[0], particles.records[i], particles.records[j]
    before = pair_before(ledger.collisions, scene, one, other)
    kind = resolve_contact(scene, particles, ledger, i, j, now)
    events.due[0], events.due[1] = i, j
    if kind != BONDED and particles.size[0] == size:
        count_bounce(ledger.collisions, before, one, other, kind, now)
        put_back(scene, particles.records[j], ledger, images, now)
        load_velocity(flights, particles, i)
        load_velocity(flights, particles, j)
        copy_if_oversize(events.cells, flights, i)
        copy_if_oversize(events.cells, flights, j)
        return Event(2, RANGE, kind, i, j, True, False)
    due = predict_again(scene, particles, ledger, events, i, j, kind, size, before, now)
    return Event(due, RANGE, kind, i, j, False, True)


@inlined
def predict_again(scene, particles, ledger, events, i, j, kind, size, before, now):
    """Merge i and j, or take in the pieces appended after `size`; return how many are due.

    `before` is that of `pair_before`.
    """
    flights, cells = events.flights, events.cells
    remove(cells, flights, i)
    remove(cells, flights, j)
    due = 2 + particles.size[0] - size
    if kind == BONDED:
        merge(scene, particles, ledger, i, j, now)
        invalidate_prediction(flights.next_event[j])
        set_time(events.event_queue, j, np.inf)
        due = 1
    count_change(ledger.collisions, before, particles, i, j, kind, size, now)
    for k in range(2, due):
        events.due[k] = size + k - 2
    for k in range(due):
        put_into_box(scene, particles.records[events.due[k]], ledger, now)
        load_particle(flights, particles, events.due[k], now)
    events.counts[ALIVE] += due - 2
    return compact_after_merge(scene, particles, ledger, events, due, now)
