"""Trajectory by trajectory against an independent plain-Python simulator."""

import numpy as np
import pytest
from plain_python import PLAIN_ALONE, cases
from reference import Reference
from scenes import (
    adaptive_reentry,
    fixed_periodic,
    merging_adaptive_periodic,
    merging_fixed_reentry,
    placed,
    run_from,
    temperatures_in,
)

from agglom_mpi.simulation.particles import COLLISIONS, MERGES, STEPS

pytestmark = PLAIN_ALONE

DENSE = {"particles": 24, "size_ratio": 0.7}
CROWD = {"particles": 300, "size_ratio": 0.6}
SCENES = {
    "fixed, elastic": fixed_periodic(1.0, 60, end_time=1e-3, **DENSE),
    "fixed, inelastic": fixed_periodic(0.4, 60, end_time=1e-3, **DENSE),
    "fixed, all merge": fixed_periodic(0.0, 60, end_time=1e-3, **DENSE),
    "fixed, crowd": fixed_periodic(0.0, 25, end_time=2e-4, **CROWD),
    "fixed, lasting lists": fixed_periodic(0.8, 40, end_time=2e-4, **CROWD),
    "fixed, few with lists": fixed_periodic(0.9, 80, end_time=4e-4, particles=60, size_ratio=0.7),
    "fixed, re-entry, mixed": merging_fixed_reentry(4e10, 60, end_time=1e-3, **DENSE),
    "adaptive, elastic": adaptive_reentry(1.0, 1e-5, 4e-5, end_time=8e-4, **DENSE),
    "adaptive, inelastic": adaptive_reentry(0.4, 1e-5, 4e-5, end_time=8e-4, **DENSE),
    "adaptive, all merge": adaptive_reentry(0.0, 1e-5, 4e-5, end_time=8e-4, **DENSE),
    "adaptive, crowd": adaptive_reentry(0.0, 5e-6, 4e-5, end_time=1e-4, **CROWD),
    "adaptive, periodic, mixed": merging_adaptive_periodic(2e4, 1e-5, 4e-5, end_time=8e-4, **DENSE),
}


MIXED = ["fixed, re-entry, mixed", "adaptive, periodic, mixed"]
CROWDED = [name for name, scene in SCENES.items() if scene.particles > 100]


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "name",
    [
        *cases([name for name in SCENES if name not in CROWDED], set(SCENES) - set(MIXED)),
        *cases(CROWDED, [], pytest.mark.slow),
    ],
)
def test_every_trajectory_is_that_of_the_plain_reference(name, seed):
    scene = SCENES[name]
    particles = placed(scene, seed)
    reference = Reference(scene, particles).run()
    ledger, time = run_from(scene, particles)
    balls = reference.balls
    assert time == scene.end_time
    assert ledger.counts[STEPS] == reference.steps >= 20
    assert ledger.counts[COLLISIONS] == reference.collisions > 5
    assert ledger.counts[MERGES] == reference.merges
    count = int(particles.size[0])
    assert count == len(balls) == scene.particles - reference.merges
    half = scene.half_width
    difference = particles.position[:, :count] - np.array([ball.r for ball in balls]).T
    assert np.max(np.abs(difference)) <= 1e-9 * half
    velocities = np.array([ball.v for ball in balls]).T
    assert np.max(np.abs(particles.velocity[:, :count] - velocities)) <= 1e-8
    np.testing.assert_allclose(particles.radius[:count], [ball.b for ball in balls], rtol=1e-12)
    temperatures = temperatures_in(scene, particles)
    np.testing.assert_allclose(temperatures, [ball.T for ball in balls], rtol=1e-9)


@pytest.mark.parametrize("name", MIXED)
def test_the_mixed_scenes_bounce_and_merge(name):
    runs = [Reference(SCENES[name], placed(SCENES[name], seed)).run() for seed in range(4)]
    merges = sum(reference.merges for reference in runs)
    assert merges >= 3
    assert sum(reference.collisions for reference in runs) - merges >= 3
