"""Consecutive samples of one scene in one call of compiled code: the loop, its clocks, its room.

Placement, engine and measurement are kernels of their own, compiled by two processes at once; the
loop calls their machine code. Between samples it reads the clocks and looks whether it is to end.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi import outcome as result
from agglom_mpi.compilation.kernel_calls import (
    CLOCKS,
    DATE,
    PROCESSOR,
    WALL,
    kernel_call,
    read_clock,
)
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.judge import Judge, decides, new_judge
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.simulation.census import (
    CensusRoom,
    count_last,
    new_census_room,
    take_census,
)
from agglom_mpi.simulation.initial_state import DifferentSizes, EqualSizes, scatter
from agglom_mpi.simulation.particles import set_position, set_velocity
from agglom_mpi.simulation.sample_kernels import measure_sample, run_engine
from agglom_mpi.simulation.sample_room import CALLED, CENSUS, ENGINE, MEASUREMENT, PLACEMENT
from agglom_mpi.simulation.scene import is_aborted
from agglom_mpi.simulation.spins import draw_spins
from agglom_mpi.simulation.stream_states import STATE_WORDS

_PLACEMENT: Final = CALLED.index(PLACEMENT)
_ENGINE: Final = CALLED.index(ENGINE)
_MEASUREMENT: Final = CALLED.index(MEASUREMENT)
_CENSUS: Final = CALLED.index(CENSUS)

call_placement: Final[Any] = kernel_call(scatter, bool)
call_engine: Final[Any] = kernel_call(run_engine, float)
call_measurement: Final[Any] = kernel_call(measure_sample, None)
call_census: Final[Any] = kernel_call(take_census, None)

MAX_SECONDS: Final = 0
BUDGET: Final = 1
"""Places in `Watch.limits`."""

TIMES: Final = np.dtype([("seconds", "f8"), ("cpu_seconds", "f8"), ("finished", "f8")])
"""Wall-clock and processor time of a sample in s, and when it was finished, in s since 1970."""


class Watch(NamedTuple):
    """How a loop over samples is watched and ended.

    Attributes
    ----------
    abort
        Shape (1,); anything but 0 ends the sample under way, and the loop.
    begun
        When the sample under way began, by `time.monotonic`, shape (1,), s.
    limits
        Longest time of a sample (`MAX_SECONDS`), and time after which no other one is begun
        (`BUDGET`), s; inf without a limit.
    clocks
        `CLOCKS`.
    judge
        Ends the loop after the sample that was the last one needed.
    """

    abort: NDArray[np.uint8]
    begun: NDArray[np.float64]
    limits: NDArray[np.float64]
    clocks: NDArray[np.int32]
    judge: Judge


class SampleResults(NamedTuple):
    """What n samples give, as far as they are finished.

    Attributes
    ----------
    records
        Result of each, of `outcome_type`, shape (n,).
    times
        `TIMES` of each, shape (n,).
    finished
        Number of samples that are finished, shape (1,).
    census
        Their censuses; None where none are taken. Those of a sample that failed have no meaning.
    """

    records: NDArray[Any]
    times: NDArray[Any]
    finished: NDArray[np.int64]
    census: CensusRoom | None = None


def new_watch(
    abort: NDArray[np.uint8],
    begun: NDArray[np.float64] | None = None,
    max_seconds: float = np.inf,
    budget: float = np.inf,
) -> Watch:
    """Return a watch whose judge is never asked; times in s."""
    begun = np.zeros(1) if begun is None else begun
    limits = np.array([max_seconds, budget])
    return Watch(abort, begun, limits, CLOCKS, new_judge())


def new_results(
    count: int, layout: CensusLayout | None = None, spins: bool = False
) -> SampleResults:
    """Return room for the results of `count` samples, none of them finished.

    With a `layout`, for their censuses, too; with `spins`, of grains that spin.
    """
    records, times = np.zeros(count, result.outcome_type(spins)), np.zeros(count, TIMES)
    census = None if layout is None else new_census_room(layout, count)
    return SampleResults(records, times, np.zeros(1, np.int64), census)


@kernel
def simulate_range(scene, room, random, draws, watch, results):
    """Simulate samples one after another; return whether the last one that began was cut off.

    That is so where it was aborted, or took longer than the limit; it has no result then.

    Parameters
    ----------
    scene : Scene, without its law of sizes
    room : Room
    random : numpy.random.Generator
    draws : Draws
    watch : Watch
    results : SampleResults, filled in order
    """
    now = read_clock(watch.clocks[WALL], room.timespec)
    processor = read_clock(watch.clocks[PROCESSOR], room.timespec)
    start = now
    for k in range(len(results.records)):
        watch.begun[0] = now
        if len(draws.states) > 0:
            for i in range(STATE_WORDS):
                draws.words[i] = draws.states[k, i]
        room.record[0] = results.records[k]  # without a result
        room.record[0]["state"] = result.FAILED
        simulate_one(scene, room, random, draws, results.census, k, watch.abort)
        begun, begun_processor = now, processor
        now = read_clock(watch.clocks[WALL], room.timespec)
        processor = read_clock(watch.clocks[PROCESSOR], room.timespec)
        if is_aborted(watch.abort) or now - begun > watch.limits[MAX_SECONDS]:
            return True
        results.records[k] = room.record[0]
        times = results.times[k]
        times["seconds"] = now - begun
        times["cpu_seconds"] = processor - begun_processor
        times["finished"] = read_clock(watch.clocks[DATE], room.timespec)
        results.finished[0] = k + 1
        if is_last(watch, results.records[k]) or now - start > watch.limits[BUDGET]:
            break
    return False


@inlined
def is_last(watch, record):
    """Return whether a finished sample was the last one that its string needs."""
    completed, ratio = record["state"] == result.COMPLETED, record["mean_radius_ratio"]
    return decides(watch.judge, completed, ratio, record["particles"])


@inlined
def simulate_one(scene, room, random, draws, census, k, abort):
    """Simulate sample k of a range; its result is in `room.record`."""
    reset(room, scene.particles)
    record = room.record[0]
    if not place(scene.sizes, scene, room, room.callees[_PLACEMENT], random, draws, k, abort):
        record["reason"] = result.FailureReason.PLACEMENT_JAMMED
        return
    put_grains(room.particles, room.placed, room.velocity)
    draw_spins(scene.laws.friction, scene.escape, random, room.particles)
    particles, ledger, initial = room.particles, room.ledger, room.initial
    end = run_to_end(census, scene, room, k, abort)
    call_measurement(
        room.callees[_MEASUREMENT], (scene, particles, ledger, initial, end, room.record)
    )
    if census is not None:
        count_last(scene, particles, census, k)


@inlined
def run_to_end(census, scene, room, k, abort):
    """Run the grains of sample k to the scene's end, with its censuses before that.

    Returns the time reached in s.
    """
    state = room.engine_state, room.initial
    run = (scene, room.particles, room.ledger, *state, scene.end_time, abort)
    if census is None:
        return call_engine(room.callees[_ENGINE], run)
    else:  # noqa: RET505  (types decide this one when it is compiled)
        for t in range(len(census.times)):
            time = census.times[t]
            if time >= scene.end_time:
                break
            part = (scene, room.particles, room.ledger, *state, time, abort)
            reached = call_engine(room.callees[_ENGINE], part)
            if reached < time or is_aborted(abort):
                return reached
            counted = (scene, room.particles, room.engine_state, room.observer, room.initial)
            call_census(room.callees[_CENSUS], (*counted, census, k, t))
        return call_engine(room.callees[_ENGINE], run)


@inlined
def reset(room, grains):
    """Begin a sample: nothing is summed up yet, and every particle is as new."""
    ledger = room.ledger
    for i in range(len(ledger.energy)):
        ledger.energy[i] = 0.0
    for i in range(len(ledger.counts)):
        ledger.counts[i] = 0
    ledger.residual[0] = 0.0
    room.initial[0]["begun"] = 0
    particles = room.particles
    particles.size[0] = grains
    particles.labels_given[0] = grains
    for i in range(len(particles.records)):
        particles.records[i] = room.template[0]
        particle = particles.records[i]
        particle["label"] = i
        if i >= grains:
            particle["radius"] = 0.0
            particle["mass"] = 0.0


@inlined
def place(sizes, scene, room, callee, random, draws, k, abort):
    """Draw places and velocities of the grains of sample k; return whether all have a place."""
    placed, velocity, half_width = room.placed, room.velocity, scene.half_width
    if sizes is None:
        equal = EqualSizes(2.0 * scene.radius)
        return call_placement(
            callee,
            (scene.escape, scene.velocities, random, equal, half_width, placed, velocity, abort),
        )
    else:  # noqa: RET505  (types decide this one when it is compiled)
        radii = draws.radii[k]
        largest = radii[0]
        if not largest < half_width:
            return False
        for i in range(len(radii)):
            grain = room.particles.records[i]
            grain["radius"] = radii[i]
            grain["mass"] = draws.masses[k, i]
        different = DifferentSizes(radii, largest)
        return call_placement(
            callee,
            (
                scene.escape,
                scene.velocities,
                random,
                different,
                half_width,
                placed,
                velocity,
                abort,
            ),
        )


@inlined
def put_grains(particles, placed, velocity):
    """Give the grains their positions and velocities."""
    for i in range(placed.shape[1]):
        particle = particles.records[i]
        set_position(particle, (placed[0, i], placed[1, i], placed[2, i]))
        set_velocity(particle, (velocity[0, i], velocity[1, i], velocity[2, i]))
