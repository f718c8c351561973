"""The stepper of [A]: equal steps, each particle's nearest neighbour in turn, merges at once."""

import math

from agglom_mpi.compilation import stage
from agglom_mpi.simulation.contact import BONDED, BOUNCED, collide, merge
from agglom_mpi.simulation.engines import advance, go_on
from agglom_mpi.simulation.neighbours import (
    MOVED,
    find_partners,
    mend_partner,
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
from agglom_mpi.simulation.steps import finish_step, is_over, new_steps, note_step


@advance.answer(FixedSteps)
def _fixed_steps(engine, scene, particles, ledger, abort, recorder):  # type: ignore[no-untyped-def]
    steps = new_steps(particles)
    step = scene.end_time / engine.steps
    for index in range(engine.steps):
        time = index * step
        if aborted(abort):
            return time
        take_contacts(scene, particles, ledger, steps, time)
        record_step(recorder, scene, particles, time, step, (index + 1) * step)
        move(scene, particles, step)
        cool(scene.cooling, scene, particles, ledger, step)
    return scene.end_time


@go_on.answer(FixedSteps)
def _more_steps(engine, scene, particles, ledger, kept, until, abort):  # type: ignore[no-untyped-def]
    step = scene.end_time / engine.steps
    while is_over(kept, kept.number[0] * step, step, until) and not aborted(abort):
        finish_step(scene, particles, ledger, kept)
        time = kept.number[0] * step
        take_contacts(scene, particles, ledger, kept, time)
        note_step(kept, time, step)
    return until


@stage
def take_contacts(scene, particles, ledger, steps, time):  # type: ignore[no-untyped-def]
    """Resolve the contacts at the beginning of a step, at `time` in s."""
    partner, squared, neighbours = steps.partner, steps.squared, steps.neighbours
    merged = steps.merged[0]
    count_step(particles, ledger)
    if merged:  # breaking only makes it less
        steps.reach[0] = largest_radius(particles)
    reach = steps.reach[0]
    update_neighbours(scene, particles, neighbours, time, merged, 2.0 * reach)
    find_partners(scene, particles, neighbours, partner, squared, reach)
    merged = resolve_in_turn(scene, particles, ledger, neighbours, partner, squared, time)
    if merged:
        compact(particles)
    steps.merged[0] = merged


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
