"""The steppers of the papers: equal steps [A]; the smallest gap over approach speed [B].

Equal steps take the nearest neighbour of each particle in turn and merge at once; adaptive steps
merge after all pairs of the step.
"""

import math
from typing import Final

import numpy as np

from agglom_mpi.compilation.stages import inlined, inlined_allocating
from agglom_mpi.simulation.collision import (
    BONDED,
    BOUNCED,
    dot,
    merge,
    relative_velocity,
    resolve_contact,
    separation_vector,
)
from agglom_mpi.simulation.engines import AdaptiveSteps, FixedSteps
from agglom_mpi.simulation.particles import EXHAUSTED, STEPS, compact, largest_radius
from agglom_mpi.simulation.scene import advance_to, is_aborted
from agglom_mpi.simulation.time_driven.neighbours import (
    CHANGED,
    find_partners,
    squared_distance,
    update_neighbours,
    update_partner,
)
from agglom_mpi.simulation.time_driven.stepping import (
    STEP_LENGTH,
    begin_step,
    count_step,
    end_of_step,
    finish_step,
    is_contact,
    is_step_over,
    mark_bounced,
    mark_merged,
    shift_apart,
)


@advance_to.register(FixedSteps)
def _advance_fixed_steps(engine, scene, particles, ledger, steps, until, abort):
    step = scene.end_time / engine.steps
    while is_step_over(steps.number[0] * step, step, until):
        time = steps.number[0] * step
        if is_aborted(abort):
            return time
        finish_step(scene, particles, ledger, steps)
        process_contacts_sequentially(scene, particles, ledger, steps, time)
        begin_step(steps, time, step)
    return until


@inlined
def process_contacts_sequentially(scene, particles, ledger, steps, time):
    """Resolve the contacts at the beginning of a step, at `time` in s, one after another."""
    partner, squared, neighbours = steps.partner, steps.squared, steps.neighbours
    merged = steps.merged[0]
    count_step(particles, ledger)
    if merged:  # breaking only makes it less
        steps.reach[0] = largest_radius(particles)
    reach = steps.reach[0]
    update_neighbours(scene, particles, neighbours, time, merged, 2.0 * reach)
    find_partners(scene, particles, neighbours, partner, squared, reach)
    merged = resolve_sequentially(scene, particles, ledger, neighbours, partner, squared, time)
    if merged:
        compact(particles)
    steps.merged[0] = merged


@inlined
def resolve_sequentially(scene, particles, ledger, neighbours, partner, squared, time):
    """Resolve each particle's contact with its nearest neighbour; return whether any merged."""
    merged = False
    for i in range(particles.size[0]):
        if neighbours.counts[CHANGED] > 0:
            if (
                particles.records[i]["mass"] == 0.0
            ):  # merged in this step, or it would have been compacted
                continue
            update_partner(scene, particles, neighbours, partner, squared, i)
        j = partner[i]
        if j < 0:
            continue
        one, other = particles.records[i], particles.records[j]
        if not is_contact(one, other, squared[i]):
            continue
        current = squared_distance(scene.escape, one, other, scene.half_width)
        if not is_contact(one, other, current):
            continue
        reach = one["radius"] + other["radius"]
        size = particles.size[0]
        kind = resolve_contact(scene, particles, ledger, i, j, time)
        if kind == BONDED:
            merge(scene, particles, ledger, i, j, time)
            mark_merged(particles, neighbours, i, j)
            merged = True
        elif kind == BOUNCED:
            shift_apart(scene, one, other, math.sqrt(current), reach)
            mark_bounced(particles, neighbours, i, j, size)
    return merged


MAX_STEPS: Final = 10_000_000
"""Steps after which a sample fails: its floor is too small for its end time."""


@advance_to.register(AdaptiveSteps)
def _advance_adaptive_steps(engine, scene, particles, ledger, steps, until, abort):
    while is_step_over(end_of_step(steps), steps.clock[STEP_LENGTH], until):
        time = end_of_step(steps)
        if ledger.counts[STEPS] >= MAX_STEPS:
            ledger.counts[EXHAUSTED] = 1
        if ledger.counts[EXHAUSTED] > 0 or is_aborted(abort):
            return time
        finish_step(scene, particles, ledger, steps)
        step = process_contacts_simultaneously(engine, scene, particles, ledger, steps, time)
        begin_step(steps, time, step)
    return until


@inlined
def process_contacts_simultaneously(engine, scene, particles, ledger, steps, time):
    """Resolve the contacts at the beginning of a step, at `time` in s; return its length in s."""
    partner, squared, neighbours = steps.partner, steps.squared, steps.neighbours
    count_step(particles, ledger)
    update_neighbours(scene, particles, neighbours, time, steps.merged[0], np.inf)
    find_partners(scene, particles, neighbours, partner, squared, np.inf)
    merged = resolve_simultaneously(scene, particles, ledger, neighbours, partner, squared, time)
    update_partners(scene, particles, neighbours, partner, squared)
    step = max(engine.floor, shortest_time_to_contact(scene, particles, partner, engine.ceiling))
    if merged:
        compact(particles)
    steps.merged[0] = merged
    return step


@inlined_allocating
def resolve_simultaneously(scene, particles, ledger, neighbours, partner, squared, time):
    """Resolve contacts of nearest neighbours, then merge those that bonded; whether any did."""
    bonded_i = [0 for _ in range(0)]
    bonded_j = [0 for _ in range(0)]
    for i in range(particles.size[0]):
        j = partner[i]
        if j < 0 or (partner[j] == i and j < i):
            continue
        one, other = particles.records[i], particles.records[j]
        if not is_contact(one, other, squared[i]):
            continue
        current = squared_distance(scene.escape, one, other, scene.half_width)
        if not is_contact(one, other, current):
            continue
        reach = one["radius"] + other["radius"]
        size = particles.size[0]
        kind = resolve_contact(scene, particles, ledger, i, j, time)
        if kind == BONDED:
            bonded_i.append(i)
            bonded_j.append(j)
        elif kind == BOUNCED:
            shift_apart(scene, one, other, math.sqrt(current), reach)
            mark_bounced(particles, neighbours, i, j, size)
    merge_clusters(scene, particles, ledger, neighbours, bonded_i, bonded_j, time)
    return len(bonded_i) > 0


@inlined_allocating
def merge_clusters(scene, particles, ledger, neighbours, bonded_i, bonded_j, time):
    """Merge every chain of bonded pairs into its lowest particle."""
    if len(bonded_i) == 0:
        return
    owner = np.arange(particles.size[0])
    for k in range(len(bonded_i)):
        i, j = bonded_i[k], bonded_j[k]
        while owner[i] != i:
            i = owner[i]
        while owner[j] != j:
            j = owner[j]
        if i != j:
            low, high = min(i, j), max(i, j)
            merge(scene, particles, ledger, low, high, time)
            owner[high] = low
            mark_merged(particles, neighbours, low, high)


@inlined
def update_partners(scene, particles, neighbours, partner, squared):
    """Update the nearest neighbour of every particle after the contacts of this step."""
    if neighbours.counts[CHANGED] == 0:
        return
    for i in range(particles.size[0]):
        if particles.records[i]["mass"] == 0.0:
            partner[i] = -1
        else:
            update_partner(scene, particles, neighbours, partner, squared, i)


@inlined
def shortest_time_to_contact(scene, particles, partner, ceiling):
    """Smallest gap over approach speed of nearest neighbours, at most `ceiling`, s  [B 6.14]."""
    smallest = ceiling
    for i in range(particles.size[0]):
        j = partner[i]
        if j < 0:
            continue
        one, other = particles.records[i], particles.records[j]
        line = separation_vector(scene.escape, one, other, scene.half_width)
        closing = dot(relative_velocity(one, other), line)
        if closing > 0.0:
            distance = math.sqrt(dot(line, line))
            gap = max(0.0, distance - one["radius"] - other["radius"])
            smallest = min(smallest, gap * distance / closing)
    return smallest
