"""The event-driven reference against closed forms, invariants and a reference without events."""

import itertools
import math
from functools import partial

import kinetic_theory as theory
import numpy as np
import pytest
from displaced_starts import expected_collisions
from event_reference import Collision, run_reference

from agglom_mpi.physics.kinetic_theory import volume_fraction

D = 1.0
PLACES = 1e-13
"""Of a time or a position of order one after a few events, 1e3 roundings."""


def elastic(w, mass_i, mass_j, radius_i, radius_j):
    return 1.0


def bonding(w, mass_i, mass_j, radius_i, radius_j):
    return 0.0


def restitution(e):
    return lambda *pair: e


def run(positions, velocities, end_time, impact=elastic, radius=0.1, masses=None, **options):
    count = len(positions)
    radii = np.broadcast_to(radius, (count,))
    masses = np.ones(count) if masses is None else masses
    return run_reference(positions, velocities, radii, masses, D, end_time, impact, **options)


def lattice(number, generator):
    """Centres of 27 or 64 cells in random order, cell sides 2D/3 or D/2, a tenth of it off."""
    cells = 3 if number <= 27 else 4
    centres = (np.arange(cells) + 0.5) * 2.0 * D / cells - D
    places = np.array(list(itertools.product(centres, repeat=3)))
    chosen = places[generator.permutation(len(places))[:number]]
    return chosen + generator.uniform(-0.1, 0.1, (number, 3)) * D / cells


def gas(number, seed, masses=None):
    generator = np.random.default_rng(seed)
    masses = np.ones(number) if masses is None else masses
    return lattice(number, generator), theory.maxwellian(masses, 1.0, generator)


def energy(mass, velocity):
    return 0.5 * float(mass @ np.sum(velocity**2, axis=1))


def momentum(mass, velocity):
    return mass @ velocity


# two spheres


@pytest.mark.parametrize("e", [1.0, 0.6])
def test_two_meet_head_on_after_their_gap_is_flown(e):
    mass = np.array([1.0, 3.0])
    result = run(
        [[-0.5, 0, 0], [0.4, 0, 0]], [[2.0, 0, 0], [-1.0, 0, 0]], 0.3, restitution(e), masses=mass
    )
    ((time, *rest),) = result.collisions
    assert rest == [0, 1, "bounce"]
    assert time == pytest.approx(0.7 / 3.0, abs=PLACES)
    frame = (2.0 - 3.0) / 4.0
    after = frame - e * 3.0 * np.array([0.75, -0.25])
    np.testing.assert_allclose(result.velocity[:, 0], after, atol=PLACES)
    expected = np.array([-0.5, 0.4]) + np.array([2.0, -1.0]) * time + after * (0.3 - time)
    np.testing.assert_allclose(result.position[:, 0], expected, atol=PLACES)
    assert result.time == 0.3


def test_periodic_spheres_meet_across_a_face():
    result = run([[-0.8, 0.3, 0], [0.8, 0.3, 0]], [[-1.0, 0, 0], [1.0, 0, 0]], 0.5)
    assert [tuple(c)[1:] for c in result.collisions] == [(0, 1, "bounce")]
    assert result.collisions[0].time == pytest.approx(0.1, abs=PLACES)
    np.testing.assert_allclose(result.velocity[:, 0], [1.0, -1.0], atol=PLACES)
    np.testing.assert_allclose(result.position[:, 0], [-0.5, 0.5], atol=PLACES)


def test_two_alone_meet_in_the_middle_and_across_the_faces_in_turn():
    start, velocity = [[-0.5, 0, 0], [0.5, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]]
    result = run(start, velocity, 1.4, radius=0.35)
    assert [tuple(c)[1:] for c in result.collisions] == [(0, 1, "bounce")] * 5
    times = 0.15 + 0.3 * np.arange(5)  # 2D less two diameters lie between two collisions
    np.testing.assert_allclose([c.time for c in result.collisions], times, atol=PLACES)


def test_a_face_hides_a_contact_only_where_spheres_reenter():
    start, velocity = [[-0.95, -0.5, 0], [0.95, 0.5, 0]], [[0, 1.0, 0], [0, -1.0, 0]]
    seen = run(start, velocity, 0.6)
    assert [tuple(c)[1:] for c in seen.collisions] == [(0, 1, "bounce")]
    along = math.sqrt(0.2**2 - 0.1**2)
    assert seen.collisions[0].time == pytest.approx((1.0 - along) / 2.0, abs=PLACES)
    hidden = run(start, velocity, 0.6, escape="reentry")
    assert hidden.collisions == []


def test_who_reenters_is_on_the_opposite_face_exactly():
    start, velocity = [[0.75, 0.2, -0.1]], [[0.5, -0.3, 0.0]]
    crossed = 0.5
    result = run(start, velocity, crossed, escape="reentry")
    assert result.position[0, 0] == -D
    later = run(start, velocity, 1.5, escape="reentry")
    np.testing.assert_allclose(later.position[0], [-0.5, -0.25, -0.1], atol=PLACES)
    assert later.collisions == []


def test_who_reenters_onto_another_collides_there_only_if_they_approach():
    start = [[0.9, 0, 0], [-0.95, 0, 0]]
    meeting = run(start, [[1.0, 0, 0], [0, 0, 0]], 0.3, escape="reentry")
    assert [tuple(c)[1:] for c in meeting.collisions] == [(0, 1, "bounce")]
    assert meeting.collisions[0].time == pytest.approx(0.1, abs=PLACES)
    parting = run(start, [[1.0, 0, 0], [1.5, 0, 0]], 0.3, escape="reentry")
    assert parting.collisions == []


@pytest.mark.parametrize("offset", [0.0, 0.1, 0.19, 0.2 * (1.0 - 1e-8)])
def test_an_offset_pair_touches_where_the_line_meets_the_sphere(offset):
    result = run([[-0.6, 0, 0], [0, offset, 0]], [[1.0, 0, 0], [0, 0, 0]], 0.9)
    ((time, *_),) = result.collisions
    along = math.sqrt((0.2 - offset) * (0.2 + offset))
    # A rounding of the offset moves the grazing end of the chord by this much.
    blur = 4.0 * np.finfo(float).eps * 0.2**2 / along if along > 0.0 else 0.0
    assert time == pytest.approx(0.6 - along, abs=PLACES + blur)
    n = np.array([along, offset, 0.0]) / 0.2
    tolerance = PLACES + 10.0 * blur / 0.2
    np.testing.assert_allclose(result.velocity[1], n[0] * n, atol=tolerance)
    np.testing.assert_allclose(result.velocity[0], [1, 0, 0] - n[0] * n, atol=tolerance)


@pytest.mark.parametrize("offset", [0.2, 0.2 * (1.0 + 1e-12), 0.21])
def test_who_grazes_or_passes_goes_on(offset):
    result = run([[-0.6, 0, 0], [0, offset, 0]], [[1.0, 0, 0], [0, 0, 0]], 0.9)
    assert result.collisions == []
    np.testing.assert_array_equal(result.velocity, [[1, 0, 0], [0, 0, 0]])


def unfolded_contact(separation, velocity, reach, reaches_to):
    """Earliest contact among the images up to `reaches_to` boxes away, one by one."""
    earliest, boxes = math.inf, range(-reaches_to, reaches_to + 1)
    for shift in itertools.product(boxes, repeat=3):
        d = [s + 2.0 * D * k for s, k in zip(separation, shift, strict=True)]
        a = sum(u * u for u in velocity)
        b = sum(x * u for x, u in zip(d, velocity, strict=True))
        c = sum(x * x for x in d) - reach * reach
        if b < 0.0 and b * b - a * c > 0.0:
            earliest = min(earliest, (-b - math.sqrt(b * b - a * c)) / a)
    return earliest


@pytest.mark.parametrize("seed", range(12))
def test_a_pair_alone_meets_at_the_earliest_of_all_images(seed):
    generator = np.random.default_rng(seed)
    start, velocity = generator.uniform(-D, D, (2, 3)), generator.normal(size=(2, 3))
    radius = 0.06
    relative = velocity[1] - velocity[0]
    boxes = 7
    expected = unfolded_contact(start[1] - start[0], relative, 2.0 * radius, boxes)
    seen = (2.0 * boxes - 1.0) * D / np.abs(relative).max()  # images from further away come later
    result = run(start, velocity, seen, radius=radius, most=1)
    if expected > seen:
        assert result.collisions == []
    else:
        # b² − ac loses the square of the distance over the radius to rounding.
        assert result.collisions[0].time == pytest.approx(expected, abs=1e-10)


def test_pairs_meet_after_many_boxes_in_most_of_those_cases():
    hits = 0
    for seed in range(12):
        generator = np.random.default_rng(seed)
        start, velocity = generator.uniform(-D, D, (2, 3)), generator.normal(size=(2, 3))
        result = run(start, velocity, 200.0, radius=0.06, most=1)
        travelled = np.abs(velocity[1] - velocity[0]).max() * result.time
        hits += len(result.collisions) == 1 and travelled > 4.0 * D
    assert hits >= 6


def test_who_overlaps_collides_at_once_if_approaching_and_never_if_receding():
    start = [[-0.05, 0, 0], [0.05, 0, 0]]
    approaching = run(start, [[1.0, 0, 0], [-1.0, 0, 0]], 0.3)
    assert approaching.collisions == [Collision(0.0, 0, 1, "bounce")]
    np.testing.assert_allclose(approaching.velocity[:, 0], [-1.0, 1.0], atol=PLACES)
    receding = run(start, [[-1.0, 0, 0], [1.0, 0, 0]], 0.3)
    assert receding.collisions == []


def test_a_pair_that_hardly_separates_is_resolved_once():
    # After e = 1e-20 rounding decides the sign of the approach; sliding apart, they stay apart.
    for offset in np.linspace(0.01, 0.19, 50):
        start, velocity = [[-0.6, 0, 0], [0, offset, 0]], [[1.0, 0, 0], [0, 0, 0]]
        result = run(start, velocity, 0.9, restitution(1e-20), most=5)
        ((time, *_),) = result.collisions
        assert time == pytest.approx(0.6 - math.sqrt(0.2**2 - offset**2), abs=PLACES)


def test_friction_is_coulombs_up_to_the_impulse_that_stops_the_slip():
    start, velocity = [[-0.4, 0, 0], [0.4, 0, 0]], [[1.0, 0.15, 0], [-1.0, -0.15, 0]]
    mass = np.array([1.0, 2.0])
    # The normal at the contact, off the axis, from the smaller root of |d + ut| = 0.2.
    d, u = np.array([0.8, 0, 0]), np.array([-2.0, -0.3, 0])
    b, c = d @ u, d @ d - 0.2**2
    n = (d + u * (-b - math.sqrt(b * b - (u @ u) * c)) / (u @ u)) / 0.2
    w, reduced, e = -u @ n, 2.0 / 3.0, 0.5
    slip = -u - w * n
    before = energy(mass, np.array(velocity))
    for coefficient in (0.1, 100.0):
        result = run(start, velocity, 0.5, restitution(e), masses=mass, friction=coefficient)
        normal = reduced * (1.0 + e) * w
        rubbing = min(coefficient * normal, reduced * np.linalg.norm(slip))
        relative = result.velocity[0] - result.velocity[1]
        left = slip * (1.0 - rubbing / (reduced * np.linalg.norm(slip)))
        np.testing.assert_allclose(relative, left - e * w * n, atol=1e-12)
        np.testing.assert_allclose(
            momentum(mass, result.velocity), momentum(mass, np.array(velocity)), atol=1e-12
        )
        loss = 0.5 * reduced * w**2 * (1.0 - e**2)
        loss += rubbing * np.linalg.norm(slip) - rubbing**2 / (2.0 * reduced)
        assert before - energy(mass, result.velocity) == pytest.approx(loss, rel=1e-12)


# a few spheres


def test_newtons_cradle_hands_the_motion_on():
    start = [[-0.6, 0, 0], [-0.1, 0, 0], [0.1 + 1e-9, 0, 0]]
    result = run(start, [[1.0, 0, 0], [0, 0, 0], [0, 0, 0]], 0.8)
    assert [tuple(c)[1:] for c in result.collisions] == [(0, 1, "bounce"), (1, 2, "bounce")]
    assert [c.time for c in result.collisions] == pytest.approx([0.3, 0.3 + 1e-9], abs=PLACES)
    np.testing.assert_allclose(result.velocity[:, 0], [0, 0, 1.0], atol=PLACES)
    np.testing.assert_allclose(result.position[:, 0], [-0.3, -0.1 + 1e-9, 0.6], atol=PLACES)


def test_a_cradle_that_touches_hands_on_within_no_time():
    radius = 0.125  # sums and squares of these numbers do not round
    start = [[-0.5, 0, 0], [-0.125, 0, 0], [0.125, 0, 0]]
    result = run(start, [[1.0, 0, 0], [0, 0, 0], [0, 0, 0]], 0.5, radius=radius)
    assert result.collisions == [Collision(0.125, 0, 1, "bounce"), Collision(0.125, 1, 2, "bounce")]
    np.testing.assert_array_equal(result.velocity[:, 0], [0, 0, 1.0])


def test_at_the_same_time_the_lowest_pair_is_first():
    start = [[-0.5, 0.5, 0], [-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0]]
    velocity = [[1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]]
    result = run(start, velocity, 0.6, radius=0.125)
    assert result.collisions == [Collision(0.375, 0, 3, "bounce"), Collision(0.375, 1, 2, "bounce")]


def test_merged_spheres_keep_the_lower_slot_mass_volume_and_momentum():
    mass, radius = np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.12, 0.15])
    start = np.array([[-0.95, 0, 0], [0.9, 0.05, 0], [0.0, 0.0, 0.0]])
    velocity = np.array([[0.0, 0.1, 0], [1.0, 0, 0], [-2.0, 0, 0]])
    result = run(start, velocity, 1.0, bonding, radius=radius, masses=mass)
    assert [tuple(c)[1:] for c in result.collisions] == [(0, 1, "merge"), (0, 2, "merge")]
    assert result.collisions[0].time == 0.0  # across the face, overlapping and approaching
    np.testing.assert_array_equal(result.alive, [True, False, False])
    assert result.mass[0] == 7.0
    assert result.radius[0] == pytest.approx(np.cbrt(np.sum(radius**3)), rel=1e-14)
    np.testing.assert_allclose(7.0 * result.velocity[0], momentum(mass, velocity), atol=PLACES)
    # Sphere 1 meets 0 beyond +D, and 2 reaches the two from there: their centre of mass flies on.
    unfolded = start + np.array([[2.0 * D, 0, 0], [0, 0, 0], [2.0 * D, 0, 0]])
    arrived = (mass @ unfolded + momentum(mass, velocity)) / 7.0
    difference = result.position[0] - arrived
    np.testing.assert_allclose(
        difference - 2.0 * D * np.round(difference / (2.0 * D)), 0.0, atol=PLACES
    )


def test_spheres_too_large_for_one_nearest_image_are_refused():
    with pytest.raises(ValueError, match="too large"):
        run([[-0.5, 0, 0], [0.5, 0, 0]], np.zeros((2, 3)), 1.0, radius=0.51)


# a gas


@pytest.mark.parametrize("escape", ["periodic", "reentry"])
def test_an_elastic_gas_keeps_momentum_and_energy(escape):
    mass = np.random.default_rng(5).uniform(0.5, 2.0, 30)
    start, velocity = gas(30, 6, mass)
    result = run(start, velocity, 1e9, radius=0.15, masses=mass, most=400, escape=escape)
    assert len(result.collisions) == 400
    rounding = 400 * 10 * np.finfo(float).eps
    before, after = energy(mass, velocity), energy(mass, result.velocity)
    assert after == pytest.approx(before, rel=rounding)
    scale = math.sqrt(2.0 * mass.sum() * before)
    np.testing.assert_allclose(momentum(mass, result.velocity), 0.0, atol=rounding * scale)
    assert np.all(np.diff([c.time for c in result.collisions]) >= 0.0)


def test_spheres_of_a_gas_never_overlap():
    start, velocity = gas(30, 7)
    for most in range(1, 200, 66):
        r = run(start, velocity, 1e9, radius=0.2, most=most).position
        d = r[:, None] - r[None, :]
        distance = np.linalg.norm(d - 2.0 * D * np.round(d / (2.0 * D)), axis=2)
        assert np.min(distance[np.triu_indices(30, 1)]) > 0.4 * (1.0 - PLACES)


def test_a_gas_that_bonds_ends_up_slower_with_all_its_mass_and_momentum():
    mass = np.ones(40)
    start, velocity = gas(40, 8)
    velocity = velocity + np.array([0.3, -0.2, 0.1])

    def sometimes(w, *pair):
        return 0.0 if w < 0.5 else 0.8

    result = run(start, velocity, 15.0, sometimes, radius=0.08, friction=0.2)
    merges = [c for c in result.collisions if c.kind == "merge"]
    alive = result.alive
    assert len(merges) == 40 - alive.sum()
    assert 0 < len(merges) < len(result.collisions)
    assert all(c.i < c.j for c in result.collisions)
    assert not np.any(alive[[c.j for c in merges]])
    assert result.mass[alive].sum() == 40.0
    assert np.sum(result.radius[alive] ** 3) == pytest.approx(40 * 0.08**3, rel=1e-13)
    np.testing.assert_allclose(
        momentum(result.mass[alive], result.velocity[alive]), momentum(mass, velocity), atol=1e-12
    )
    assert energy(result.mass[alive], result.velocity[alive]) < energy(mass, velocity)


def test_time_reversed_a_gas_finds_its_way_back():
    number, radius = 30, 0.15
    start, velocity = gas(number, 9)
    collided = run(start, velocity, 1e9, radius=radius, most=number)  # two per sphere
    end = collided.time + 1e-3
    there = run(start, velocity, end, radius=radius)
    back = run(there.position, -there.velocity, end, radius=radius)
    # A rounding grows tenfold or so per collision of a sphere, and each has two there, two back.
    assert [c[1:3] for c in back.collisions] == [c[1:3] for c in there.collisions[::-1]]
    mirrored = [end - c.time for c in there.collisions[::-1]]
    np.testing.assert_allclose([c.time for c in back.collisions], mirrored, atol=1e-11)
    np.testing.assert_allclose(back.position, start, atol=1e-11)
    np.testing.assert_allclose(back.velocity, -velocity, atol=1e-11)


def stepped(position, velocity, radius, step, most):
    """Collisions of equal masses found by looking who overlaps after each step."""
    r, v, found, steps = position.copy(), velocity.copy(), [], 0
    pairs = list(itertools.combinations(range(len(r)), 2))
    low, high = np.array(pairs).T
    while len(found) < most:
        steps += 1
        r = r + step * v
        d = r[high] - r[low]
        d -= 2.0 * D * np.round(d / (2.0 * D))
        touching = np.sum(d**2, axis=1) <= (2.0 * radius) ** 2
        for k in np.flatnonzero(touching):
            i, j = pairs[k]
            n = d[k] / np.linalg.norm(d[k])
            w = (v[i] - v[j]) @ n
            if w > 0.0:
                v[i], v[j] = v[i] - w * n, v[j] + w * n
                found.append((steps * step, i, j))
    return found


@pytest.mark.slow(
    guard="simulation/test_event_reference.py::test_time_reversed_a_gas_finds_its_way_back"
)
def test_small_steps_find_the_same_collisions_late_by_as_much_as_displaced_spheres():
    radius, most, compared = 0.3, 6, {}
    seeds = range(6)

    def exact(start, velocity):
        found = run(start, velocity, 1e9, radius=radius, most=most).collisions
        return [tuple(collision[:3]) for collision in found]

    for seed, step in itertools.product(seeds, (1e-3, 1e-4)):
        start, velocity = gas(6, seed)
        reach = 2.0 * step * np.abs(velocity).max()
        expected = expected_collisions(partial(exact, velocity=velocity), start, reach)
        found = stepped(start, velocity, radius, step, most)[: len(expected.collisions)]
        assert [c[1:] for c in found] == [c[1:] for c in expected.collisions]
        late = np.array([f[0] - e[0] for f, e in zip(found, expected.collisions, strict=True)])
        assert np.all((late[:1] >= 0.0) & (late[:1] <= step))
        assert np.all(np.abs(late) <= step + expected.changes)
        compared[seed, step] = len(found)
    fine = [compared[seed, 1e-4] for seed in seeds]
    assert np.mean(fine) >= 0.5 * most


@pytest.mark.slow(guard="simulation/test_kinetic_theory.py")
def test_an_elastic_gas_collides_at_enskogs_rate():
    number, radius = 60, 0.135
    start, velocity = gas(number, 12)
    fraction = volume_fraction(number / (2.0 * D) ** 3, 2.0 * radius)
    assert 0.07 < fraction < 0.08
    times = [c.time for c in run(start, velocity, 1e9, radius=radius, most=1200).collisions]
    lead = 300
    measured = 2.0 * (len(times) - lead) / (times[-1] - times[lead - 1]) / number
    expected = theory.finite_rate(number, (2.0 * D) ** 3, 2.0 * radius, 1.0, 1.0)
    # Counts of collisions scatter about as Poisson's.
    assert measured == pytest.approx(expected, rel=4.0 / math.sqrt(len(times) - lead))


@pytest.mark.slow(guard="simulation/test_kinetic_theory.py")
def test_an_inelastic_gas_cools_by_haffs_law():
    number, radius, e = 60, 0.135, 0.9
    start, velocity = gas(number, 13)
    mixed = run(start, velocity, 1e9, radius=radius, most=200)
    velocity = mixed.velocity - mixed.velocity.mean(axis=0)
    result = run(mixed.position, velocity, 2.0, restitution(e), radius=radius)
    rate = theory.finite_rate(number, (2.0 * D) ** 3, 2.0 * radius, 1.0, 1.0)
    corrected = rate * theory.haff_correction(e)
    expected = theory.haff_temperature(2.0, 1.0, e, corrected)
    measured = theory.free_temperature(result.velocity, 1.0)
    # T falls by the factor exp(−(1 − e²)/3) per collision of a sphere.
    per_sphere = theory.haff_collisions(2.0, e, corrected)
    scatter = math.sqrt(2.0 * per_sphere / number)
    assert abs(math.log(measured / expected)) < 4.0 * scatter * (1.0 - e**2) / 3.0
    assert 2.0 * len(result.collisions) / number == pytest.approx(per_sphere, abs=4.0 * scatter)
