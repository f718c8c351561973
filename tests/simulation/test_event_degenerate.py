"""The event engine where a random gas rarely gets: ties, touching, extremes of speed and size."""

import itertools
import math

import numpy as np
import pytest
from displaced_starts import expected_collisions
from event_reference import SAME, run_reference, untied
from event_runs import ESCAPES, bouncing, recorded, same_place, size_ratio
from plain_python import cases
from scenes import HALF, ball_mass, grains_in, kinetic_energy, momentum, placed, state

from agglom_mpi.outcome import COMPLETED, FAILED, FailureReason
from agglom_mpi.physics.restitution import ConstantRestitution, LastingContact
from agglom_mpi.simulation.particles import COLLISIONS, EXHAUSTED, MERGES, STEPS
from agglom_mpi.simulation.sample import simulate_scene

B = HALF / 8.0
ROUNDING = 2.0**-52
BOTH = pytest.mark.parametrize("escape", cases(ESCAPES, ["periodic"]))
CELLS = pytest.mark.parametrize("cells", [False, True], ids=["all pairs", "cells"])


def scene_of(e, count, escape="periodic", end_time=1.0, **options):
    return bouncing(e, escape, particles=count, size_ratio=0.1, end_time=end_time, **options)


def run(e, positions, velocities, radii=B, escape="periodic", end_time=1.0, cells=False, **options):
    """Run spheres at `positions` in D; with `cells`, spectators at rest on two faces make cells."""
    positions, velocities = np.array(positions) * HALF, np.array(velocities, dtype=float)
    radii = np.broadcast_to(radii, (len(positions),)).copy()
    if cells:
        grid = (np.arange(10) - 4.5) * HALF / 5.0
        places = [(x, y, z) for x in grid for y in grid for z in (-0.96875 * HALF, 0.96875 * HALF)]
        positions = np.vstack((positions, places))
        velocities = np.vstack((velocities, np.zeros((len(places), 3))))
        radii = np.append(radii, np.full(len(places), 0.22 * B))
    scene = scene_of(e, len(positions), escape, end_time, **options)
    particles = state(scene, positions, velocities, radii)
    out = recorded(scene, particles)
    assert (out.per_axis[0] > 0) == cells
    assert np.all(np.isfinite(particles.position[:, : particles.size[0]]))
    assert np.all(np.isfinite(particles.velocity[:, : particles.size[0]]))
    return out, particles


# a pair


@BOTH
@CELLS
@pytest.mark.parametrize("hair", [0.0, 1e-15, 1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("side", [-1.0, 1.0], ids=["hit", "miss"])
def test_who_grazes_touches_or_goes_on(side, hair, cells, escape):
    """A hair of 1e-15 is within rounding: either may happen, with all that is conserved kept."""
    offset = 2.0 * B / HALF * (1.0 + side * hair)
    start = [[-0.5, -0.5 * offset, 0.01], [0.5, 0.5 * offset, 0.01]]
    speed = 4.0
    velocity = [[speed, 0, 0], [-speed, 0, 0]]
    out, particles = run(1.0, start, velocity, escape=escape, cells=cells, end_time=2.25e-3)
    if hair >= 1e-12:
        assert len(out.times) == (1 if side < 0.0 else 0)
    assert len(out.times) <= 1
    if len(out.times):
        along = 2.0 * B * math.sqrt(max(0.0, 1.0 - (offset * HALF / (2.0 * B)) ** 2))
        meeting = (HALF - along) / (2.0 * speed)
        # The chord's end moves by this much when the offset rounds.
        blur = math.sqrt(8.0 * ROUNDING) * 2.0 * B / speed
        assert out.times[0] == pytest.approx(meeting, abs=blur, rel=1e-14)
    np.testing.assert_allclose(np.sum(particles.velocity[:, :2], axis=1), 0.0, atol=1e-13)
    assert np.sum(particles.velocity[:, :2] ** 2) == pytest.approx(2.0 * speed**2, rel=1e-13)


@BOTH
@CELLS
@pytest.mark.parametrize("distance", [2.0, 1.5, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_who_touches_or_overlaps_collides_at_once_if_approaching_only(e, distance, cells, escape):
    start = [[-0.25, 0.0, 0.0], [-0.25 + distance * B / HALF, 0.0, 0.0]]
    for speed, met in ((1.0, 1), (-1.0, 0), (0.0, 0)):
        velocity = [[speed, 0, 0], [-speed, 0, 0]]
        out, particles = run(e, start, velocity, escape=escape, cells=cells, end_time=1e-3)
        assert len(out.times) == met
        if met:
            assert 0.0 <= out.times[0] <= ROUNDING * B / speed
            assert out.ledger.counts[MERGES] == (e == 0.0)
        if e > 0.0 and met:
            np.testing.assert_array_equal(particles.velocity[0, :2], [-e, e])


@BOTH
@CELLS
def test_a_merge_that_makes_an_overlap_makes_a_collision_if_they_approach(cells, escape):
    distance = 2.1 * B / HALF  # 2 b from the grains before, 2.26 b from what they become
    for slow, merges in ((-1e-3, 2), (1e-3, 1)):
        start = [[-0.25, 0, 0], [0.25, 0, 0], [0, distance, 0]]
        velocity = [[1.0, 0, 0], [-1.0, 0, 0], [0, slow, 0]]
        out, particles = run(0.0, start, velocity, escape=escape, cells=cells, end_time=5e-3)
        meeting = 0.25 * HALF - B
        assert out.times == pytest.approx([meeting] * merges, rel=1e-14)
        assert particles.mass.max() == pytest.approx((1 + merges) * ball_mass(B), rel=1e-14)


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (3.0, -200.0, 1e-3)])
@pytest.mark.parametrize("e", [0.0, 0.7])
@pytest.mark.parametrize("count", [1, 2, 30, 100, 5000])
def test_without_relative_velocity_a_periodic_box_ends_at_once(count, e, velocity):
    scene = scene_of(e, count)
    positions = np.random.default_rng(2).uniform(-HALF, HALF, (count, 3))  # overlapping or not
    positions[0] = positions[-1]
    particles = state(scene, positions, np.broadcast_to(velocity, (count, 3)))
    out = recorded(scene, particles)
    assert (out.time, out.ledger.counts[COLLISIONS]) == (scene.end_time, 0)
    # The mean of equal velocities rounds; a few cells may be left with what remains.
    assert out.ledger.counts[STEPS] <= (0 if velocity[0] == 0.0 else 3)


@BOTH
@pytest.mark.parametrize("count", [2, 6, 40, 125])
def test_a_crowd_may_merge_into_a_single_particle(count, escape):
    generator = np.random.default_rng(3)
    side = math.ceil(count ** (1.0 / 3.0))
    places = list(itertools.product((np.arange(side) - 0.5 * (side - 1)) / side, repeat=3))[:count]
    positions = np.array(places) * 1.5 * HALF
    scene = scene_of(0.0, count, escape)._replace(end_time=0.02)
    particles = state(scene, positions, -100.0 * positions + 1e-9 * generator.normal())
    start = momentum(particles)
    centre = np.mean(positions, axis=0)
    out = recorded(scene, particles)
    assert (out.ledger.counts[MERGES], particles.size[0]) == (count - 1, 1)
    assert grains_in(scene, particles) == count
    np.testing.assert_allclose(momentum(particles), start, atol=1e-12 * count * scene.mass)
    arrived = centre + start / particles.mass[0] * scene.end_time
    assert same_place(particles.position[:, 0] - arrived, 1e-9 * HALF)


@pytest.mark.parametrize("radius", [0.1, 0.25, 0.35, 0.49])
@pytest.mark.parametrize("e", [1.0, 0.995])
def test_two_alone_meet_a_thousand_times_in_the_middle_and_across_the_faces(radius, e):
    gap, speed, most = 2.0 - 4.0 * radius, 1.0, 1000
    start = [[-0.5, 0.1, 0.2], [0.5, 0.1, 0.2]]
    scene = scene_of(e, 2, end_time=1e9)
    velocity = [[speed, 0, 0], [-speed, 0, 0]]
    particles = state(scene, np.array(start) * HALF, velocity, np.full(2, radius * HALF))
    out = recorded(scene, particles, most)
    first = (1.0 - 2.0 * radius) * HALF / (2.0 * speed)
    flights = gap * HALF / (2.0 * speed) * e ** -np.arange(1.0, most)
    times = first + np.concatenate(([0.0], np.cumsum(flights)))
    np.testing.assert_allclose(out.times, times, rtol=1e-12)
    assert particles.velocity[0] == pytest.approx([e**most, -(e**most)], rel=1e-12)


def test_a_million_boxes_may_lie_between_two_collisions():
    """A sphere flies along x and sinks towards another; at which crossing they meet is known."""
    b, speed, boxes = 0.05, 1.0, 1e6
    sinking = speed * 1e-7  # in the time of a box, 2e-7 D
    height = 2.0 * b + sinking / speed * 2.0 * (boxes - 0.25)
    scene = scene_of(1.0, 2, end_time=1e9, budget=10**8)
    velocity = [[speed, -sinking, 0], [0, 0, 0]]
    start = np.array([[0.5, 0.0, 0.0], [0.5, -height, 0.0]]) * HALF
    particles = state(scene, start, velocity, np.full(2, b * HALF))
    out = recorded(scene, particles, 1)
    # After `boxes` boxes it is 0.25 boxes' sinking below the top: the chord begins before that.
    depth = 0.25 * sinking / speed * 2.0
    chord = math.sqrt(4.0 * b * depth)
    travelled = out.times[0] * speed / HALF
    # A rounding of the way travelled moves the sphere, and it touches that much earlier or later.
    assert travelled == pytest.approx(2.0 * boxes - chord, abs=0.05 * chord)
    assert out.ledger.counts[STEPS] < 20 * boxes


@pytest.mark.parametrize("count", [24, 80])
@BOTH
def test_the_very_fast_and_the_very_slow_collide_as_without_cells(count, escape):
    scene = scene_of(1.0, count, escape, end_time=1e9)._replace(radius=B)
    scene = scene._replace(radius=0.5 * HALF / count ** (1.0 / 3.0), mass=1.0)
    speeds = np.where(np.arange(count) % 2, 1e6, 1e-6)[:, None]
    compared, seed = 0, 0
    while compared < count:
        generator = np.random.default_rng([count, seed])
        positions = placed(scene, seed).position.T
        velocities = generator.normal(size=(count, 3)) * speeds
        velocities[1] -= velocities[1::2].sum(axis=0)
        particles = state(scene, positions, velocities)
        expected = run_reference(
            positions, velocities, particles.radius, particles.mass, HALF, 1e9,
            lambda *pair: 1.0, escape=escape, most=count,
        )  # fmt: skip
        out, known = recorded(scene, particles, count), untied(expected.collisions)
        assert out.pairs[:known].tolist() == [[c.i, c.j] for c in expected.collisions[:known]]
        times = [c.time for c in expected.collisions[:known]]
        np.testing.assert_allclose(out.times[:known], times, rtol=SAME)
        compared, seed = compared + known, seed + 1


# at the same time


def lattice(side):
    """Places of side³ spheres that meet their neighbours along x in turn."""
    axis = (np.arange(side) + 0.5) * 2.0 / side - 1.0
    return np.array(list(itertools.product(axis, repeat=3)))


@pytest.mark.parametrize("side", [2, 4, 8, pytest.param(16, marks=pytest.mark.slow)])
def test_a_lattice_collides_row_by_row_at_exactly_the_same_times(side):
    places = lattice(side)
    scene = scene_of(1.0, side**3)._replace(radius=0.25 * HALF / side)
    even = np.round((places[:, 0] + 1.0) * side / 2.0 - 0.5) % 2 == 0
    velocities = np.zeros_like(places)
    velocities[:, 0] = np.where(even, 1.0, -1.0)
    gap = 2.0 * HALF / side - 2.0 * scene.radius
    rounds = 10
    scene = scene._replace(end_time=rounds * gap)
    states = []
    for _ in range(2):
        particles = state(scene, places * HALF, velocities)
        out = recorded(scene, particles)
        states.append((particles.position.tobytes(), particles.velocity.tobytes(), out.pairs))
        np.testing.assert_allclose(momentum(particles), 0.0, atol=1e-12 * np.sum(particles.mass))
        assert kinetic_energy(particles) == pytest.approx(0.5 * np.sum(particles.mass), rel=1e-12)
        assert len(out.times) == rounds * side**3 // 2
        of_round = out.times.reshape(rounds, -1)
        expected = 0.5 * gap + np.arange(rounds) * gap
        np.testing.assert_allclose(of_round, np.broadcast_to(expected[:, None], of_round.shape),
                                   rtol=1e-12)  # fmt: skip
        # Every particle is hit once in each round.
        for pairs in out.pairs.reshape(rounds, -1):
            assert len(set(pairs.tolist())) == side**3
    assert states[0][:2] == states[1][:2]
    np.testing.assert_array_equal(states[0][2], states[1][2])


@BOTH
@CELLS
def test_one_hit_from_both_sides_at_once_stays_and_the_two_return(cells, escape):
    start = [[-0.5, 0, 0], [0.0, 0, 0], [0.5, 0, 0]]
    velocity = [[1.0, 0, 0], [0, 0, 0], [-1.0, 0, 0]]
    out, particles = run(1.0, start, velocity, escape=escape, cells=cells, end_time=3e-3)
    assert len(out.times) == 3
    assert len(np.unique(out.times)) == 1
    np.testing.assert_allclose(particles.velocity[0, :3], [-1.0, 0.0, 1.0], atol=1e-14)


@pytest.mark.parametrize("count", [8, 64, 512])
@pytest.mark.parametrize("e", [0.5, 1.0])
def test_all_that_reach_one_place_at_once_end_in_finite_time(count, e):
    """Mirror images of each other; who comes first breaks the symmetry, but nothing else."""
    side = round(count ** (1.0 / 3.0))
    positions = lattice(side) * 0.9 * HALF
    scene = scene_of(e, count, end_time=0.02)._replace(radius=0.2 * HALF / side)
    particles = state(scene, positions, -100.0 * positions)
    start = kinetic_energy(particles)
    out = recorded(scene, particles)
    assert out.time == scene.end_time
    assert out.ledger.counts[EXHAUSTED] == 0
    assert len(out.times) >= 4
    np.testing.assert_allclose(momentum(particles), 0.0, atol=1e-10 * np.sum(particles.mass))
    left = kinetic_energy(particles) + out.ledger.energy[3]
    assert left == pytest.approx(start, rel=1e-10)


@BOTH
@CELLS
@pytest.mark.parametrize("gap", [0.0, 2.0**-20, 0.1])
def test_newtons_cradle_hands_the_motion_on(gap, cells, escape):
    count = 4
    places = [[-0.875, 0, 0]] + [[-0.5 + k * (0.25 + gap), 0, 0] for k in range(count)]
    velocity = [[1.0, 0, 0]] + [[0, 0, 0]] * count
    end_time = (0.125 + count * gap + 0.01) * HALF
    out, particles = run(1.0, places, velocity, escape=escape, cells=cells, end_time=end_time)
    np.testing.assert_array_equal(out.pairs, [(k, k + 1) for k in range(count)])
    times = (0.125 + gap * np.arange(count)) * HALF
    np.testing.assert_allclose(out.times, times, rtol=1e-12)
    np.testing.assert_allclose(particles.velocity[0, : count + 1], [0] * count + [1], atol=1e-13)


def test_a_heap_that_approaches_by_rounding_alone_does_not_collide_for_ever():
    """An impact slower than the last digit of the velocities changes nothing: it would come again.

    Found where an aggregate of a thousand grains had broken into pieces that overlap.
    """
    generator = np.random.default_rng(0)
    heap = np.array([[-0.05, 0.0, 0.0], [0.0, 0.05, 0.01], [0.05, 0.0, -0.02]])
    others = np.array([[0.5, 0.5, 0.5], [-0.5, 0.5, 0.5], [0.5, -0.5, 0.5]])
    for _ in range(100):
        start = np.vstack((heap + generator.uniform(-0.03, 0.03, (3, 3)), others))
        together = np.tile(generator.uniform(-1.0, 1.0, 3), (3, 1))
        together += generator.integers(-2, 3, (3, 3)) * np.spacing(np.abs(together))
        out, _ = run(1.0, start, np.vstack((together, -together)), end_time=1e-6, budget=100)
        assert out.ledger.counts[EXHAUSTED] == 0


# large ones


def approaching_overlaps(particles):
    """Pairs that overlap by nearest image and approach, both beyond rounding and grazing."""
    n = int(particles.size[0])
    low, high = np.triu_indices(n, 1)
    r, v = particles.position.T, particles.velocity.T
    d = r[high] - r[low]
    d -= 2.0 * HALF * np.rint(d / (2.0 * HALF))
    distance = np.linalg.norm(d, axis=1)
    reach = particles.radius[low] + particles.radius[high]
    closing = np.sum(d * (v[high] - v[low]), axis=1) / np.maximum(distance, 1e-300)
    speed = np.abs(v).max()
    return np.flatnonzero((distance < reach * (1.0 - 1e-8)) & (closing < -1e-6 * speed))


@pytest.mark.parametrize(
    ("radii", "grains"),
    [((0.6, 0.55), 0), ((0.7, 0.5, 0.3), 0), ((0.6, 0.5), 20), ((0.55,), 160), ((0.6, 0.5), 160)],
)
@pytest.mark.parametrize("e", [1.0, 0.6])
def test_spheres_too_large_for_one_image_never_stay_overlapping_while_approaching(radii, grains, e):
    """What passes half the box shows its other side: the overlap with that is a hit at once."""
    generator = np.random.default_rng(len(radii) + grains)
    count = len(radii) + grains
    scene = scene_of(e, count)
    sizes = np.append(np.array(radii), np.full(grains, 0.06)) * HALF
    positions = generator.uniform(-HALF, HALF, (count, 3))
    velocities = generator.normal(size=(count, 3))
    hits, cells = 0, 0
    for end_time in np.linspace(2e-3, 0.12, 60):
        particles = state(scene, positions, velocities, sizes)
        start = kinetic_energy(particles)
        out = recorded(scene._replace(end_time=end_time), particles)
        assert out.time == end_time
        assert len(approaching_overlaps(particles)) == 0
        left = kinetic_energy(particles) + out.ledger.energy[3]
        assert left == pytest.approx(start, rel=1e-11)
        hits, cells = len(out.times), out.per_axis[0]
    assert hits > (10 if count > 2 else 1)
    assert (cells > 0) == (grains == 160)


def small_steps(positions, velocities, radii, e, end_time, step):
    """Times and pairs of the collisions that a look at all pairs by nearest image finds."""
    r, v = positions.copy(), velocities.copy()
    masses = np.array([ball_mass(radius) for radius in radii])
    found = []
    for k in range(round(end_time / step)):
        settled = False
        while not settled:
            settled = True
            for i, j in itertools.combinations(range(len(r)), 2):
                d = r[j] - r[i]
                d -= 2.0 * HALF * np.rint(d / (2.0 * HALF))
                distance = math.sqrt(d @ d)
                closing = (v[i] - v[j]) @ d / distance
                if distance <= radii[i] + radii[j] and closing > 1e-12:
                    impulse = (1.0 + e) * closing / (1.0 / masses[i] + 1.0 / masses[j])
                    v[i] -= impulse / masses[i] * d / distance
                    v[j] += impulse / masses[j] * d / distance
                    found.append((k * step, i, j))
                    settled = False
        r += step * v
    return found


@pytest.mark.parametrize("seed", range(3))
def test_small_steps_find_the_same_collisions_of_large_spheres(seed):
    radii = np.array([0.7, 0.5, 0.3]) * HALF
    generator = np.random.default_rng(seed)
    positions = generator.uniform(-HALF, HALF, (3, 3))
    velocities = generator.normal(size=(3, 3))
    step, end_time = 1e-6, 0.012
    scene = scene_of(0.6, 3)._replace(end_time=end_time)

    def exact(start):
        out = recorded(scene, state(scene, start, velocities, radii))
        return [(time, *pair) for time, pair in zip(out.times, out.pairs.tolist(), strict=True)]

    found = small_steps(positions, velocities, radii, 0.6, end_time, step)
    reach = 2.0 * step * np.abs(velocities).max()
    expected = expected_collisions(exact, positions, reach)  # that displaced starts agree on
    times = np.array([time for time, *_ in expected.collisions])
    # What follows within a step, as where three spheres collapse, is late by more than one.
    count = min(len(times), np.flatnonzero(np.append(np.diff(times) < step, True))[0] + 1)
    pairs = [list(pair) for _, *pair in expected.collisions]
    assert [pair for _, *pair in found[:count]] == pairs[:count]
    late = np.array([time for time, *_ in found[:count]]) - times[:count]
    assert np.all(np.abs(late) <= step + expected.changes[:count])


def test_oversize_spheres_find_their_neighbours_however_often_they_crossed_the_box():
    """Two heavy oversize push through grains; hits renew the range after which they look around."""
    oversize, grain, count = 0.3 * HALF, 0.014 * HALF, 2000
    places = np.array([[0.0, 0.5, 0.5], [0.0, -0.5, -0.5]]) * HALF
    generator = np.random.default_rng(1)
    grid = lattice(16) * HALF
    grid = (
        grid[generator.permutation(len(grid))] + generator.uniform(-0.01, 0.01, grid.shape) * HALF
    )
    away = np.linalg.norm(grid[:, None] - places, axis=2) > oversize + grain
    positions = np.vstack((grid[np.all(away, axis=1)][:count], places))
    velocities = 0.1 * generator.normal(size=positions.shape)
    velocities[-2:] = [[30.0, 1.0, 0], [-30.0, -1.0, 0]]
    radii = np.append(np.full(count, grain), [oversize, oversize])
    scene = scene_of(1.0, count + 2)._replace(end_time=4e-3)  # six boxes' sides
    particles = state(scene, positions, velocities, radii)
    particles.mass[-2:] *= 1e4
    out = recorded(scene, particles)
    assert out.per_axis[0] >= 8
    assert out.oversize[0] == 2
    assert len(out.times) > 1000
    for k in (count, count + 1):
        d = particles.position.T - particles.position.T[k]
        d -= 2.0 * HALF * np.rint(d / (2.0 * HALF))
        gaps = np.linalg.norm(d, axis=1) - particles.radius - oversize
        assert np.min(np.delete(gaps, k)) > -1e-12 * HALF


@pytest.mark.parametrize("e", [1.0, 0.0])
def test_an_aggregate_a_hundred_times_as_large_costs_each_of_the_others_one_pair(e):
    looks = []
    for count in (2000, 16000):
        generator = np.random.default_rng(1)
        radii = np.append(np.full(count, 0.003 * HALF), 0.3 * HALF)
        side = 27
        grid = (lattice(side) * 0.999)[generator.permutation(side**3)] * HALF
        grid = grid[np.linalg.norm(grid, axis=1) > 0.31 * HALF][:count]
        positions = np.vstack((grid, np.zeros(3)))
        scene = scene_of(e, count + 1)._replace(end_time=2e-3)
        particles = state(scene, positions, generator.normal(size=positions.shape), radii)
        out = recorded(scene, particles)
        assert out.oversize[0] == 1
        assert len(out.times) > 10
        looks.append(out.compared / (count + out.ledger.counts[STEPS]))
    # Eight times as many cost each the same; a cost by the cube root of the count would double.
    assert looks[1] < 1.5 * looks[0]
    assert looks[1] <= 0.01 * count


# collapse


def collapsing(restitution, count=100, budget=2000):
    scene = scene_of(0.5, count, budget=budget)
    scene = scene._replace(radius=size_ratio(0.25) * HALF / count ** (1.0 / 3.0), end_time=1.0)
    scene = scene._replace(mass=ball_mass(scene.radius))
    return scene._replace(laws=scene.laws._replace(restitution=restitution, friction=None))


def simulated(restitution, seed, budget=2000):
    return simulate_scene(collapsing(restitution, budget=budget), np.random.default_rng(seed))


SEEDS = pytest.mark.parametrize("seed", cases(range(3), [0], pytest.mark.slow))


@pytest.mark.slow(guard="simulation/test_event_degenerate.py::test_collapse_may_exhaust_the_budget")
@pytest.mark.parametrize("e", [0.1, 0.2])
def test_collapse_ends_at_rounding_and_much_sooner_if_contacts_last(e):
    collisions = []
    for restitution in (ConstantRestitution.Numbers(e), LastingContact.Numbers(e, 1e-6)):
        for seed in range(6):
            record, particles = simulated(restitution, seed)
            assert (record["state"], record["reason"]) == (COMPLETED, 0)
            assert record["end_time"] == 1.0
            assert record["momentum_error"] <= 1e-12
            assert abs(record["energy_error"]) <= 1e-10
            assert len(approaching_overlaps(particles)) == 0
            collisions.append(record["collisions"])
    if e == 0.1:  # at 0.2 clusters hardly form
        # Ratios of single seeds are 3.8 ± 1.1.
        assert sum(collisions[:6]) > 2.0 * sum(collisions[6:])


@SEEDS
def test_collapse_may_exhaust_the_budget(seed):
    record, _ = simulated(ConstantRestitution.Numbers(0.1), seed, budget=100)
    assert (record["state"], record["reason"]) == (FAILED, FailureReason.BUDGET_EXCEEDED)
    assert 0.0 < record["end_time"] < 1.0


@pytest.mark.slow(guard="simulation/test_event_degenerate.py::test_collapse_may_exhaust_the_budget")
@SEEDS
def test_collapse_does_not_exhaust_the_budget_if_contacts_last(seed):
    record, _ = simulated(LastingContact.Numbers(0.1, 1e-6), seed, budget=100)
    assert (record["state"], record["reason"]) == (COMPLETED, 0)


def ended_dilute(restitution, seed, count):
    """Return the kinetic energy at the end of a dilute gas, and its collisions."""
    scene = scene_of(0.8, count, budget=2000)._replace(
        radius=size_ratio(0.01) * HALF / count ** (1 / 3), end_time=0.02 * (500 / count) ** (1 / 3)
    )
    laws = scene.laws._replace(restitution=restitution, friction=None)
    scene = scene._replace(laws=laws, mass=ball_mass(scene.radius))
    record, particles = simulate_scene(scene, np.random.default_rng(seed))
    assert record["state"] == COMPLETED
    assert record["collisions"] > count
    return kinetic_energy(particles), int(record["collisions"])


@pytest.mark.plain
def test_a_contact_time_below_all_flights_changes_no_bit():
    assert ended_dilute(LastingContact.Numbers(0.8, 1e-14), 5, 24) == ended_dilute(
        ConstantRestitution.Numbers(0.8), 5, 24
    )


@pytest.mark.slow(
    guard="simulation/test_event_degenerate.py::test_a_contact_time_below_all_flights_changes_no_bit"
)
def test_a_contact_time_as_long_as_one_flight_in_a_thousand_hardly_matters():
    """Paths part soon, so that only means are alike: within 4 standard errors."""
    ratios = [
        ended_dilute(LastingContact.Numbers(0.8, 1e-6), seed, 500)[0]
        / ended_dilute(ConstantRestitution.Numbers(0.8), seed, 500)[0]
        for seed in range(40)
    ]
    mean, error = np.mean(ratios), np.std(ratios, ddof=1) / np.sqrt(40)
    assert mean == pytest.approx(1.0, rel=0.05)
    assert abs(mean - 1.0) < 4.0 * error
