"""Speed of both steppers, and where a fixed step spends its time.

Run with `pytest tests/benchmarks/bench_steppers.py -m benchmark -s`, or as a program.
"""

import math
import statistics
import time

import numba
import numpy as np
import pytest

from agglom_mpi.physics.contact import ContactArea
from agglom_mpi.physics.restitution import ConstantRestitution, ImpactLaws
from agglom_mpi.physics.velocities import SpreadVelocities
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import AdaptiveSteps, FixedSteps
from agglom_mpi.simulation.particles import new_ledger, new_particles
from agglom_mpi.simulation.sample import place_grains, simulate_scene
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.simulation.time_driven.neighbours import (
    AGE,
    MIN_LIFETIME,
    find_partners,
    is_out_of_date,
    new_neighbour_list,
    rebuild_lists,
)
from agglom_mpi.simulation.time_driven.steppers import resolve_sequentially
from agglom_mpi.simulation.time_driven.stepping import move_particles

COUNTS = (100, 1000, 10_000)
SHARES = (0.005, 0.02)
"""Displacement of the fastest component in one step over the spacing of the particles."""

REPEATS = 5
SPEED = 4.0
LAWS = ImpactLaws(
    ConstantRestitution.Numbers(1.0),
    None,
    ContactArea.Numbers(0.0, 1.0),
    *[None] * 6,
    heat_capacity=math.inf,
)


def make_scene(count, engine, end_time):
    radius = 0.633 * 0.01 / count ** (1.0 / 3.0)
    return Scene(
        escape=Periodic.Numbers(),
        velocities=SpreadVelocities.Numbers((0.0, 0.0, 0.0), 1.0, SPEED),
        laws=LAWS,
        cooling=None,
        engine=engine,
        particles=count,
        half_width=0.01,
        radius=radius,
        mass=1e-6,
        temperature=0.0,
        end_time=end_time,
    )


def step_of(count, share):
    return share * 0.02 / count ** (1.0 / 3.0) / SPEED


def stepping(law, count, share):
    """Return a scene of about two million particle-steps."""
    steps = max(50, 2_000_000 // count)
    end_time = steps * step_of(count, share)
    step = step_of(count, share)
    engine = FixedSteps.Numbers(steps) if law == "fixed" else AdaptiveSteps.Numbers(step, step)
    return make_scene(count, engine, end_time)


def seconds_of(call):
    begin = time.perf_counter()
    result = call()
    return time.perf_counter() - begin, result


def rate(scene):
    """Median particle-steps per second over the repeats, placement and measures set aside."""
    simulate_scene(scene._replace(end_time=1e-15), np.random.default_rng(1))
    rates = []
    for _ in range(REPEATS):
        setup, _ = seconds_of(lambda: prepare(scene, np.random.default_rng(1)))
        total, (record, _) = seconds_of(lambda: simulate_scene(scene, np.random.default_rng(1)))
        rates.append(int(record["particle_steps"]) / (total - setup))
    return statistics.median(rates), record


def prepare(scene, random):
    particles = new_particles(scene, scene.particles)
    place_grains(scene, random, particles, np.zeros(1, np.uint8))
    return particles, new_ledger(), new_neighbour_list(scene.particles)


@numba.njit(error_model="numpy")
def repeat(what, times, scene, particles, ledger, neighbours, partner, squared):
    wanted = 2.0 * scene.radius
    stale = 0
    for _ in range(times):
        if what == 0:
            find_partners(scene, particles, neighbours, partner, squared, scene.radius)
        elif what == 1:
            neighbours.counts[AGE] = MIN_LIFETIME
            rebuild_lists(scene, particles, neighbours, 0.0, wanted)
        elif what == 2:
            move_particles(scene, particles, 0.0)
        elif what == 3:
            resolve_sequentially(scene, particles, ledger, neighbours, partner, squared, 0.0)
        elif what == 4:
            particles.position[0, 0] += 1e-30
            stale += is_out_of_date(scene, particles, neighbours, 0.0)
    return stale


STAGES = ("find_partners", "rebuild_lists", "move_particles", "contacts", "is_out_of_date")


def stage_times(count):
    """Median ns per particle of each stage, on a fresh placement."""
    scene = make_scene(count, FixedSteps.Numbers(1), 1.0)
    particles, ledger, neighbours = prepare(scene, np.random.default_rng(1))
    arguments = (scene, particles, ledger, neighbours, np.empty(count, np.int64), np.empty(count))
    repeat(1, 1, *arguments)
    repeat(0, 1, *arguments)
    found = {}
    for what, name in enumerate(STAGES):
        times = max(1, (200_000 if what == 1 else 2_000_000) // count)
        runs = [seconds_of(lambda: repeat(what, times, *arguments))[0] for _ in range(REPEATS)]  # noqa: B023
        found[name] = statistics.median(runs) / times / count * 1e9
    return found


@pytest.mark.benchmark
def test_print_the_speed_of_both_steppers():
    print("\nengine    N      step/spacing  Mparticle-steps/s  collisions/particle-step")
    for law in ("fixed", "adaptive"):
        for count in COUNTS:
            for share in SHARES:
                speed, record = rate(stepping(law, count, share))
                often = int(record["collisions"]) / int(record["particle_steps"])
                print(f"{law:9} {count:<6} {share:<13} {speed / 1e6:<18.1f} {often:.5f}")


@pytest.mark.benchmark
def test_print_the_stages_of_a_fixed_step():
    print("\nN      " + "".join(f"{name:>16}" for name in STAGES) + "   ns per particle and call")
    for count in COUNTS:
        times = stage_times(count)
        print(f"{count:<6} " + "".join(f"{times[name]:16.1f}" for name in STAGES))


if __name__ == "__main__":
    test_print_the_speed_of_both_steppers()
    test_print_the_stages_of_a_fixed_step()
