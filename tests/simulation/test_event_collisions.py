"""The event engine against the reference without cells: the same pairs at the same times.

Rounding grows with each collision of a sphere, so lists are compared early, means later; and only
up to the first tie.
"""

import kinetic_theory as theory
import numpy as np
import pytest
from event_reference import SAME, run_reference, untied
from event_runs import bouncing, recorded, same_place, size_ratio
from plain_python import PLAIN, cases
from scenes import HALF, ball_mass, kinetic_energy, merging_event_periodic, momentum, placed, state

from agglom_mpi.simulation.collision import BONDED, BOUNCED


def thermal(masses, seed, speed=1.0):
    """Velocities at zero momentum, of `speed` along an axis for a mass that is the mean."""
    free = float(np.mean(masses)) * speed**2
    return theory.maxwellian(masses, free, np.random.default_rng(seed))


def gas(scene, seed):
    particles = placed(scene, seed)
    velocities = thermal(particles.mass, seed)
    return state(scene, particles.position.T, velocities)


def reference(scene, particles, e, friction=0.0, most=None, end_time=1e9):
    escape = "periodic" if type(scene.escape).__name__ == "Periodic" else "reentry"
    return run_reference(
        particles.position.T,
        particles.velocity.T,
        particles.radius,
        particles.mass,
        scene.half_width,
        end_time,
        lambda *pair: e,
        friction=friction,
        escape=escape,
        most=most,
    )


def assert_same_bounces(run, expected):
    """Compare up to the first tie; how many collisions that were."""
    known = untied(expected.collisions)
    assert len(run.times) == len(expected.collisions)
    assert np.all(run.kinds == BOUNCED)
    pairs, times = run.pairs[:known], run.times[:known]
    assert pairs.tolist() == [[c.i, c.j] for c in expected.collisions[:known]]
    np.testing.assert_allclose(times, [c.time for c in expected.collisions[:known]], rtol=SAME)
    return known


SLOW = pytest.mark.slow
BOTH = pytest.mark.parametrize("escape", cases(["periodic", "reentry"], ["periodic"]))
IMPACTS = pytest.mark.parametrize(
    ("e", "friction"), [pytest.param(1.0, 0.0, marks=SLOW), (0.8, 0.3)]
)


@IMPACTS
@pytest.mark.parametrize(
    ("number", "fraction", "per_sphere", "cells", "escape"),
    [
        (150, 0.03, 3, True, "periodic"),
        pytest.param(150, 0.03, 3, True, "reentry", marks=SLOW),
        pytest.param(150, 0.2, 8, True, "periodic", marks=SLOW),
        (20, 0.1, 4, False, "periodic"),
        pytest.param(20, 0.1, 4, False, "reentry", marks=PLAIN),
    ],
)
def test_the_same_pairs_collide_at_the_same_times(
    number, fraction, per_sphere, cells, e, friction, escape
):
    scene = bouncing(
        e, escape, friction, particles=number, size_ratio=size_ratio(fraction), end_time=1e9
    )
    most, compared, seed = number * per_sphere // 2, 0, 0
    while compared < most:
        particles = gas(scene, seed)
        expected = reference(scene, particles, e, friction, most)
        run = recorded(scene, particles, most)
        assert run.oversize == ((0, 0) if cells else (number, number))
        assert run.per_axis[0] >= 4 if cells else run.per_axis == (0, 0)
        assert run.time == run.times[-1]
        known = assert_same_bounces(run, expected)
        if known == most:
            assert same_place(particles.position.T - expected.position, 1e2 * SAME * HALF)
            speed = float(np.sqrt(np.mean(expected.velocity**2)))
            np.testing.assert_allclose(
                particles.velocity.T, expected.velocity, atol=1e3 * SAME * speed
            )
        compared += known
        seed += 1
    assert seed <= (1 if escape == "periodic" else 60)


@pytest.mark.parametrize("drift", [(0.5, -3.0, 0.1), (40.0, 0.0, 1.0)])
def test_a_drifting_cloud_collides_as_one_at_rest(drift):
    scene = bouncing(1.0, particles=100, size_ratio=size_ratio(0.1), end_time=1e9)
    particles = gas(scene, 1)
    expected = reference(scene, particles, 1.0, most=150)
    particles.velocity[:] += np.array(drift)[:, None]
    run = recorded(scene, particles, 150)
    assert assert_same_bounces(run, expected) == 150
    moved = particles.position.T - np.array(drift) * run.time
    assert same_place(moved - expected.position, 1e-8 * HALF)


def mixture(scene, seed, large):
    """Place grains whose radii spread threefold, and large spheres, by rejection."""
    generator = np.random.default_rng(seed)
    radii = scene.radius * generator.uniform(0.5, 1.5, scene.particles)
    radii[: len(large)] = large
    positions = np.empty((0, 3))
    while len(positions) < scene.particles:
        trial = generator.uniform(-HALF, HALF, 3)
        difference = positions - trial
        difference -= 2.0 * HALF * np.rint(difference / (2.0 * HALF))
        reach = radii[: len(positions)] + radii[len(positions)]
        if np.all(np.linalg.norm(difference, axis=1) >= reach):
            positions = np.vstack((positions, trial))
    order = generator.permutation(scene.particles)  # the large ones at slots of no distinction
    masses = np.array([ball_mass(radius) for radius in radii])
    velocities = thermal(masses, seed)
    return state(scene, positions[order], velocities[order], radii[order])


@pytest.mark.parametrize("escape", cases(["periodic", "reentry"], ["periodic"], SLOW))
@IMPACTS
@pytest.mark.parametrize("large", [pytest.param([0.4], marks=SLOW), [0.45, 0.3, 0.3]])
def test_oversize_spheres_among_grains_collide_as_without_cells(large, e, friction, escape):
    scene = bouncing(e, escape, friction, particles=130, size_ratio=0.25, end_time=1e9)
    compared, hits, seed = 0, 0, 0
    while compared < 100 or hits <= 15:
        particles = mixture(scene, seed, np.array(large) * HALF)
        expected = reference(scene, particles, e, friction, 80)
        run = recorded(scene, particles, 80)
        assert run.per_axis[0] >= 4
        assert run.oversize[0] == len(large)
        known = assert_same_bounces(run, expected)
        oversize = np.argsort(particles.radius)[-len(large) :]
        hits += int(np.isin(run.pairs[:known], oversize).sum())
        compared, seed = compared + known, seed + 1
    assert seed <= 40


def paired(found, expected):
    """For every place of `expected`, the row of `found` that is nearest to it."""
    difference = found[:, None] - expected[None]
    difference -= 2.0 * HALF * np.rint(difference / (2.0 * HALF))
    return np.argmin(np.linalg.norm(difference, axis=2), axis=0)


def assert_same_survivors(particles, expected, rtol):
    n, alive = int(particles.size[0]), expected.alive
    assert n == alive.sum()
    order = paired(particles.position.T[:n], expected.position[alive])
    assert len(set(order)) == n
    np.testing.assert_allclose(particles.mass[order], expected.mass[alive], rtol=1e-13)
    np.testing.assert_allclose(particles.radius[order], expected.radius[alive], rtol=1e-13)
    assert same_place(particles.position.T[order] - expected.position[alive], rtol * HALF)
    scale = float(np.abs(expected.velocity[alive]).max())
    np.testing.assert_allclose(
        particles.velocity.T[order], expected.velocity[alive], atol=rtol * scale
    )


@BOTH
@pytest.mark.parametrize(
    ("number", "ratio", "merges", "large"),
    [
        pytest.param(100, 0.4, 60, [], marks=SLOW),
        (100, 0.3, 60, [0.4]),
        (28, 0.5, 20, []),
        pytest.param(200, 0.25, 80, [], marks=SLOW),
    ],
)
def test_who_bonds_does_so_when_and_where_it_does_without_cells(
    number, ratio, merges, large, escape
):
    scene = bouncing(0.0, escape, particles=number, size_ratio=ratio, end_time=1e9)
    particles = mixture(scene, 5, np.array(large) * HALF)
    expected = reference(scene, particles, 0.0, most=merges)
    start = momentum(particles)
    run = recorded(scene, particles, merges)
    assert np.all(run.kinds == BONDED)
    np.testing.assert_allclose(run.times, [c.time for c in expected.collisions], rtol=SAME)
    assert_same_survivors(particles, expected, SAME)
    np.testing.assert_allclose(momentum(particles), start, atol=1e-12 * np.sum(particles.mass))


@pytest.mark.slow
def test_beyond_chaos_the_means_agree():
    """Twenty inelastic gases each from states that differ by 1e-6 of the speed."""
    number, e, friction = 40, 0.9, 0.1
    counts, energies = [], []
    generator = np.random.default_rng(7)
    scene = bouncing(
        e, friction=friction, particles=number, size_ratio=size_ratio(0.15), end_time=0.06
    )
    for seed in range(20):
        particles = gas(scene, 100 + seed)
        start = kinetic_energy(particles)
        expected = reference(scene, particles, e, friction, end_time=scene.end_time)
        particles.velocity[:] *= 1.0 + 1e-6 * generator.normal(size=particles.velocity.shape)
        run = recorded(scene, particles)
        counts.append((len(run.times), len(expected.collisions)))
        left = 0.5 * float(expected.mass @ np.sum(expected.velocity**2, axis=1))
        energies.append((kinetic_energy(particles) / start, left / start))
    counts, energies = np.array(counts, float), np.array(energies)
    assert np.mean(counts[:, 1]) > 8 * number / 2
    for values in (counts, energies):
        difference = values[:, 0] - values[:, 1]
        # Chaos makes the two differ, so that the comparison is one of means.
        assert np.count_nonzero(difference) >= 15
        assert abs(difference.mean()) <= 4.0 * difference.std(ddof=1) / np.sqrt(20.0)


@pytest.mark.plain
def test_few_particles_have_cells_only_if_they_are_going_to_stay_as_many():
    options = {"particles": 100, "size_ratio": size_ratio(0.05), "end_time": 1e-6}
    for scene, cells in (
        (bouncing(0.9, **options), True),
        (bouncing(0.9, **options | {"particles": 60}), False),
        (merging_event_periodic(1e7, **options), False),
        (merging_event_periodic(1e7, **options | {"particles": 200}), True),
    ):
        run = recorded(scene, placed(scene, 1))
        assert (run.per_axis[0] > 0) == cells
