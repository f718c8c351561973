"""What both published steppers share: shift, motion, cooling and the largest radius."""

import math

import numpy as np

from agglom_mpi.compilation import question, stage
from agglom_mpi.physics.cooling import Exact, ForwardEuler, euler_step
from agglom_mpi.simulation.box import inside
from agglom_mpi.simulation.neighbours import note_moved
from agglom_mpi.simulation.particles import FLOORED, PARTICLE_STEPS, STEPS, book_cooling


@stage
def shift_apart(scene, particles, i, j, distance, reach):  # type: ignore[no-untyped-def]
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
                    particles.position[axis, k] = inside(scene.escape, coordinate, scene.half_width)


@stage
def move(scene, particles, step):  # type: ignore[no-untyped-def]
    """Move every particle with its velocity for `step` in s  [A 9]."""
    escape, half = scene.escape, scene.half_width
    for axis in range(3):
        r, v = particles.position[axis], particles.velocity[axis]
        for i in range(particles.size[0]):
            r[i] = inside(escape, r[i] + step * v[i], half)


@question
def cool(cooling, scene, particles, ledger, step):  # type: ignore[no-untyped-def]
    """Cool every particle over one step in s, where the scene cools step by step."""


@cool.answer(None, Exact)
def _nothing_to_cool(cooling, scene, particles, ledger, step):  # type: ignore[no-untyped-def]
    return None


@cool.answer(ForwardEuler)
def _euler_steps(cooling, scene, particles, ledger, step):  # type: ignore[no-untyped-def]
    for i in range(particles.size[0]):
        before = particles.temperature[i]
        surface = 4.0 * math.pi * particles.radius[i] ** 2
        capacity = particles.mass[i] * scene.laws.heat_capacity
        after = euler_step(cooling.law, before, surface, capacity, step)
        if after < 0.0:
            ledger.tally[FLOORED] += 1
            after = 0.0
        book_cooling(ledger, capacity * (before - after))
        particles.temperature[i] = after


@stage
def largest_radius(particles):  # type: ignore[no-untyped-def]
    """Largest radius in m."""
    largest = 0.0
    for i in range(particles.size[0]):
        largest = max(largest, particles.radius[i])
    return largest


@stage
def count_step(particles, ledger):  # type: ignore[no-untyped-def]
    """Book one time step."""
    ledger.tally[STEPS] += 1
    ledger.tally[PARTICLE_STEPS] += particles.size[0]


@stage
def note_new(particles, neighbours, size_before):  # type: ignore[no-untyped-def]
    """Tell the neighbour lists of the pieces appended since there were `size_before` slots."""
    for i in range(size_before, particles.size[0]):
        note_moved(neighbours, i)


@stage
def is_contact(radius, i, j, squared):  # type: ignore[no-untyped-def]
    """Whether two spheres at this squared centre distance in m² touch or overlap."""
    reach = radius[i] + radius[j]
    return squared <= reach * reach


@stage
def aborted(abort):  # type: ignore[no-untyped-def]
    """Whether somebody asked this sample to stop."""
    return abort[0] != np.uint8(0)
