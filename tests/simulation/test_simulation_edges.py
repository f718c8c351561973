"""Two or three particles in situations that a random sample rarely reaches."""

import numpy as np
import pytest
from scenes import (
    HALF,
    adaptive_reentry,
    ball_mass,
    fixed_periodic,
    merging_adaptive_periodic,
    merging_fixed_reentry,
    momentum,
    run_from,
    state,
)

from agglom_mpi.simulation.particles import COLLISIONS, MERGES, STEPS

TWO = {"particles": 2, "size_ratio": 0.2}
STEP = 1e-5


def periodic(restitution, steps, **options):
    return fixed_periodic(restitution, steps, end_time=steps * STEP, **(TWO | options))


def reentry(restitution, steps, **options):
    floor = ceiling = STEP
    return adaptive_reentry(restitution, floor, ceiling, end_time=steps * STEP, **(TWO | options))


@pytest.mark.parametrize("make", [periodic, reentry])
def test_two_that_merge_go_on_as_one(make):
    scene = make(0.0, 100)
    b = scene.radius
    radii = [b, 1.5 * b]
    start, speeds = [[-3.0 * b, 0, 0], [0.5 * b, 0.1 * b, 0]], [[10.0, 0, 0], [1.0, 2.0, 0]]
    particles = state(scene, start, speeds, radii)
    mass = particles.mass.copy()
    before = momentum(particles)
    centre = (np.array(start).T @ mass) / mass.sum()
    ledger, time = run_from(scene, particles)
    assert time == scene.end_time
    assert ledger.tally[STEPS] >= 100
    assert (ledger.tally[COLLISIONS], ledger.tally[MERGES], particles.size[0]) == (1, 1, 1)
    assert particles.radius[0] == pytest.approx((radii[0] ** 3 + radii[1] ** 3) ** (1.0 / 3.0))
    assert particles.mass[0] == pytest.approx(ball_mass(particles.radius[0]), rel=1e-14)
    assert particles.grains[0] == 2
    np.testing.assert_allclose(particles.velocity[:, 0], before / mass.sum(), rtol=1e-13)
    arrived = centre + before / mass.sum() * scene.end_time
    np.testing.assert_allclose(particles.position[:, 0], arrived, atol=1e-12 * HALF)


@pytest.mark.parametrize("make", [periodic, reentry])
def test_a_crowd_may_merge_into_a_single_particle(make):
    scene = make(0.0, 200, particles=6)
    b = scene.radius
    places = [[2.5 * b * (k - 2.5), 0, 0] for k in range(6)]
    particles = state(scene, places, [[-20.0 * (k - 2.5), 0, 0] for k in range(6)])
    ledger, _ = run_from(scene, particles)
    assert (ledger.tally[MERGES], particles.size[0], particles.grains[0]) == (5, 1, 6)
    assert particles.radius[0] == pytest.approx(6.0 ** (1.0 / 3.0) * b, rel=1e-13)
    np.testing.assert_allclose(particles.velocity[:, 0], 0.0, atol=1e-13)
    np.testing.assert_allclose(particles.position[:, 0], 0.0, atol=1e-13)


@pytest.mark.parametrize("make", [periodic, reentry])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("distance", [1.0, 2.0, 3.0])
def test_without_relative_velocity_nothing_happens(make, restitution, distance):
    scene = make(restitution, 50)
    b = scene.radius
    particles = state(scene, [[0, 0, 0], [distance * b, 0, 0]], [[3.0, 0, 1.0]] * 2)
    ledger, time = run_from(scene, particles)
    assert ledger.tally[COLLISIONS] == 0
    assert time == scene.end_time
    away = particles.position[:, 1] - particles.position[:, 0]
    np.testing.assert_allclose(away, [distance * b, 0, 0], atol=1e-14)
    np.testing.assert_allclose(particles.position[:, 0], [3.0 * time, 0, time], rtol=1e-12, atol=0)


@pytest.mark.parametrize("make", [periodic, reentry])
def test_overlapping_and_receding_is_no_contact(make):
    scene = make(0.0, 20)
    particles = state(scene, [[0, 0, 0], [scene.radius, 0, 0]], [[0, 0, 0], [1.0, 0, 0]])
    assert run_from(scene, particles)[0].tally[COLLISIONS] == 0


@pytest.mark.parametrize("make", [periodic, reentry])
def test_touching_exactly_is_contact(make):
    scene = make(1.0, 1)
    b = 0.25 * HALF  # so that the distance of the centres is exactly twice the radius
    particles = state(scene, [[0, 0, 0], [0.5 * HALF, 0, 0]], [[1.0, 0, 0], [0, 0, 0]], [b, b])
    assert run_from(scene, particles)[0].tally[COLLISIONS] == 1
    np.testing.assert_allclose(particles.velocity, [[0, 1.0], [0, 0], [0, 0]], atol=1e-15)


def test_contacts_across_a_face_are_seen_by_the_periodic_box_only():
    for scene, met in ((periodic(1.0, 1), 1), (reentry(1.0, 1), 0)):
        b = scene.radius
        places = [[HALF - 0.5 * b, 0, 0], [-HALF + 0.5 * b, 0, 0]]
        particles = state(scene, places, [[1.0, 0, 0], [0, 0, 0]])
        assert run_from(scene, particles)[0].tally[COLLISIONS] == met


def test_a_merge_across_a_face_lies_between_the_two():
    scene = periodic(0.0, 1)
    b = scene.radius
    places = [[HALF - 0.2 * b, 0, 0], [-HALF + 0.8 * b, 0, 0]]
    particles = state(scene, places, [[1e-9, 0, 0], [0, 0, 0]])
    run_from(scene, particles)
    assert particles.size[0] == 1
    np.testing.assert_allclose(particles.position[:, 0], [-HALF + 0.3 * b, 0, 0], atol=1e-12)


@pytest.mark.parametrize("corner", [(1, 0, 0), (1, 1, 0), (1, -1, 1)])
@pytest.mark.parametrize("make", [periodic, reentry])
def test_centres_on_the_faces_edges_and_corners_are_in_the_box(make, corner):
    scene = make(0.5, 30)
    place = np.array(corner) * HALF
    particles = state(scene, [place, [0.1 * HALF, 0, 0]], [np.array(corner) * 5.0, [0, 0, 0]])
    run_from(scene, particles)
    assert np.all(np.abs(particles.position) <= HALF)
    flown = place + 5.0 * np.array(corner) * scene.end_time
    # The side lost on the way: the periodic box wraps, re-entry starts again on the opposite face.
    expected = np.where(np.abs(flown) > HALF, flown - np.sign(flown) * 2.0 * HALF, flown)
    if make is periodic:
        np.testing.assert_allclose(particles.position[:, 0], expected, atol=1e-12 * HALF)
    else:
        on_face = -place + 5.0 * np.array(corner) * (scene.end_time - STEP)
        np.testing.assert_allclose(particles.position[:, 0], on_face, atol=1e-12 * HALF)


@pytest.mark.parametrize(
    "scene",
    [
        periodic(0.5, 5),
        periodic(0.0, 5),
        reentry(0.5, 5),
        merging_fixed_reentry(4e10, 5, end_time=5 * STEP, **TWO),
        merging_adaptive_periodic(2e4, STEP, STEP, end_time=5 * STEP, **TWO),
    ],
)
@pytest.mark.parametrize("speed", [0.0, 7.0])
def test_coinciding_centres_stay_finite_and_keep_momentum(scene, speed):
    particles = state(scene, [[0, 0, 0], [0, 0, 0]], [[speed, 0, 0], [0, 0, 0]])
    before = momentum(particles)
    ledger, time = run_from(scene, particles)
    n = int(particles.size[0])
    assert time == scene.end_time
    # The line of centres is the relative velocity's, so each of the two may see an approach.
    assert ledger.tally[COLLISIONS] in ([0] if speed == 0.0 else [1, 2])
    assert np.all(np.isfinite(particles.position[:, :n]))
    assert np.all(np.isfinite(particles.temperature[:n]))
    np.testing.assert_allclose(momentum(particles), before, rtol=1e-12)


def test_head_on_elastic_spheres_exchange_their_velocities():
    scene = periodic(1.0, 200)
    b = scene.radius
    particles = state(scene, [[-2 * b, 0, 0], [2 * b, 0, 0]], [[4.0, 0, 0], [-1.0, 0, 0]])
    ledger, _ = run_from(scene, particles)
    assert ledger.tally[COLLISIONS] == 1
    np.testing.assert_allclose(particles.velocity[0], [-1.0, 4.0], rtol=1e-14)
