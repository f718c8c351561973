"""Parts that both published steppers share: state between steps, frames, motion, cooling.

Between stretches a step is under way: its contacts are resolved, its motion is not done.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import dispatch, inlined, inlined_allocating, not_inlined
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling, euler_step
from agglom_mpi.simulation.boundary import wrapped
from agglom_mpi.simulation.particles import FLOORED, PARTICLE_STEPS, STEPS, record_cooling
from agglom_mpi.simulation.scene import AdaptiveSteps, FixedSteps, copy_at, initialize
from agglom_mpi.simulation.time_driven.neighbours import (
    NeighbourList,
    new_neighbour_list,
    note_moved,
)
from agglom_mpi.simulation.trajectory import copy_all, finish, next_frame

NEARLY: Final = 1e-9
"""Share of a step by which a time may miss its end and still be its end, by rounding."""

BEGINNING: Final = 0
LENGTH: Final = 1
"""Places in `Steps.clock`."""


class StepperState(NamedTuple):
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
    neighbours: NeighbourList
    merged: np.ndarray
    reach: np.ndarray
    clock: np.ndarray
    number: np.ndarray


@inlined_allocating
def new_steps(particles):
    """Return what a stepper keeps before the first step."""
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
def _before_the_first(engine, scene, particles):
    return new_steps(particles)


@inlined
def note_step(steps, time, length):
    """Note that a step of `length` in s is under way since `time` in s."""
    steps.clock[BEGINNING] = time
    steps.clock[LENGTH] = length
    steps.number[0] += 1


@inlined
def end_of_step(steps):
    """When the step under way ends, in s."""
    return steps.clock[BEGINNING] + steps.clock[LENGTH]


@inlined
def is_over(steps, end, length, time):
    """Whether at `time` in s the step under way, which is to `end`, is over; none always is."""
    return time > end + NEARLY * length


@inlined
def finish_step(scene, particles, ledger, steps):
    """Let everybody move and cool to the end of the step under way, if there is one."""
    if steps.number[0] > 0:
        move(scene, particles, steps.clock[LENGTH])
        cool(scene.cooling, scene, particles, ledger, steps.clock[LENGTH])


@copy_at.register(FixedSteps, AdaptiveSteps)
def _in_step(engine, scene, particles, engine_state, recorder, time):
    length = engine_state.clock[LENGTH]
    flight = time - engine_state.clock[BEGINNING]
    if flight > (1.0 - NEARLY) * length:
        flight = length
    copy_in_step(recorder, scene, particles, flight)


@inlined
def record_step(recorder, scene, particles, begin, step, end):
    """Take the frames after `begin` and up to `end` in s, between which all move for `step` in s.

    Those at `begin` are taken: contacts come first in a step, and a run that ends has none more.
    """
    if recorder is not None:
        time = next_frame(recorder, scene.end_time)
        while time <= end:
            flight = step if time == end else min(step, time - begin)
            take_in_step(recorder, scene, particles, flight, time)
            time = next_frame(recorder, scene.end_time)


@not_inlined
def take_in_step(recorder, scene, particles, flight, time):
    """Take the frame at `time` in s, to which all move for `flight` in s."""
    copy_in_step(recorder, scene, particles, flight)
    finish(recorder, scene, time)


@inlined
def copy_in_step(recorder, scene, particles, flight):
    """Copy the particles, and let the copies move for `flight` in s."""
    copy = copy_all(recorder, particles)
    move(scene, copy, flight)
    cool(scene.cooling, scene, copy, recorder.ledger, flight)


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
def move(scene, particles, step):
    """Move every particle with its velocity for `step` in s  [A 9]."""
    escape, half = scene.escape, scene.half_width
    for axis in range(3):
        r, v = particles.position[axis], particles.velocity[axis]
        for i in range(particles.size[0]):
            r[i] = wrapped(escape, r[i] + step * v[i], half)


@dispatch
def cool(cooling, scene, particles, ledger, step):
    """Cool every particle over one step in s, where the scene cools step by step."""


@cool.register(None, ExactCooling)
def _nothing_to_cool(cooling, scene, particles, ledger, step):
    return None


@cool.register(EulerCooling)
def _euler_steps(cooling, scene, particles, ledger, step):
    for i in range(particles.size[0]):
        before = particles.temperature[i]
        surface = 4.0 * math.pi * particles.radius[i] ** 2
        capacity = particles.mass[i] * scene.laws.heat_capacity
        after = euler_step(cooling.law, before, surface, capacity, step)
        if after < 0.0:
            ledger.tally[FLOORED] += 1
            after = 0.0
        record_cooling(ledger, capacity * (before - after))
        particles.temperature[i] = after


@inlined
def count_step(particles, ledger):
    """Book one time step."""
    ledger.tally[STEPS] += 1
    ledger.tally[PARTICLE_STEPS] += particles.size[0]


@inlined
def note_new(particles, neighbours, size_before):
    """Tell the neighbour lists of the pieces appended since there were `size_before` slots."""
    for i in range(size_before, particles.size[0]):
        note_moved(neighbours, i)


@inlined
def is_contact(radius, i, j, squared):
    """Whether two spheres at this squared centre distance in m² touch or overlap."""
    reach = radius[i] + radius[j]
    return squared <= reach * reach


@inlined
def aborted(abort):
    """Whether somebody asked this sample to stop."""
    return abort[0] != np.uint8(0)
