"""The stepper of [B]: steps of the smallest gap over approach speed, merges after all pairs."""

import math
from typing import Final

import numpy as np

from agglom_mpi.compilation import allocating, stage
from agglom_mpi.simulation.box import separation
from agglom_mpi.simulation.contact import (
    BONDED,
    BOUNCED,
    collide,
    merge,
)
from agglom_mpi.simulation.engines import advance, go_on
from agglom_mpi.simulation.neighbours import (
    MOVED,
    find_partners,
    mend_partner,
    note_moved,
    squared_distance,
    update_neighbours,
)
from agglom_mpi.simulation.particles import EXHAUSTED, STEPS, compact
from agglom_mpi.simulation.scene import AdaptiveSteps
from agglom_mpi.simulation.step_frames import record_step
from agglom_mpi.simulation.stepping import (
    aborted,
    cool,
    count_step,
    is_contact,
    move,
    note_new,
    shift_apart,
)
from agglom_mpi.simulation.steps import (
    LENGTH,
    end_of_step,
    finish_step,
    is_over,
    new_steps,
    note_step,
)

MOST_STEPS: Final = 10_000_000
"""Steps after which a sample fails: its floor is too small for its end time."""


@advance.answer(AdaptiveSteps)
def _adaptive_steps(engine, scene, particles, ledger, abort, recorder):  # type: ignore[no-untyped-def]
    steps = new_steps(particles)
    time = 0.0
    while time < scene.end_time and not aborted(abort):
        if ledger.tally[STEPS] >= MOST_STEPS:
            ledger.tally[EXHAUSTED] = 1
            break
        step = take_contacts(engine, scene, particles, ledger, steps, time)
        step = min(step, scene.end_time - time)
        record_step(recorder, scene, particles, time, step, time + step)
        move(scene, particles, step)
        cool(scene.cooling, scene, particles, ledger, step)
        time = scene.end_time if time + step >= scene.end_time else time + step
    return time


@go_on.answer(AdaptiveSteps)
def _more_steps(engine, scene, particles, ledger, kept, until, abort):  # type: ignore[no-untyped-def]
    while is_over(kept, end_of_step(kept), kept.clock[LENGTH], until) and not aborted(abort):
        if ledger.tally[STEPS] >= MOST_STEPS:
            ledger.tally[EXHAUSTED] = 1
            return end_of_step(kept)
        finish_step(scene, particles, ledger, kept)
        time = end_of_step(kept)
        step = take_contacts(engine, scene, particles, ledger, kept, time)
        note_step(kept, time, step)
    return until


@stage
def take_contacts(engine, scene, particles, ledger, steps, time):  # type: ignore[no-untyped-def]
    """Resolve the contacts at the beginning of a step, at `time` in s; how long it is, in s."""
    partner, squared, neighbours = steps.partner, steps.squared, steps.neighbours
    count_step(particles, ledger)
    update_neighbours(scene, particles, neighbours, time, steps.merged[0], np.inf)
    find_partners(scene, particles, neighbours, partner, squared, np.inf)
    merged = resolve_together(scene, particles, ledger, neighbours, partner, squared, time)
    mend_partners(scene, particles, neighbours, partner, squared)
    step = max(engine.floor, smallest_flight(scene, particles, partner, engine.ceiling))
    if merged:
        compact(particles)
    steps.merged[0] = merged
    return step


@allocating
def resolve_together(scene, particles, ledger, neighbours, partner, squared, time):  # type: ignore[no-untyped-def]
    """Let nearest neighbours in contact collide, then merge all that bonded; whether any did."""
    bonded_i = [0 for _ in range(0)]
    bonded_j = [0 for _ in range(0)]
    for i in range(particles.size[0]):
        j = partner[i]
        if (
            j < 0
            or (partner[j] == i and j < i)
            or not is_contact(particles.radius, i, j, squared[i])
        ):
            continue
        current = squared_distance(scene.escape, particles.position, i, j, scene.half_width)
        if not is_contact(particles.radius, i, j, current):
            continue
        reach = particles.radius[i] + particles.radius[j]
        size = particles.size[0]
        kind = collide(scene, particles, ledger, i, j, time)
        if kind == BONDED:
            bonded_i.append(i)
            bonded_j.append(j)
        elif kind == BOUNCED:
            note_new(particles, neighbours, size)
            shift_apart(scene, particles, i, j, math.sqrt(current), reach)
    merge_clusters(scene, particles, ledger, neighbours, bonded_i, bonded_j, time)
    return len(bonded_i) > 0


@allocating
def merge_clusters(scene, particles, ledger, neighbours, bonded_i, bonded_j, time):  # type: ignore[no-untyped-def]
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
            note_moved(neighbours, low)


@stage
def mend_partners(scene, particles, neighbours, partner, squared):  # type: ignore[no-untyped-def]
    """Bring everybody's nearest neighbour up to date after the contacts of this step."""
    if neighbours.tally[MOVED] == 0:
        return
    for i in range(particles.size[0]):
        if particles.mass[i] == 0.0:
            partner[i] = -1
        else:
            mend_partner(scene, particles, neighbours, partner, squared, i)


@stage
def smallest_flight(scene, particles, partner, ceiling):  # type: ignore[no-untyped-def]
    """Smallest gap over approach speed of nearest neighbours, at most `ceiling`, s  [B 6.14]."""
    smallest = ceiling
    escape, half, radius = scene.escape, scene.half_width, particles.radius
    x, y, z = particles.position[0], particles.position[1], particles.position[2]
    u, v, w = particles.velocity[0], particles.velocity[1], particles.velocity[2]
    for i in range(particles.size[0]):
        j = partner[i]
        if j < 0:
            continue
        dx = separation(escape, x[j] - x[i], half)
        dy = separation(escape, y[j] - y[i], half)
        dz = separation(escape, z[j] - z[i], half)
        closing = (u[i] - u[j]) * dx + (v[i] - v[j]) * dy + (w[i] - w[j]) * dz
        if closing > 0.0:
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            gap = max(0.0, distance - radius[i] - radius[j])
            smallest = min(smallest, gap * distance / closing)
    return smallest
