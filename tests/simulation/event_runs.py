"""The event engine with its collisions written down, for tests."""

from typing import NamedTuple

import numpy as np
from scenes import CONSTANT, HALF, make_scene

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.simulation.boundary import Periodic, Reentry
from agglom_mpi.simulation.collision import BONDED, BOUNCED
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.event_driven.cells import OVERSIZE, PER_AXIS
from agglom_mpi.simulation.event_driven.engine import (
    entry,
    predict_due,
    process_event,
)
from agglom_mpi.simulation.event_driven.event_queue import reset_event_queue
from agglom_mpi.simulation.event_driven.image_shifts import next_time
from agglom_mpi.simulation.event_driven.prediction import neighbours_of
from agglom_mpi.simulation.event_driven.state import new_events, rebuild, synchronise
from agglom_mpi.simulation.particles import EXHAUSTED, STEPS, Ledger, compact, new_ledger
from agglom_mpi.simulation.reference_frame import to_box_frame, to_mass_frame

BUDGET = 20_000
ESCAPES = {"periodic": Periodic.Numbers(), "reentry": Reentry.Numbers()}


class Recorded(NamedTuple):
    """A run: its collisions, the time reached, and the cells at the start and at the end.

    `pairs` are slots, which stay the original ones while nothing merges and N is small; `compared`
    is how many particles all looks together compared with.
    """

    times: np.ndarray
    pairs: np.ndarray
    kinds: np.ndarray
    time: float
    ledger: Ledger
    per_axis: tuple[int, int]
    oversize: tuple[int, int]
    compared: int


@kernel
def record_events(scene, particles, ledger, events, times, pairs, kinds, shape, start):
    """Repeat the engine's loop from `start` in s, or until `times` is full; time and collisions."""
    drift = to_mass_frame(scene, particles)
    reset_event_queue(events.event_queue)
    budget = scene.engine.budget * particles.size[0]
    time, collisions, never = start, 0, np.zeros(1, np.uint8)
    event = entry(rebuild(scene, particles, events, time))
    while collisions < times.size:
        predict_due(scene, events, event, time, never)
        if ledger.counts[STEPS] == 0:
            shape[0, 0], shape[0, 1] = events.cells.shape[PER_AXIS], events.cells.shape[OVERSIZE]
        for k in range(event.due):
            trajectory = events.flights.trajectory[events.due[k]]
            next_event = events.flights.next_event[events.due[k]]
            flight = time - trajectory["time"]
            x = trajectory["x"] + trajectory["u"] * flight
            y = trajectory["y"] + trajectory["v"] * flight
            z = trajectory["z"] + trajectory["w"] * flight
            shape[2, 0] += events.cells.shape[OVERSIZE] + neighbours_of(
                scene, events.cells, trajectory, next_event, x, y, z, event.face
            )
        following = next_time(scene, events)
        if following > scene.end_time:
            time = scene.end_time
            break
        time = following
        if ledger.counts[STEPS] >= budget:
            ledger.counts[EXHAUSTED] = 1
            break
        event = process_event(scene, particles, ledger, events, time)
        if event.kind == BOUNCED or event.kind == BONDED:
            times[collisions] = time
            pairs[collisions, 0], pairs[collisions, 1] = event.i, event.j
            kinds[collisions] = event.kind
            collisions += 1
    shape[1, 0], shape[1, 1] = events.cells.shape[PER_AXIS], events.cells.shape[OVERSIZE]
    synchronise(scene, particles, ledger, events, time)
    compact(particles)
    to_box_frame(scene, particles, drift, time - start)
    return time, collisions


def recorded(scene, particles, most=100_000, start=0.0):
    """Run on particles, in place, to the scene's end or until `most` collisions have happened."""
    ledger = new_ledger()
    times, pairs = np.empty(most), np.empty((most, 2), np.int64)
    kinds, shape = np.empty(most, np.int64), np.zeros((3, 2), np.int64)
    events = new_events(int(particles.size[0]), particles.mass.size)
    time, collisions = record_events(
        scene, particles, ledger, events, times, pairs, kinds, shape, start
    )
    (per_axis, oversize), (per_axis_last, oversize_last), (compared, _) = shape.tolist()
    return Recorded(
        times[:collisions],
        pairs[:collisions],
        kinds[:collisions],
        time,
        ledger,
        (per_axis, per_axis_last),
        (oversize, oversize_last),
        compared,
    )


def bouncing(e, escape="periodic", friction=0.0, budget=BUDGET, **options):
    """Return a scene of constant restitution; 0 bonds."""
    laws = CONSTANT._replace(
        restitution=ConstantRestitution.Numbers(e), friction=ConstantFriction.Numbers(friction)
    )
    return make_scene(laws, EventDriven.Numbers(budget), ESCAPES[escape], **options)


def size_ratio(fraction):
    """Return what `make_scene` takes for a volume fraction: radius over D/N^⅓."""
    return (6.0 * fraction / np.pi) ** (1.0 / 3.0)


def same_place(difference, atol):
    """Whether positions differ by a vector of the periodic lattice at most, within `atol` in m."""
    difference = np.asarray(difference)
    wrapped = difference - 2.0 * HALF * np.rint(difference / (2.0 * HALF))
    return bool(np.all(np.abs(wrapped) <= atol))
