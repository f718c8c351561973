"""Kernels with nothing in them but frictionless impacts of a constant restitution, to compare with.

How particles are predicted, celled and listed is the package's; what happens at a hit is written
here by hand: no submodels, no merging, no ledger but two counts.
"""

import math
from typing import NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, kernel
from agglom_mpi.simulation.boundary import separation, wrapped
from agglom_mpi.simulation.event_driven.cell_crossing import cross_cell, schedule_crossing
from agglom_mpi.simulation.event_driven.cells import (
    FITTING_SHARE,
    MAX_ALL_PAIRS,
    best_edge,
    choose_range,
    insert,
    max_cells,
    reset_cells,
)
from agglom_mpi.simulation.event_driven.engine import no_contact, predict_due
from agglom_mpi.simulation.event_driven.event_queue import (
    earliest,
    earliest_time,
    reset_event_queue,
)
from agglom_mpi.simulation.event_driven.flights import (
    RANGE,
    load_velocity,
    synchronise_particle,
)
from agglom_mpi.simulation.event_driven.prediction import predict_collision
from agglom_mpi.simulation.event_driven.state import rebuild, synchronise
from agglom_mpi.simulation.time_driven.neighbours import (
    find_partners,
    update_neighbours,
)
from agglom_mpi.simulation.time_driven.stepping import move_particles

NO_PARTICLE = -1


class Bare(NamedTuple):
    """Nothing but position and velocity, shape (3, N)."""

    position: np.ndarray
    velocity: np.ndarray


@inlined
def bounce(velocity, e, dx, dy, dz, i, j):
    """Let two equal spheres bounce whose centres are (dx, dy, dz) in m apart; whether they do."""
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    x, y, z = dx / length, dy / length, dz / length
    approach = (
        (velocity[0, i] - velocity[0, j]) * x
        + (velocity[1, i] - velocity[1, j]) * y
        + (velocity[2, i] - velocity[2, j]) * z
    )
    if not approach > 0.0:
        return False
    change = 0.5 * (1.0 + e) * approach
    velocity[0, i] -= change * x
    velocity[1, i] -= change * y
    velocity[2, i] -= change * z
    velocity[0, j] += change * x
    velocity[1, j] += change * y
    velocity[2, j] += change * z
    return True


@inlined
def process_next(scene, state, events, counts, now):
    """Process the next event; return whom to predict for."""
    flights, cells = events.flights, events.cells
    counts[0] += 1
    i = earliest(events.event_queue)
    next_event = flights.next_event[i]
    j = np.int64(next_event["partner"])
    if next_event["crossing_time"] <= next_event["collision_time"]:
        return i, NO_PARTICLE, cross_cell(scene, state, cells, flights, i, now)
    if flights.next_event[j]["version"] != next_event["partner_version"]:
        next_event["collision_time"] = np.inf
        next_event["partner"] = NO_PARTICLE
        return i, NO_PARTICLE, RANGE
    i, j = min(i, j), max(i, j)
    synchronise_particle(scene, state, flights, i, now)
    synchronise_particle(scene, state, flights, j, now)
    r, half = state.position, scene.half_width
    dx = separation(scene.escape, r[0, j] - r[0, i], half)
    dy = separation(scene.escape, r[1, j] - r[1, i], half)
    dz = separation(scene.escape, r[2, j] - r[2, i], half)
    counts[1] += int(bounce(state.velocity, scene.laws.restitution.value, dx, dy, dz, i, j))
    load_velocity(flights, state, i)
    load_velocity(flights, state, j)
    schedule_crossing(scene, cells, flights, i)
    schedule_crossing(scene, cells, flights, j)
    return i, j, RANGE


@inlined
def loop(scene, state, events, counts):
    """Process events until the end."""
    cells, flights, event_queue = events.cells, events.flights, events.event_queue
    time = earliest_time(event_queue)
    while time <= scene.end_time:
        i, j, face = process_next(scene, state, events, counts, time)
        predict_collision(scene, cells, flights, event_queue, i, time, face, j)
        if j >= 0:
            predict_collision(scene, cells, flights, event_queue, j, time, RANGE, i)
        time = earliest_time(event_queue)


@kernel
def events_of_whole_state(scene, particles, events):
    """Run the events of particles with all that the package keeps of them; events and hits."""
    counts = np.zeros(2, np.int64)
    reset_event_queue(events.event_queue)
    predict_due(scene, events, no_contact(rebuild(scene, particles, events, 0.0), RANGE), 0.0)
    loop(scene, particles, events, counts)
    synchronise(scene, particles, events, scene.end_time)
    return counts


@kernel
def events_of_bare_state(scene, state, events):
    """Run the events of spheres of which only positions and velocities are kept."""
    counts = np.zeros(2, np.int64)
    begin(scene, state, events)
    for i in range(scene.particles):
        predict_collision(
            scene, events.cells, events.flights, events.event_queue, i, 0.0, RANGE, NO_PARTICLE
        )
    loop(scene, state, events, counts)
    for i in range(scene.particles):
        synchronise_particle(scene, state, events.flights, i, scene.end_time)
    return counts


@inlined
def begin(scene, state, events):
    """Insert all particles into cells, or among the oversize where they are few."""
    count, half = scene.particles, scene.half_width
    reset_event_queue(events.event_queue)
    edge = max(2.0 * scene.radius, best_edge(count, 2.0 * scene.radius, half))
    per_axis = (
        0
        if count <= MAX_ALL_PAIRS
        else min(max_cells(count), int(FITTING_SHARE * 2.0 * half / edge))
    )
    reset_cells(events.cells, per_axis)
    choose_range(scene, events.cells, scene.radius)
    for i in range(count):
        trajectory = events.flights.trajectory[i]
        trajectory["x"], trajectory["y"], trajectory["z"] = state.position[:, i]
        trajectory["time"], trajectory["radius"] = 0.0, scene.radius
        load_velocity(events.flights, state, i)
        insert(scene, events.cells, events.flights, i)
        schedule_crossing(scene, events.cells, events.flights, i)


@kernel
def steps_of_whole_state(scene, particles, neighbours):
    """Run the fixed steps of particles; steps and hits."""
    counts = np.zeros(2, np.int64)
    count = scene.particles
    partner, squared = np.empty(count, np.int64), np.empty(count)
    step = scene.end_time / scene.engine.steps
    reach = scene.radius
    for index in range(scene.engine.steps):
        counts[0] += 1
        time = index * step
        update_neighbours(scene, particles, neighbours, time, index == 0, 2.0 * reach)
        find_partners(scene, particles, neighbours, partner, squared, reach)
        counts[1] += bounce_in_turn(scene, particles, partner, squared)
        move_particles(scene, particles, step)
    return counts


@inlined
def bounce_in_turn(scene, particles, partner, squared):
    """Let each sphere bounce off its nearest neighbour if they touch; how many do."""
    r, half, bounces = particles.position, scene.half_width, 0
    limit = 4.0 * scene.radius * scene.radius
    for i in range(scene.particles):
        j = partner[i]
        if j < 0 or squared[i] > limit:
            continue
        dx = separation(scene.escape, r[0, j] - r[0, i], half)
        dy = separation(scene.escape, r[1, j] - r[1, i], half)
        dz = separation(scene.escape, r[2, j] - r[2, i], half)
        square = dx * dx + dy * dy + dz * dz
        restitution = scene.laws.restitution.value
        if square <= limit and bounce(particles.velocity, restitution, dx, dy, dz, i, j):
            bounces += 1
            overlap = 1.0 - math.sqrt(square) / (2.0 * scene.radius)
            shift(scene, particles, i, overlap)
            shift(scene, particles, j, overlap)
    return bounces


@inlined
def shift(scene, particles, i, overlap):
    """Shift a sphere along its velocity by its share of the overlap  [A 8]."""
    r, v = particles.position, particles.velocity
    speed = math.sqrt(v[0, i] ** 2 + v[1, i] ** 2 + v[2, i] ** 2)
    if overlap > 0.0 and speed > 0.0:
        length = overlap * scene.radius / speed
        r[0, i] = wrapped(scene.escape, r[0, i] + length * v[0, i], scene.half_width)
        r[1, i] = wrapped(scene.escape, r[1, i] + length * v[1, i], scene.half_width)
        r[2, i] = wrapped(scene.escape, r[2, i] + length * v[2, i], scene.half_width)
