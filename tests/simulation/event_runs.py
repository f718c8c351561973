"""The event engine with its collisions written down, for tests."""

from typing import NamedTuple

import numpy as np
from scenes import CONSTANT, HALF, empty_ledger, make_scene

from agglom_mpi.compilation import kernel
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.simulation.box import Periodic, Reentry
from agglom_mpi.simulation.contact import BONDED, BOUNCED
from agglom_mpi.simulation.events.cells import ALONG, GIANTS
from agglom_mpi.simulation.events.engine import look_around, next_time, nothing_hit, take_event
from agglom_mpi.simulation.events.gather import gather
from agglom_mpi.simulation.events.movers import RANGE
from agglom_mpi.simulation.events.state import new_events, settle_all, start_over
from agglom_mpi.simulation.frame import enter_frame, leave_frame
from agglom_mpi.simulation.particles import EXHAUSTED, STEPS, Ledger, compact
from agglom_mpi.simulation.scene import EventDriven

BUDGET = 20_000
ESCAPES = {"periodic": Periodic(), "reentry": Reentry()}


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
    along: tuple[int, int]
    giants: tuple[int, int]
    compared: int


@kernel
def record_events(scene, particles, ledger, times, pairs, kinds, shape, start):
    """Repeat the engine's loop from `start` in s, or until `times` is full; time and hits."""
    drift = enter_frame(scene, particles)
    events = new_events(particles)
    budget = scene.engine.budget * particles.size[0]
    time, hits = start, 0
    happening = nothing_hit(start_over(scene, particles, events, time), RANGE)
    shape[0, 0], shape[0, 1] = events.cells.shape[ALONG], events.cells.shape[GIANTS]
    while hits < times.size:
        for k in range(happening.due):
            path = events.movers.path[events.due[k]]
            plan = events.movers.plan[events.due[k]]
            flight = time - path["time"]
            x = path["x"] + path["u"] * flight
            y = path["y"] + path["v"] * flight
            z = path["z"] + path["w"] * flight
            shape[2, 0] += gather(scene, events.cells, path, plan, x, y, z, happening.face)
        look_around(scene, events, happening, time)
        following = next_time(events)
        if following > scene.end_time:
            time = scene.end_time
            break
        time = following
        if ledger.tally[STEPS] >= budget:
            ledger.tally[EXHAUSTED] = 1
            break
        happening = take_event(scene, particles, ledger, events, time)
        if happening.kind == BOUNCED or happening.kind == BONDED:
            times[hits] = time
            pairs[hits, 0], pairs[hits, 1] = happening.i, happening.j
            kinds[hits] = happening.kind
            hits += 1
    shape[1, 0], shape[1, 1] = events.cells.shape[ALONG], events.cells.shape[GIANTS]
    settle_all(scene, particles, events, time)
    compact(particles)
    leave_frame(scene, particles, drift, time - start)
    return time, hits


def recorded(scene, particles, most=100_000, start=0.0):
    """Run on particles, in place, to the scene's end or until `most` collisions have happened."""
    ledger = empty_ledger()
    times, pairs = np.empty(most), np.empty((most, 2), np.int64)
    kinds, shape = np.empty(most, np.int64), np.zeros((3, 2), np.int64)
    time, hits = record_events(scene, particles, ledger, times, pairs, kinds, shape, start)
    (along, giants), (along_last, giants_last), (compared, _) = shape.tolist()
    return Recorded(
        times[:hits],
        pairs[:hits],
        kinds[:hits],
        time,
        ledger,
        (along, along_last),
        (giants, giants_last),
        compared,
    )


def bouncing(e, escape="periodic", friction=0.0, budget=BUDGET, **options):
    """Return a scene of constant restitution; 0 bonds."""
    laws = CONSTANT._replace(
        restitution=ConstantRestitution(e), friction=ConstantFriction(friction)
    )
    return make_scene(laws, EventDriven(budget), ESCAPES[escape], **options)


def size_ratio(fraction):
    """Return what `make_scene` takes for a volume fraction: radius over D/N^⅓."""
    return (6.0 * fraction / np.pi) ** (1.0 / 3.0)


def same_place(difference, atol):
    """Whether positions differ by a vector of the periodic lattice at most, within `atol` in m."""
    difference = np.asarray(difference)
    wrapped = difference - 2.0 * HALF * np.rint(difference / (2.0 * HALF))
    return bool(np.all(np.abs(wrapped) <= atol))
