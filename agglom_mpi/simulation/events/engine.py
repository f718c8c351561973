"""The event-driven engine: every hit at its exact time, and work only for who is touched.

Each particle knows its earliest hit and when it leaves its cell; a tournament tells who is next.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation import rare_stage, stage
from agglom_mpi.simulation.contact import BONDED, collide, merge
from agglom_mpi.simulation.engines import advance
from agglom_mpi.simulation.events.cells import leave
from agglom_mpi.simulation.events.frames import record_flight
from agglom_mpi.simulation.events.movers import RANGE, catch_up_position, load_velocity, void
from agglom_mpi.simulation.events.prediction import look
from agglom_mpi.simulation.events.state import (
    new_events,
    settle_all,
    settle_in,
    start_over,
    tidy,
)
from agglom_mpi.simulation.events.tournament import earliest, earliest_time, set_time
from agglom_mpi.simulation.events.turns import set_turn, turn
from agglom_mpi.simulation.particles import EXHAUSTED, STEPS, compact
from agglom_mpi.simulation.scene import EventDriven
from agglom_mpi.simulation.stepping import aborted

NOBODY: Final = -1


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
def _event_driven(engine, scene, particles, ledger, abort, recorder):  # type: ignore[no-untyped-def]
    events = new_events(particles)
    due = start_over(scene, particles, events, 0.0)
    end = scene.end_time
    time = run_events(engine, scene, particles, ledger, events, due, end, abort, recorder)
    settle_all(scene, particles, events, time)
    compact(particles)
    return time


@stage
def run_events(engine, scene, particles, ledger, events, due, end, abort, recorder):  # type: ignore[no-untyped-def]
    """Let one event happen after another up to `end` in s; the time reached in s.

    `due` is how many have to look around first: all at the start, nobody when a run goes on.
    """
    budget = engine.budget * particles.size[0]
    time = 0.0
    happening = nothing_hit(due, RANGE)
    while True:
        look_around(scene, events, happening, time)
        time = next_time(events)
        record_flight(recorder, scene, particles, events.movers, time)
        if time > end or aborted(abort):
            return min(time, end)
        if ledger.tally[STEPS] >= budget:
            ledger.tally[EXHAUSTED] = 1
            return time
        happening = take_event(scene, particles, ledger, events, time)


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
    plan = events.movers.plan[i]
    j = np.int64(plan["partner"])
    events.due[0] = i
    if plan["turn_time"] <= plan["hit_time"]:
        face = turn(scene, particles, events.cells, events.movers, i, now)
        return nothing_hit(1, face)
    if events.movers.plan[j]["version"] != plan["hit_version"]:
        plan["hit_time"] = np.inf
        plan["partner"] = NOBODY
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
    events.due[0], events.due[1] = i, j
    if kind != BONDED and particles.size[0] == size:
        for k in range(2):
            load_velocity(movers, particles, events.due[k])
            set_turn(scene, cells, movers, events.due[k])
        return Happening(2, RANGE, kind, i, j, True)
    due = renew(scene, particles, ledger, events, i, j, kind, size, now)
    return Happening(due, RANGE, kind, i, j, False)


@rare_stage
def renew(scene, particles, ledger, events, i, j, kind, size, now):  # type: ignore[no-untyped-def]
    """Bond particles i and j that hit, or take in the pieces beyond `size`; how many are due."""
    movers, cells = events.movers, events.cells
    leave(cells, movers, i)
    leave(cells, movers, j)
    due = 2 + particles.size[0] - size
    if kind == BONDED:
        merge(scene, particles, ledger, i, j, now)
        void(movers.plan[j])
        set_time(events.tournament, j, np.inf)
        due = 1
    for k in range(2, due):
        events.due[k] = size + k - 2
    for k in range(due):
        settle_in(scene, particles, events, events.due[k], now)
    events.alive[0] += due - 2
    return tidy(scene, particles, events, due, now)
