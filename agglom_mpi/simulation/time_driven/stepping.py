"""Parts that both published steppers share: state between steps, frames, motion.

Between two parts of a run a step is under way: its contacts are resolved, its motion is not done.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, inlined_allocating, not_inlined
from agglom_mpi.simulation.boundary import wrapped
from agglom_mpi.simulation.particles import PARTICLE_STEPS, STEPS
from agglom_mpi.simulation.scene import AdaptiveSteps, FixedSteps, copy_at, initialize
from agglom_mpi.simulation.temperature import cool_over_step
from agglom_mpi.simulation.time_driven.neighbours import (
    NeighbourList,
    mark_changed,
    new_neighbour_list,
)
from agglom_mpi.simulation.trajectory import copy_particles, finish_frame, next_frame_time

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


@inlined_allocating
def new_stepper_state(particles):
    """Return the state of a stepper before the first step."""
    capacity = particles.mass.size
    return StepperState(
        np.empty(capacity, np.int64),
        np.empty(capacity),
        new_neighbour_list(capacity),
        np.ones(1, np.bool_),
        np.zeros(1),
        np.zeros(2),
        np.zeros(1, np.int64),
    )


@initialize.register(FixedSteps, AdaptiveSteps)
def _initialize_steps(engine, scene, particles):
    return new_stepper_state(particles)


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
def is_step_over(steps, end, length, time):
    """Whether the step under way, which ends at `end`, is over at `time`; s."""
    return time > end + TIME_TOLERANCE * length


@inlined
def finish_step(scene, particles, ledger, steps):
    """Move and cool all particles to the end of the step under way, if there is one."""
    if steps.number[0] > 0:
        move_particles(scene, particles, steps.clock[STEP_LENGTH])
        cool_over_step(scene.cooling, scene, particles, ledger, steps.clock[STEP_LENGTH])


@copy_at.register(FixedSteps, AdaptiveSteps)
def _in_step(engine, scene, particles, engine_state, recorder, time):
    length = engine_state.clock[STEP_LENGTH]
    flight = time - engine_state.clock[STEP_START]
    if flight > (1.0 - TIME_TOLERANCE) * length:
        flight = length
    copy_particles_in_step(recorder, scene, particles, flight)


@inlined
def record_frames_in_step(recorder, scene, particles, begin, step, end):
    """Record the frames after `begin` and up to `end` in s, between which all move for `step` in s.

    Those at `begin` are stored before: contacts come first in a step, and a run that ends at
    `begin` has none of them.
    """
    if recorder is not None:
        time = next_frame_time(recorder, scene.end_time)
        while time <= end:
            flight = step if time == end else min(step, time - begin)
            record_frame_in_step(recorder, scene, particles, flight, time)
            time = next_frame_time(recorder, scene.end_time)


@not_inlined
def record_frame_in_step(recorder, scene, particles, flight, time):
    """Record the frame at `time` in s, to which all move for `flight` in s."""
    copy_particles_in_step(recorder, scene, particles, flight)
    finish_frame(recorder, scene, time)


@inlined
def copy_particles_in_step(recorder, scene, particles, flight):
    """Copy the particles, and let the copies move for `flight` in s."""
    copy = copy_particles(recorder, particles)
    move_particles(scene, copy, flight)
    cool_over_step(scene.cooling, scene, copy, recorder.ledger, flight)


@inlined
def shift_apart(scene, particles, i, j, distance, reach):
    """Shift both spheres along their outgoing velocities by their share of the overlap  [A 8].

    `distance` of the centres and `reach`, the sum of the radii, in m, are those at contact.
    """
    overlap = 1.0 - distance / reach
    if overlap > 0.0:
        for k in (i, j):
            v = particles.velocity
            speed = math.sqrt(v[0, k] ** 2 + v[1, k] ** 2 + v[2, k] ** 2)
            if speed > 0.0:
                length = overlap * particles.radius[k]
                for axis in range(3):
                    coordinate = particles.position[axis, k] + length * v[axis, k] / speed
                    particles.position[axis, k] = wrapped(
                        scene.escape, coordinate, scene.half_width
                    )


@inlined
def move_particles(scene, particles, step):
    """Move every particle with its velocity for `step` in s  [A 9]."""
    escape, half = scene.escape, scene.half_width
    for axis in range(3):
        r, v = particles.position[axis], particles.velocity[axis]
        for i in range(particles.size[0]):
            r[i] = wrapped(escape, r[i] + step * v[i], half)


@inlined
def count_step(particles, ledger):
    """Count one time step in the ledger."""
    ledger.counts[STEPS] += 1
    ledger.counts[PARTICLE_STEPS] += particles.size[0]


@inlined
def mark_new(particles, neighbours, size_before):
    """Mark the pieces appended since there were `size_before` slots for the neighbour lists."""
    for i in range(size_before, particles.size[0]):
        mark_changed(neighbours, i)


@inlined
def is_contact(radius, i, j, squared):
    """Whether two spheres at this squared centre distance in m² touch or overlap."""
    reach = radius[i] + radius[j]
    return squared <= reach * reach


@inlined
def is_aborted(abort):
    """Whether the run was asked to stop."""
    return abort[0] != np.uint8(0)
