"""What both published steppers keep from step to step, and between the stretches of a run.

Between stretches a step is under way: its contacts are resolved, its motion is not done.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, stage
from agglom_mpi.simulation.engines import begin, stand
from agglom_mpi.simulation.neighbours import Neighbours, new_neighbours
from agglom_mpi.simulation.scene import AdaptiveSteps, FixedSteps
from agglom_mpi.simulation.step_frames import copy_in_step
from agglom_mpi.simulation.stepping import cool, move

NEARLY: Final = 1e-9
"""Share of a step by which a time may miss its end and still be its end, by rounding."""

BEGINNING: Final = 0
LENGTH: Final = 1
"""Places in `Steps.clock`."""


class Steps(NamedTuple):
    """What both steppers keep.

    Attributes
    ----------
    partner, squared
        Everybody's nearest neighbour, and the squared distance in m², shape (capacity,).
    neighbours
        Candidate lists.
    merged, reach
        Whether the last contacts merged any, and the largest radius in m; shape (1,).
    clock
        When the step under way began and how long it is, in s; shape (2,).
    number
        Steps begun, shape (1,).
    """

    partner: np.ndarray
    squared: np.ndarray
    neighbours: Neighbours
    merged: np.ndarray
    reach: np.ndarray
    clock: np.ndarray
    number: np.ndarray


@allocating
def new_steps(particles):  # type: ignore[no-untyped-def]
    """Return what a stepper keeps before the first step."""
    capacity = particles.mass.size
    return Steps(
        np.empty(capacity, np.int64),
        np.empty(capacity),
        new_neighbours(capacity),
        np.ones(1, np.bool_),
        np.zeros(1),
        np.zeros(2),
        np.zeros(1, np.int64),
    )


@begin.answer(FixedSteps, AdaptiveSteps)
def _before_the_first(engine, scene, particles):  # type: ignore[no-untyped-def]
    return new_steps(particles)


@stage
def note_step(steps, time, length):  # type: ignore[no-untyped-def]
    """Note that a step of `length` in s is under way since `time` in s."""
    steps.clock[BEGINNING] = time
    steps.clock[LENGTH] = length
    steps.number[0] += 1


@stage
def end_of_step(steps):  # type: ignore[no-untyped-def]
    """When the step under way ends, in s."""
    return steps.clock[BEGINNING] + steps.clock[LENGTH]


@stage
def is_over(steps, end, length, time):  # type: ignore[no-untyped-def]
    """Whether at `time` in s the step under way, which is to `end`, is over; none always is."""
    return time > end + NEARLY * length


@stage
def finish_step(scene, particles, ledger, steps):  # type: ignore[no-untyped-def]
    """Let everybody move and cool to the end of the step under way, if there is one."""
    if steps.number[0] > 0:
        move(scene, particles, steps.clock[LENGTH])
        cool(scene.cooling, scene, particles, ledger, steps.clock[LENGTH])


@stand.answer(FixedSteps, AdaptiveSteps)
def _in_step(engine, scene, particles, kept, recorder, time):  # type: ignore[no-untyped-def]
    length = kept.clock[LENGTH]
    flight = time - kept.clock[BEGINNING]
    if flight > (1.0 - NEARLY) * length:
        flight = length
    copy_in_step(recorder, scene, particles, flight)
