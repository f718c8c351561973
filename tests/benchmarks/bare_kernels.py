"""Kernels with nothing in them but frictionless impacts of a constant restitution, to compare with.

How particles are predicted, celled and listed is the package's; what happens at a hit is written
here by hand: no submodels, no merging, no ledger but two counts.
"""

import math
from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, kernel, stage
from agglom_mpi.simulation.box import inside, separation
from agglom_mpi.simulation.events.cell_size import BARELY, FEW, best_edge, choose_range, most_cells
from agglom_mpi.simulation.events.cells import enter, lay_out, new_cells
from agglom_mpi.simulation.events.engine import look_around, nothing_hit
from agglom_mpi.simulation.events.movers import (
    PATH,
    PLAN,
    RANGE,
    Movers,
    catch_up_position,
    load_velocity,
)
from agglom_mpi.simulation.events.prediction import look
from agglom_mpi.simulation.events.state import Events, new_events, settle_all, start_over
from agglom_mpi.simulation.events.tournament import earliest, earliest_time, new_tournament
from agglom_mpi.simulation.events.turns import set_turn, turn
from agglom_mpi.simulation.neighbours import find_partners, new_neighbours, update_neighbours
from agglom_mpi.simulation.stepping import move

NOBODY = -1


class Bare(NamedTuple):
    """Nothing but position and velocity, shape (3, N)."""

    position: np.ndarray
    velocity: np.ndarray


@stage
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


@stage
def take_next(scene, state, events, counts, now):
    """Let the next event happen; for whom to look around."""
    movers, cells = events.movers, events.cells
    counts[0] += 1
    i = earliest(events.tournament)
    plan = movers.plan[i]
    j = np.int64(plan["partner"])
    if plan["turn_time"] <= plan["hit_time"]:
        return i, NOBODY, turn(scene, state, cells, movers, i, now)
    if movers.plan[j]["version"] != plan["hit_version"]:
        plan["hit_time"] = np.inf
        plan["partner"] = NOBODY
        return i, NOBODY, RANGE
    i, j = min(i, j), max(i, j)
    catch_up_position(scene, state, movers, i, now)
    catch_up_position(scene, state, movers, j, now)
    r, half = state.position, scene.half_width
    dx = separation(scene.escape, r[0, j] - r[0, i], half)
    dy = separation(scene.escape, r[1, j] - r[1, i], half)
    dz = separation(scene.escape, r[2, j] - r[2, i], half)
    counts[1] += int(bounce(state.velocity, scene.laws.restitution.value, dx, dy, dz, i, j))
    load_velocity(movers, state, i)
    load_velocity(movers, state, j)
    set_turn(scene, cells, movers, i)
    set_turn(scene, cells, movers, j)
    return i, j, RANGE


@stage
def loop(scene, state, events, counts):
    """Let one event happen after another until the end."""
    cells, movers, tournament = events.cells, events.movers, events.tournament
    time = earliest_time(tournament)
    while time <= scene.end_time:
        i, j, face = take_next(scene, state, events, counts, time)
        look(scene, cells, movers, tournament, i, time, face, j)
        if j >= 0:
            look(scene, cells, movers, tournament, j, time, RANGE, i)
        time = earliest_time(tournament)


@kernel
def events_of_whole_state(scene, particles):
    """Run the events of particles with all that the package keeps of them; events and hits."""
    counts = np.zeros(2, np.int64)
    events = new_events(particles)
    look_around(scene, events, nothing_hit(start_over(scene, particles, events, 0.0), RANGE), 0.0)
    loop(scene, particles, events, counts)
    settle_all(scene, particles, events, scene.end_time)
    return counts


@kernel
def events_of_bare_state(scene, state):
    """Run the events of spheres of which only positions and velocities are kept."""
    counts = np.zeros(2, np.int64)
    events = begin(scene, state)
    for i in range(scene.particles):
        look(scene, events.cells, events.movers, events.tournament, i, 0.0, RANGE, NOBODY)
    loop(scene, state, events, counts)
    for i in range(scene.particles):
        catch_up_position(scene, state, events.movers, i, scene.end_time)
    return counts


@allocating
def begin(scene, state):
    """Put everybody into cells, or among the giants where they are few."""
    count, half = scene.particles, scene.half_width
    events = Events(
        Movers(np.zeros(count, PATH), np.zeros(count, PLAN)),
        new_cells(count, count),
        new_tournament(count),
        np.empty(0, np.int64),
        np.empty(0, np.int64),
    )
    edge = max(2.0 * scene.radius, best_edge(count, 2.0 * scene.radius, half))
    along = 0 if count <= FEW else min(most_cells(count), int(BARELY * 2.0 * half / edge))
    lay_out(events.cells, along)
    choose_range(events.cells, scene.radius, half)
    for i in range(count):
        path = events.movers.path[i]
        path["x"], path["y"], path["z"] = state.position[:, i]
        path["time"], path["radius"] = 0.0, scene.radius
        load_velocity(events.movers, state, i)
        enter(scene, events.cells, events.movers, i)
        set_turn(scene, events.cells, events.movers, i)
    return events


@kernel
def steps_of_whole_state(scene, particles):
    """Run the fixed steps of particles; steps and hits."""
    counts = np.zeros(2, np.int64)
    count = scene.particles
    partner, squared = np.empty(count, np.int64), np.empty(count)
    neighbours = new_neighbours(count)
    step = scene.end_time / scene.engine.steps
    reach = scene.radius
    for index in range(scene.engine.steps):
        counts[0] += 1
        time = index * step
        update_neighbours(scene, particles, neighbours, time, index == 0, 2.0 * reach)
        find_partners(scene, particles, neighbours, partner, squared, reach)
        counts[1] += bounce_in_turn(scene, particles, partner, squared)
        move(scene, particles, step)
    return counts


@stage
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


@stage
def shift(scene, particles, i, overlap):
    """Shift a sphere along its velocity by its share of the overlap  [A 8]."""
    r, v = particles.position, particles.velocity
    speed = math.sqrt(v[0, i] ** 2 + v[1, i] ** 2 + v[2, i] ** 2)
    if overlap > 0.0 and speed > 0.0:
        length = overlap * scene.radius / speed
        r[0, i] = inside(scene.escape, r[0, i] + length * v[0, i], scene.half_width)
        r[1, i] = inside(scene.escape, r[1, i] + length * v[1, i], scene.half_width)
        r[2, i] = inside(scene.escape, r[2, i] + length * v[2, i], scene.half_width)
