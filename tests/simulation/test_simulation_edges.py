"""Two or three particles in situations that a random sample rarely reaches."""

import numpy as np
import pytest
from plain_python import PLAIN, cases
from scenes import (
    HALF,
    adaptive_reentry,
    ball_mass,
    event_periodic,
    event_reentry,
    fixed_periodic,
    grains_in,
    merging_adaptive_periodic,
    merging_event_periodic,
    merging_event_reentry,
    merging_fixed_reentry,
    momentum,
    run_from,
    state,
    temperatures_in,
)

from agglom_mpi.simulation.particles import COLLISIONS, EXHAUSTED, MERGES, STEPS

pytestmark = pytest.mark.plain

TWO = {"particles": 2, "size_ratio": 0.2}
STEP = 1e-5


def periodic(restitution, steps, **options):
    return fixed_periodic(restitution, steps, end_time=steps * STEP, **(TWO | options))


def reentry(restitution, steps, **options):
    floor = ceiling = STEP
    return adaptive_reentry(restitution, floor, ceiling, end_time=steps * STEP, **(TWO | options))


def exact_periodic(restitution, steps, **options):
    return event_periodic(restitution, end_time=steps * STEP, **(TWO | options))


def exact_reentry(restitution, steps, **options):
    return event_reentry(restitution, end_time=steps * STEP, **(TWO | options))


QUICK = [periodic, reentry, exact_periodic]
EXACT = [exact_periodic, exact_reentry]
EVERY_ONE = pytest.mark.parametrize("make", cases([periodic, reentry, *EXACT], QUICK))
EXACT_ONES = pytest.mark.parametrize("make", cases(EXACT, QUICK))


@EVERY_ONE
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
    assert make in EXACT or ledger.counts[STEPS] >= 100
    assert (ledger.counts[COLLISIONS], ledger.counts[MERGES], particles.size[0]) == (1, 1, 1)
    assert particles.radius[0] == pytest.approx((radii[0] ** 3 + radii[1] ** 3) ** (1.0 / 3.0))
    assert particles.mass[0] == pytest.approx(ball_mass(particles.radius[0]), rel=1e-14)
    np.testing.assert_allclose(particles.velocity[:, 0], before / mass.sum(), rtol=1e-13)
    arrived = centre + before / mass.sum() * scene.end_time
    np.testing.assert_allclose(particles.position[:, 0], arrived, atol=1e-12 * HALF)


@EVERY_ONE
def test_a_crowd_may_merge_into_a_single_particle(make):
    scene = make(0.0, 200, particles=6)
    b = scene.radius
    places = [[2.5 * b * (k - 2.5), 0, 0] for k in range(6)]
    particles = state(scene, places, [[-20.0 * (k - 2.5), 0, 0] for k in range(6)])
    ledger, _ = run_from(scene, particles)
    assert (ledger.counts[MERGES], particles.size[0], *grains_in(scene, particles)) == (5, 1, 6)
    assert particles.radius[0] == pytest.approx(6.0 ** (1.0 / 3.0) * b, rel=1e-13)
    np.testing.assert_allclose(particles.velocity[:, 0], 0.0, atol=1e-13)
    np.testing.assert_allclose(particles.position[:, 0], 0.0, atol=1e-13)


@EVERY_ONE
@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("distance", [1.0, 2.0, 3.0])
def test_without_relative_velocity_nothing_happens(make, restitution, distance):
    scene = make(restitution, 50)
    b = scene.radius
    particles = state(scene, [[0, 0, 0], [distance * b, 0, 0]], [[3.0, 0, 1.0]] * 2)
    ledger, time = run_from(scene, particles)
    assert ledger.counts[COLLISIONS] == 0
    assert time == scene.end_time
    away = particles.position[:, 1] - particles.position[:, 0]
    np.testing.assert_allclose(away, [distance * b, 0, 0], atol=1e-14)
    np.testing.assert_allclose(particles.position[:, 0], [3.0 * time, 0, time], rtol=1e-12, atol=0)


@EVERY_ONE
def test_overlapping_and_receding_is_no_contact(make):
    scene = make(0.0, 20)
    particles = state(scene, [[0, 0, 0], [scene.radius, 0, 0]], [[0, 0, 0], [1.0, 0, 0]])
    assert run_from(scene, particles)[0].counts[COLLISIONS] == 0


@EVERY_ONE
def test_touching_exactly_is_contact(make):
    scene = make(1.0, 1)
    b = 0.25 * HALF  # so that the distance of the centres is exactly twice the radius
    particles = state(scene, [[0, 0, 0], [0.5 * HALF, 0, 0]], [[1.0, 0, 0], [0, 0, 0]], [b, b])
    assert run_from(scene, particles)[0].counts[COLLISIONS] == 1
    np.testing.assert_allclose(particles.velocity, [[0, 1.0], [0, 0], [0, 0]], atol=1e-15)


@pytest.mark.parametrize(
    ("make", "met"),
    [
        (periodic, 1),
        (reentry, 0),
        (exact_periodic, 1),
        pytest.param(exact_reentry, 0, marks=PLAIN),
    ],
)
def test_contacts_across_a_face_are_seen_by_the_periodic_box_only(make, met):
    scene = make(1.0, 1)
    b = scene.radius
    places = [[HALF - 0.5 * b, 0, 0], [-HALF + 0.5 * b, 0, 0]]
    particles = state(scene, places, [[1.0, 0, 0], [0, 0, 0]])
    assert run_from(scene, particles)[0].counts[COLLISIONS] == met


@pytest.mark.parametrize("make", [periodic, exact_periodic])
def test_a_merge_across_a_face_lies_between_the_two(make):
    scene = make(0.0, 1)
    b = scene.radius
    places = [[HALF - 0.2 * b, 0, 0], [-HALF + 0.8 * b, 0, 0]]
    particles = state(scene, places, [[1e-9, 0, 0], [0, 0, 0]])
    run_from(scene, particles)
    assert particles.size[0] == 1
    np.testing.assert_allclose(particles.position[:, 0], [-HALF + 0.3 * b, 0, 0], atol=1e-12)


@pytest.mark.parametrize("corner", [(1, 0, 0), (1, 1, 0), (1, -1, 1)])
@EVERY_ONE
def test_centres_on_the_faces_edges_and_corners_are_in_the_box(make, corner):
    scene = make(0.5, 30)
    place = np.array(corner) * HALF
    particles = state(scene, [place, [0.1 * HALF, 0, 0]], [np.array(corner) * 5.0, [0, 0, 0]])
    run_from(scene, particles)
    assert np.all(np.abs(particles.position) <= HALF)
    travel = 5.0 * np.array(corner)
    flown = place + travel * scene.end_time
    # The side lost on the way: the periodic box wraps, re-entry starts again on the opposite face.
    expected = np.where(np.abs(flown) > HALF, flown - np.sign(flown) * 2.0 * HALF, flown)
    if make in (periodic, exact_periodic):
        np.testing.assert_allclose(particles.position[:, 0], expected, atol=1e-12 * HALF)
    else:
        # A stepper sees at the end of its first step that the particle has left at once.
        seen = 0.0 if make is exact_reentry else STEP
        on_face = -place + travel * (scene.end_time - seen)
        np.testing.assert_allclose(particles.position[:, 0], on_face, atol=1e-12 * HALF)


@pytest.mark.parametrize(
    "scene",
    [
        periodic(0.5, 5),
        periodic(0.0, 5),
        reentry(0.5, 5),
        pytest.param(merging_fixed_reentry(4e10, 5, end_time=5 * STEP, **TWO), marks=PLAIN),
        pytest.param(
            merging_adaptive_periodic(2e4, STEP, STEP, end_time=5 * STEP, **TWO), marks=PLAIN
        ),
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
    assert ledger.counts[COLLISIONS] in ([0] if speed == 0.0 else [1, 2])
    assert np.all(np.isfinite(particles.position[:, :n]))
    assert np.all(np.isfinite(temperatures_in(scene, particles)))
    np.testing.assert_allclose(momentum(particles), before, rtol=1e-12)


@pytest.mark.parametrize(
    "scene",
    [
        exact_periodic(0.5, 5),
        *(
            pytest.param(scene, marks=PLAIN)
            for scene in (
                exact_reentry(0.0, 5),
                merging_event_periodic(2e4, end_time=5 * STEP, **TWO),
                merging_event_reentry(4e10, end_time=5 * STEP, **TWO),
            )
        ),
    ],
)
def test_coinciding_centres_are_receding_where_time_is_exact(scene):
    """The distance of two coinciding centres is at its minimum: it does not shrink any more."""
    particles = state(scene, [[0, 0, 0], [0, 0, 0]], [[7.0, 0, 0], [0, 0, 0]])
    ledger, time = run_from(scene, particles)
    assert (ledger.counts[COLLISIONS], particles.size[0]) == (0, 2)
    expected = [[7.0 * time, 0], [0, 0], [0, 0]]
    np.testing.assert_allclose(particles.position, expected, atol=1e-14 * HALF)


@EVERY_ONE
def test_head_on_elastic_spheres_exchange_their_velocities(make):
    scene = make(1.0, 200)
    b = scene.radius
    particles = state(scene, [[-2 * b, 0, 0], [2 * b, 0, 0]], [[4.0, 0, 0], [-1.0, 0, 0]])
    ledger, _ = run_from(scene, particles)
    assert ledger.counts[COLLISIONS] == 1
    np.testing.assert_allclose(particles.velocity[0], [-1.0, 4.0], rtol=1e-14)
    if make in EXACT:
        met = (4.0 * b - 2.0 * b) / 5.0
        arrived = np.array([-2.0 * b, 2.0 * b]) + np.array([4.0, -1.0]) * met
        arrived += np.array([-1.0, 4.0]) * (scene.end_time - met)
        np.testing.assert_allclose(particles.position[0], arrived, atol=1e-14 * HALF)


@EXACT_ONES
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_where_time_is_exact_spheres_touch_and_never_overlap(make, restitution):
    scene = make(restitution, 200)
    b = scene.radius
    offset = 1.2 * b  # the line of centres at contact is 0.6 across and 0.8 along
    particles = state(scene, [[-3.0 * b, 0, 0], [b, offset, 0]], [[4.0, 0, 0], [0, 0, 0]])
    contact = (4.0 * b - 1.6 * b) / 4.0
    end = contact * (1.0 + 1e-9)
    ledger, _ = run_from(scene._replace(end_time=end), particles)
    assert ledger.counts[COLLISIONS] == 1
    if restitution == 0.0:
        assert particles.size[0] == 1
        return
    normal = np.array([0.8, 0.6, 0.0])
    struck = 0.5 * (1.0 + restitution) * 4.0 * 0.8 * normal
    np.testing.assert_allclose(particles.velocity[:, 1], struck, atol=4e-14)
    distance = np.linalg.norm(particles.position[:, 1] - particles.position[:, 0])
    assert 2.0 * b * (1.0 - 1e-14) <= distance <= 2.0 * b * (1.0 + 2e-9)


@EXACT_ONES
def test_a_sample_beyond_its_budget_of_events_says_so(make):
    scene = make(1.0, 10**9, budget=50)
    particles = state(scene, [[0, 0, 0], [HALF, 0, 0]], [[3.0, 0.1, 0], [-2.0, 0, 0.1]])
    ledger, time = run_from(scene, particles)
    assert (ledger.counts[EXHAUSTED], ledger.counts[STEPS]) == (1, 2 * 50)
    assert 0.0 < time < scene.end_time
    assert np.all(np.abs(particles.position) <= HALF)
