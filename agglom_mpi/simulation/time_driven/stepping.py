"""Parts that both published steppers share: state between steps, motion.

Between two parts of a run a step is under way: its contacts are resolved, its motion is not done.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import wrapped_position
from agglom_mpi.simulation.engines import AdaptiveSteps, FixedSteps
from agglom_mpi.simulation.particles import (
    PARTICLE_STEPS,
    STEPS,
    moved_by,
    set_position,
    velocity_of,
)
from agglom_mpi.simulation.scene import (
    begin,
    copy_at,
    finish,
    new_engine_state,
)
from agglom_mpi.simulation.temperature import cool_over_step
from agglom_mpi.simulation.time_driven.neighbours import (
    NeighbourList,
    copy_position,
    mark_changed,
    new_neighbour_list,
    reset_neighbour_list,
)
from agglom_mpi.simulation.trajectory import copy_particles
from agglom_mpi.simulation.vectors import dot

TIME_TOLERANCE: Final = 1e-9
"""Share of a step by which a time may miss its end and still be its end, by rounding."""

STEP_START: Final = 0
STEP_LENGTH: Final = 1
"""Places in `StepperState.clock`."""


class StepperState(NamedTuple):
    """State of both steppers beside the particles.

    Attributes
    ----------
    partner, squared
        Nearest neighbour of each particle, and the squared distance in m², shape (capacity,).
    neighbours
        Candidate lists.
    merged, reach
        Whether the last contacts merged any, and the largest radius in m; shape (1,).
    clock
        Beginning and length of the step under way in s; shape (2,).
    number
        Steps begun, shape (1,).
    """

    partner: np.ndarray
    squared: np.ndarray
    neighbours: NeighbourList
    merged: np.ndarray
    reach: np.ndarray
    clock: np.ndarray
    number: np.ndarray


def new_stepper_state(capacity: int) -> StepperState:
    """Return the state of a stepper with room for `capacity` particles."""
    return StepperState(
        np.empty(capacity, np.int64),
        np.empty(capacity),
        new_neighbour_list(capacity),
        np.empty(1, np.bool_),
        np.zeros(1),
        np.empty(2),
        np.empty(1, np.int64),
    )


@new_engine_state.register(FixedSteps, AdaptiveSteps)
def _new_steps(engine, scene, capacity):
    return new_stepper_state(capacity)


@begin.register(FixedSteps, AdaptiveSteps)
def _begin_steps(engine, scene, particles, steps):
    reset_neighbour_list(steps.neighbours)
    steps.merged[0] = True
    steps.clock[:] = 0.0
    steps.number[0] = 0


@inlined
def begin_step(steps, time, length):
    """Set the step under way: from `time` in s, of `length` in s."""
    steps.clock[STEP_START] = time
    steps.clock[STEP_LENGTH] = length
    steps.number[0] += 1


@inlined
def end_of_step(steps):
    """End of the step under way in s."""
    return steps.clock[STEP_START] + steps.clock[STEP_LENGTH]


@inlined
def is_step_over(end, length, time):
    """Whether a step of `length` that ends at `end` is over at `time`; s."""
    return time > end + TIME_TOLERANCE * length


@inlined
def finish_step(scene, particles, ledger, steps):
    """Move and cool all particles to the end of the step under way, if there is one."""
    if steps.number[0] > 0:
        move_particles(scene, particles, steps.clock[STEP_LENGTH])
        cool_over_step(scene.cooling, scene, particles, ledger, steps.clock[STEP_LENGTH])


@inlined
def time_in_step(steps, time):
    """Time in s from the beginning of the step under way to `time`, at most the step's length."""
    length = steps.clock[STEP_LENGTH]
    flight = time - steps.clock[STEP_START]
    return length if flight > (1.0 - TIME_TOLERANCE) * length else flight


@finish.register(FixedSteps, AdaptiveSteps)
def _finish_steps(engine, scene, particles, ledger, steps, time):
    step = time_in_step(steps, time)
    move_particles(scene, particles, step)
    cool_over_step(scene.cooling, scene, particles, ledger, step)


@copy_at.register(FixedSteps, AdaptiveSteps)
def _copy_in_step(engine, scene, particles, steps, observer, time):
    copy, step = copy_particles(observer, particles), time_in_step(steps, time)
    move_particles(scene, copy, step)
    cool_over_step(scene.cooling, scene, copy, observer.ledger, step)


@inlined
def shift_apart(scene, one, other, distance, reach):
    """Shift both spheres along their outgoing velocities by their share of the overlap  [A 8].

    `distance` of the centres and `reach`, the sum of the radii, in m, are those at contact.
    """
    overlap = 1.0 - distance / reach
    if overlap > 0.0:
        for particle in (one, other):
            velocity = velocity_of(particle)
            speed = math.sqrt(dot(velocity, velocity))
            if speed > 0.0:
                length = overlap * particle["radius"]
                shift = (
                    length * velocity[0] / speed,
                    length * velocity[1] / speed,
                    length * velocity[2] / speed,
                )
                set_position(particle, wrapped_position(scene, moved_by(particle, 1.0, shift)))


@inlined
def move_particles(scene, particles, step):
    """Move every particle with its velocity for `step` in s  [A 9]."""
    for i in range(particles.size[0]):
        particle = particles.records[i]
        moved = moved_by(particle, step, velocity_of(particle))
        set_position(particle, wrapped_position(scene, moved))


@inlined
def count_step(particles, ledger):
    """Count one time step in the ledger."""
    ledger.counts[STEPS] += 1
    ledger.counts[PARTICLE_STEPS] += particles.size[0]


@inlined
def mark_merged(particles, neighbours, i, j):
    """Tell the neighbour lists that particle j merged into i."""
    mark_changed(neighbours, i)
    copy_position(particles, neighbours, i)
    copy_position(particles, neighbours, j)


@inlined
def mark_bounced(particles, neighbours, i, j, size_before):
    """Tell the neighbour lists that i and j bounced, and of the pieces appended meanwhile."""
    copy_position(particles, neighbours, i)
    copy_position(particles, neighbours, j)
    for k in range(size_before, particles.size[0]):
        mark_changed(neighbours, k)
        copy_position(particles, neighbours, k)


@inlined
def is_contact(one, other, squared):
    """Whether two spheres at this squared centre distance in m² touch or overlap."""
    reach = one["radius"] + other["radius"]
    return squared <= reach * reach
