"""What frames show: straight flights, impacts in closed form, conservation, cooling."""

import math

import numpy as np
import pytest
from frame_runs import HARD, SCENES, SOFT, STEPS, filled, flying, looked_at, stepping, wrapped
from plain_python import cases
from scenes import CEILING, HALF, breaking_adaptive_reentry

from agglom_mpi.physics.constants import STEFAN_BOLTZMANN
from agglom_mpi.physics.cooling import RadiativeCooling

ROUNDING = 2.0**-52
ALONE = {"particles": 1, "size_ratio": 0.3}


@pytest.mark.plain
@pytest.mark.parametrize(
    ("make", "roundings"),
    [(lambda **options: flying(HARD, **options), 4), (lambda **o: stepping(0.9, **o), 2 * STEPS)],
    ids=["event", "fixed"],
)
def test_a_single_particle_flies_straight_through_periodic_faces(make, roundings):
    scene = make(end_time=4e-3, **ALONE)
    scene = scene._replace(velocities=scene.velocities._replace(mean=(100.0, -50.0, 7.0)))
    times = np.linspace(0.0, scene.end_time, 101)
    for seed in range(3):
        _, _, frames = looked_at(scene, seed, times)
        places, velocity = frames.positions[:, 0], frames.velocities[0, 0]
        way = times[:, None] * velocity
        assert np.abs(way).max() > 10.0 * HALF
        missed = wrapped(places - places[0] - way)
        assert np.abs(missed).max() <= roundings * ROUNDING * (np.abs(way).max() + HALF)
        assert np.abs(places).max() <= HALF
        drift = np.abs(frames.velocities[:, 0] - velocity).max()
        assert drift <= 2.0 * ROUNDING * np.abs(velocity).max()


def next_impact(away, velocity, reach):
    """Time in s and vector in m between the centres when any images touch next, or None."""
    shifts = 2.0 * HALF * (np.indices((5, 5, 5)).reshape(3, -1).T - 2.0)
    vectors = away + shifts
    approach = vectors @ velocity
    root = approach**2 - velocity @ velocity * (np.sum(vectors**2, axis=1) - reach**2)
    hits = (approach < 0.0) & (root > 0.0)
    if not np.any(hits):
        return math.inf, away
    times = (-approach[hits] - np.sqrt(root[hits])) / (velocity @ velocity)
    first = np.argmin(times)
    return times[first], vectors[hits][first] + times[first] * velocity


TWO = {"particles": 2, "size_ratio": 0.5, "end_time": 1e-3}


def two_that_meet(scene, seeds):
    """Seed by seed: frames of two particles, when they meet, and their line of centres then."""
    times = np.linspace(0.0, scene.end_time, 60)
    found = 0
    for seed in seeds:
        _, _, frames = looked_at(scene, seed, times)
        (r, s), (u, v) = frames.positions[0], frames.velocities[0]
        time, line = next_impact(s - r, v - u, 2.0 * scene.radius)
        before = times < time
        flown = frames.positions[0] + times[before, None, None] * frames.velocities[0]
        missed = wrapped(frames.positions[before] - flown)
        np.testing.assert_allclose(missed, 0.0, atol=1e-13 * HALF)
        if 0.0 < time < 0.8 * scene.end_time:
            found += 1
            yield frames, time, line
    assert found >= 4


@pytest.mark.plain
def test_two_that_bounce_are_where_the_elastic_impact_sends_them():
    scene = flying(HARD, **TWO)
    seen = 0
    for frames, time, line in two_that_meet(scene, range(12)):
        (r, s), (u, v) = frames.positions[0], frames.velocities[0]
        normal = line / np.linalg.norm(line)
        kick = ((u - v) @ normal) * normal
        places = np.array([r + time * u, s + time * v])
        after = np.array([u - kick, v + kick])
        again, _ = next_impact(line, after[1] - after[0], 2.0 * scene.radius * (1.0 - 1e-9))
        between = (frames.times > time) & (frames.times < time + again)
        seen += np.count_nonzero(between)
        flown = places + (frames.times[between, None, None] - time) * after
        missed = wrapped(frames.positions[between] - flown)
        # The instant is known to a rounding of the way over how straight they meet.
        np.testing.assert_allclose(missed, 0.0, atol=1e-11 * HALF)
        np.testing.assert_allclose(
            frames.velocities[between], after[None].repeat(sum(between), 0), atol=1e-10
        )
    assert seen > 40


@pytest.mark.plain
def test_two_that_bond_go_on_as_one_from_their_centre_of_mass():
    scene = flying(SOFT, **TWO)
    for frames, time, line in two_that_meet(scene, range(12)):
        r, (u, v) = frames.positions[0, 0], frames.velocities[0]
        bonded = np.flatnonzero(frames.times > time)
        assert np.all(frames.particles[frames.times < time] == 2)
        assert np.all(frames.particles[bonded] == 1)
        assert np.all(frames.labels[bonded] == (0, -1))
        assert np.all(frames.grains[bonded, 0] == 2)
        assert np.all(frames.masses[bonded, 0] == 2.0 * scene.mass)
        np.testing.assert_allclose(frames.radii[bonded, 0], 2.0 ** (1 / 3) * scene.radius, 1e-15)
        centre = r + time * u + 0.5 * line
        together = 0.5 * (u + v)
        flown = centre + (frames.times[bonded, None] - time) * together
        missed = wrapped(frames.positions[bonded, 0] - flown)
        np.testing.assert_allclose(missed, 0.0, atol=1e-11 * HALF)


@pytest.mark.parametrize("name", cases(SCENES, ["quickstart"]))
@pytest.mark.parametrize("seed", cases(range(3), [0], pytest.mark.slow))
def test_mass_grains_and_momentum_are_the_same_in_every_frame(name, seed):
    scene = SCENES[name]
    record, _, frames = looked_at(scene, seed, np.linspace(0.0, scene.end_time, 40))
    assert record["collisions"] > 20
    first = filled(frames, 0)
    momentum = first.masses @ first.velocities
    impetus = first.masses @ np.linalg.norm(first.velocities, axis=1)
    for f in range(40):
        frame = filled(frames, f)
        assert frame.grains.sum() == scene.particles
        assert frame.grains.min() >= 1
        assert frame.masses.sum() == pytest.approx(scene.particles * scene.mass, rel=1e-13)
        volume = np.sum(frame.radii**3)
        assert volume == pytest.approx(scene.particles * scene.radius**3, rel=1e-12)
        change = frame.masses @ frame.velocities - momentum
        assert np.linalg.norm(change) <= 1e-12 * impetus
        assert np.all(np.abs(frame.positions) <= HALF)


@pytest.mark.plain
def test_no_two_overlap_in_a_frame_between_events():
    scene = flying(HARD)
    for seed in range(3):
        record, _, frames = looked_at(scene, seed, np.linspace(0.0, scene.end_time, 150))
        assert record["collisions"] > 100
        closest = math.inf
        for places in frames.positions:
            away = wrapped(places[:, None] - places[None])
            distance = np.linalg.norm(away, axis=2) + np.diag(np.full(scene.particles, np.inf))
            closest = min(closest, distance.min())
        assert 1.0 - 1e-12 <= closest / (2.0 * scene.radius) < 1.01


CONVECTION = RadiativeCooling.Numbers(0.0, 300.0, 20.0, 350.0, 350.0)
INTO_THE_COLD = RadiativeCooling.Numbers(0.5, 0.0, 0.0, 0.0, 0.0)


def relaxed(scene, times):
    """Temperature in K by convection alone."""
    rate = 3.0 * 20.0 * scene.mass / (scene.mass * scene.laws.heat_capacity) / scene.radius
    density = scene.mass / (4.0 / 3.0 * math.pi * scene.radius**3)
    return 350.0 + (scene.temperature - 350.0) * np.exp(-rate / density * times)


def radiated(scene, times):
    """Temperature in K by radiation into emptiness alone."""
    surface = 4.0 * math.pi * scene.radius**2
    rate = STEFAN_BOLTZMANN * 0.5 * surface / (scene.mass * scene.laws.heat_capacity)
    start = scene.temperature
    return start * (1.0 + 3.0 * rate * start**3 * times) ** (-1.0 / 3.0)


@pytest.mark.plain
@pytest.mark.parametrize(
    ("law", "closed_form"),
    [(CONVECTION, relaxed), (INTO_THE_COLD, radiated)],
    ids=["convection", "radiation"],
)
def test_cooling_between_events_follows_its_closed_form(law, closed_form):
    scene = flying(HARD, end_time=50.0, speed=0.0, **ALONE | {"particles": 5})
    scene = scene._replace(cooling=scene.cooling._replace(law=law))
    times = np.linspace(0.0, scene.end_time, 31)
    record, _, frames = looked_at(scene, 1, times)
    assert record["collisions"] == 0
    expected = closed_form(scene, times)
    assert expected[-1] < scene.temperature - 10.0
    np.testing.assert_allclose(frames.temperatures, expected[:, None].repeat(5, 1), rtol=1e-13)


@pytest.mark.plain
def test_an_euler_step_of_cooling_is_a_straight_line_in_between():
    step = CEILING
    scene = breaking_adaptive_reentry(step, step, end_time=10.0 * step, speed=0.0, **ALONE)
    rate = 4.0 * math.pi * scene.radius**2 / (scene.mass * scene.laws.heat_capacity)
    law = scene.cooling.law
    _, _, frames = looked_at(scene, 1, np.arange(41) * 0.25 * step)
    seen = frames.temperatures[:, 0]
    assert seen[-1] < seen[0]
    for k in range(10):
        theta = seen[4 * k]
        loss = STEFAN_BOLTZMANN * law.emissivity * (theta**4 - law.surroundings**4)
        loss += law.convection * (theta - law.ambient)
        line = theta - rate * loss * 0.25 * step * np.arange(5)
        np.testing.assert_allclose(seen[4 * k : 4 * k + 5], line, rtol=2.0 * ROUNDING)
