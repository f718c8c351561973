"""How long memory alone takes for a collision: what is read, without computing anything.

Run with `pytest tests/benchmarks/bench_memory.py -m benchmark -s` (two minutes). After a collision
of each particle of an elastic gas, random particles stand for those of the next collisions. For
each of them and its next partner all is read that a collision and its predictions read: both in
all arrays, the cells around and who is in them; and for another particle what a crossing reads.
Those of the next collision do not depend on this one, so that the processor overlaps their reading
as an engine cannot.
"""

import statistics
import time

import numpy as np
import pytest
from bench_event import engine_of_scene, make_gas, print_row, start

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.event_driven.flights import RANGE
from agglom_mpi.simulation.event_driven.prediction import neighbours_of
from agglom_mpi.simulation.particles import COLLISIONS, STEPS, new_ledger, position_of, velocity_of
from agglom_mpi.simulation.scene import new_engine_state

REPEATS, READ, PACKING = 5, 200_000, 0.2
WIDTHS = (12, 24, 24, 24)


@inlined
def read_around(scene, events, i, face):
    """Read the trajectories of those in the cells around particle i; a sum of what was read."""
    trajectory, next_event = events.flights.trajectory[i], events.flights.next_event[i]
    x, y, z = trajectory["x"], trajectory["y"], trajectory["z"]
    count = neighbours_of(scene, events.cells, trajectory, next_event, x, y, z, face)
    total = 0.0
    for k in range(count):
        total += events.flights.trajectory[events.cells.candidates[k]]["x"]
    return total


@inlined
def read_particle(particles, i):
    """Read position and velocity of particle i; their sum."""
    position, velocity = position_of(particles.records[i]), velocity_of(particles.records[i])
    return position[0] + position[1] + position[2] + velocity[0] + velocity[1] + velocity[2]


@kernel
def read_collisions(scene, particles, events, order, total):
    """Read what collisions of the particles `order` with their partners read."""
    for k in range(order.size - 1):
        i = order[k]
        j = max(np.int64(0), np.int64(events.flights.next_event[i]["partner"]))
        total[0] += read_particle(particles, i) + read_particle(particles, j)
        total[0] += read_around(scene, events, i, RANGE) + read_around(scene, events, j, RANGE)
        total[0] += read_around(scene, events, order[k + 1], 0)


def measured(count):
    """Return µs of a collision, those of its reading, and events per collision."""
    scene = make_gas(PACKING, count, 1.0, 1)
    particles = start(scene, np.random.default_rng(1))
    whole = []
    for _ in range(2):  # the first time compiles, or uses memory that is new
        copy = type(particles)(*(None if a is None else a.copy() for a in particles))
        ledger, events = new_ledger(), new_engine_state(scene.engine, scene, count)
        begin = time.process_time()
        engine_of_scene(scene, copy, ledger, events, np.zeros(1, np.uint8))
        whole.append((time.process_time() - begin) / ledger.counts[COLLISIONS])
    order = np.random.default_rng(2).integers(count, size=READ)
    read = []
    for _ in range(REPEATS + 1):
        begin = time.process_time()
        read_collisions(scene, copy, events, order, np.zeros(1))
        read.append((time.process_time() - begin) / READ)
    per_collision = ledger.counts[STEPS] / ledger.counts[COLLISIONS]
    return 1e6 * whole[-1], 1e6 * statistics.median(read[1:]), per_collision


@pytest.mark.benchmark
def test_print_what_memory_takes_of_a_collision():
    print(f"\nelastic gas, phi = {PACKING}; processor time per collision, the first look included")
    print_row(WIDTHS, ("particles", "a collision, us", "reading alone, us", "events per collision"))
    for count in (1000, 10_000, 100_000, 1_000_000):
        collision, read, events = measured(count)
        print_row(WIDTHS, (count, f"{collision:.2f}", f"{read:.2f}", f"{events:.2f}"))
