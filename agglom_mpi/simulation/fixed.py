"""The stepper of [A]: equal steps, each particle's nearest neighbour in turn, merges at once."""

import math

import numpy as np

from agglom_mpi.compilation import stage
from agglom_mpi.simulation.contact import BONDED, BOUNCED, collide, merge
from agglom_mpi.simulation.engines import advance
from agglom_mpi.simulation.neighbours import (
    MOVED,
    find_partners,
    mend_partner,
    new_neighbours,
    note_moved,
    squared_distance,
    update_neighbours,
)
from agglom_mpi.simulation.particles import compact
from agglom_mpi.simulation.scene import FixedSteps
from agglom_mpi.simulation.step_frames import record_step
from agglom_mpi.simulation.stepping import (
    aborted,
    cool,
    count_step,
    is_contact,
    largest_radius,
    move,
    note_new,
    shift_apart,
)


@advance.answer(FixedSteps)
def _fixed_steps(engine, scene, particles, ledger, abort, recorder):  # type: ignore[no-untyped-def]
    capacity = particles.mass.size
    partner = np.empty(capacity, np.int64)
    squared = np.empty(capacity)
    neighbours = new_neighbours(capacity)
    step = scene.end_time / engine.steps
    reach = 0.0
    merged = True
    for index in range(engine.steps):
        time = index * step
        if aborted(abort):
            return time
        count_step(particles, ledger)
        if merged:  # breaking only makes it less
            reach = largest_radius(particles)
        update_neighbours(scene, particles, neighbours, time, merged, 2.0 * reach)
        find_partners(scene, particles, neighbours, partner, squared, reach)
        merged = resolve_in_turn(scene, particles, ledger, neighbours, partner, squared, time)
        if merged:
            compact(particles)
        record_step(recorder, scene, particles, time, step, (index + 1) * step)
        move(scene, particles, step)
        cool(scene.cooling, scene, particles, ledger, step)
    return scene.end_time


@stage
def resolve_in_turn(scene, particles, ledger, neighbours, partner, squared, time):  # type: ignore[no-untyped-def]
    """Let each particle collide with its nearest neighbour if they touch; whether any merged."""
    merged = False
    mass, radius, moved = particles.mass, particles.radius, neighbours.tally
    for i in range(particles.size[0]):
        if moved[MOVED] > 0:
            if mass[i] == 0.0:  # merged in this step, or it would have been compacted
                continue
            mend_partner(scene, particles, neighbours, partner, squared, i)
        j = partner[i]
        if j < 0 or not is_contact(radius, i, j, squared[i]):
            continue
        current = squared_distance(scene.escape, particles.position, i, j, scene.half_width)
        if not is_contact(particles.radius, i, j, current):
            continue
        reach = particles.radius[i] + particles.radius[j]
        size = particles.size[0]
        kind = collide(scene, particles, ledger, i, j, time)
        if kind == BONDED:
            merge(scene, particles, ledger, i, j, time)
            note_moved(neighbours, i)
            merged = True
        elif kind == BOUNCED:
            note_new(particles, neighbours, size)
            shift_apart(scene, particles, i, j, math.sqrt(current), reach)
    return merged
