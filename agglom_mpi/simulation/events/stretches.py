"""The event engine in stretches: what is predicted stays, and the next stretch begins with it."""

from typing import NamedTuple

import numpy as np

from agglom_mpi.simulation.engines import begin, go_on, stand
from agglom_mpi.simulation.events.engine import run_events
from agglom_mpi.simulation.events.frames import copy_in_flight
from agglom_mpi.simulation.events.state import Events, new_events, start_over
from agglom_mpi.simulation.scene import EventDriven


class Flights(NamedTuple):
    """What is kept between stretches: `due`, shape (1,), have not looked around yet."""

    events: Events
    due: np.ndarray


@begin.answer(EventDriven)
def _start(engine, scene, particles):  # type: ignore[no-untyped-def]
    events = new_events(particles)
    due = np.empty(1, np.int64)
    due[0] = start_over(scene, particles, events, 0.0)
    return Flights(events, due)


@go_on.answer(EventDriven)
def _more_events(engine, scene, particles, ledger, kept, until, abort):  # type: ignore[no-untyped-def]
    due = kept.due[0]
    kept.due[0] = 0
    return run_events(engine, scene, particles, ledger, kept.events, due, until, abort, None)


@stand.answer(EventDriven)
def _in_flight(engine, scene, particles, kept, recorder, time):  # type: ignore[no-untyped-def]
    copy_in_flight(recorder, scene, particles, kept.events.movers, time)
