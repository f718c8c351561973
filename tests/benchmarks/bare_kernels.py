"""Kernels with nothing in them but frictionless impacts of a constant restitution, to compare with.

How particles are predicted, celled and listed is the package's, and its vectors serve here, too;
what happens at a hit is written by hand: no submodels, no merging, no ledger but two counts.
"""

import math
from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import wrapped_position
from agglom_mpi.simulation.collision import apply_impulse
from agglom_mpi.simulation.event_driven.cell_crossing import cross_cell, schedule_crossing
from agglom_mpi.simulation.event_driven.cells import (
    FITTING_SHARE,
    MAX_ALL_PAIRS,
    best_edge,
    choose_range,
    copy_if_oversize,
    insert,
    max_cells,
    reset_cells,
)
from agglom_mpi.simulation.event_driven.engine import entry, predict_due
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
from agglom_mpi.simulation.particles import moved_by, position_of, set_position, velocity_of
from agglom_mpi.simulation.time_driven.neighbours import (
    find_partners,
    update_neighbours,
)
from agglom_mpi.simulation.time_driven.stepping import move_particles
from agglom_mpi.simulation.vectors import dot, relative_velocity, scaled, separation_vector

NO_PARTICLE = -1


# Velocities first: Numba would take other records for these if they began with the same fields.
BARE = np.dtype([(name, "f8") for name in ("u", "v", "w", "x", "y", "z")])


class Bare(NamedTuple):
    """Nothing but records of position and velocity, shape (N,)."""

    records: np.ndarray


def bare_state(particles):
    """Return position and velocity of particles."""
    state = np.empty(particles.records.size, BARE)
    for name in BARE.names:
        state[name] = particles.records[name]
    return Bare(state)


@inlined
def bounce(one, other, e, line):
    """Let two equal spheres bounce whose centres are a line in m apart; whether they do."""
    normal = scaled(line, 1.0 / math.sqrt(dot(line, line)))
    approach = dot(relative_velocity(one, other), normal)
    if not approach > 0.0:
        return False
    change = scaled(normal, 0.5 * (1.0 + e) * approach)
    apply_impulse(one, -1.0, change)
    apply_impulse(other, 1.0, change)
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
        face = cross_cell(scene, state, None, cells, flights, i, now)
        schedule_crossing(scene, cells, flights, i)
        return i, NO_PARTICLE, face
    if flights.next_event[j]["version"] != next_event["partner_version"]:
        next_event["collision_time"] = np.inf
        next_event["partner"] = NO_PARTICLE
        return i, NO_PARTICLE, RANGE
    i, j = min(i, j), max(i, j)
    synchronise_particle(scene, state, None, flights, i, now)
    synchronise_particle(scene, state, None, flights, j, now)
    one, other = state.records[i], state.records[j]
    line = separation_vector(scene.escape, one, other, scene.half_width)
    counts[1] += int(bounce(one, other, scene.laws.restitution.value, line))
    load_velocity(flights, state, i)
    load_velocity(flights, state, j)
    copy_if_oversize(cells, flights, i)
    copy_if_oversize(cells, flights, j)
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
    counts, never = np.zeros(2, np.int64), np.zeros(1, np.uint8)
    reset_event_queue(events.event_queue)
    predict_due(scene, events, entry(rebuild(scene, particles, events, 0.0)), 0.0, never)
    loop(scene, particles, events, counts)
    synchronise(scene, particles, None, events, scene.end_time)
    return counts


@kernel
def events_of_bare_state(scene, state, events):
    """Run the events of spheres of which only positions and velocities are kept."""
    counts = np.zeros(2, np.int64)
    begin(scene, state, events)
    loop(scene, state, events, counts)
    for i in range(scene.particles):
        synchronise_particle(scene, state, None, events.flights, i, scene.end_time)
    return counts


@inlined
def begin(scene, state, events):
    """Insert all particles into cells, or among the oversize where they are few, and predict."""
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
        set_position(trajectory, position_of(state.records[i]))
        trajectory["time"], trajectory["radius"] = 0.0, scene.radius
        load_velocity(events.flights, state, i)
        insert(scene, events.cells, events.flights, i)
        schedule_crossing(scene, events.cells, events.flights, i)
        predict_collision(
            scene, events.cells, events.flights, events.event_queue, i, 0.0, RANGE, NO_PARTICLE
        )


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
    bounces, limit = 0, 4.0 * scene.radius * scene.radius
    for i in range(scene.particles):
        j = partner[i]
        if j < 0 or squared[i] > limit:
            continue
        one, other = particles.records[i], particles.records[j]
        line = separation_vector(scene.escape, one, other, scene.half_width)
        square = dot(line, line)
        if square <= limit and bounce(one, other, scene.laws.restitution.value, line):
            bounces += 1
            overlap = 1.0 - math.sqrt(square) / (2.0 * scene.radius)
            shift(scene, one, overlap)
            shift(scene, other, overlap)
    return bounces


@inlined
def shift(scene, particle, overlap):
    """Shift a sphere along its velocity by its share of the overlap  [A 8]."""
    velocity = velocity_of(particle)
    speed = math.sqrt(dot(velocity, velocity))
    if overlap > 0.0 and speed > 0.0:
        moved = moved_by(particle, overlap * scene.radius / speed, velocity)
        set_position(particle, wrapped_position(scene, moved))
