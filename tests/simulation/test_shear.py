"""Sheared boxes: images, exact times, symmetries, conservation, and what cannot be sheared.

The reference of `sheared_runs` looks at all images of all pairs, independently of the package.
"""

import math

import numpy as np
import pytest
from plain_python import PLAIN_ALONE
from scenes import (
    BREAKING,
    CONSTANT,
    HALF,
    event_periodic,
    merging_event_periodic,
    placed,
    run_from,
    state,
)
from sheared_runs import SIDE, Reference, boxed, in_flow, sheared

from agglom_mpi import Box, load_campaign
from agglom_mpi.accuracy.soundness import approaching_overlaps, overlaps_part
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.physics.contact import CompressionRecoveryDuration
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.rough import RoughFriction
from agglom_mpi.physics.size_distributions import LognormalDistribution
from agglom_mpi.report.figures.evolution import evolution
from agglom_mpi.simulation.boundary import Shear
from agglom_mpi.simulation.event_driven import cells
from agglom_mpi.simulation.event_driven import state as event_state
from agglom_mpi.simulation.particles import COLLISIONS, DISSIPATED, STEPS, WORK
from agglom_mpi.simulation.sample import simulate_scene

pytestmark = PLAIN_ALONE

SPEED = 10.0
"""Largest component of the velocities of `placed` about the mean flow, m/s."""


def start(scene, seed):
    """Return places and velocities of grains in the flow of a scene, (n, 3) each."""
    particles = placed(scene, seed)
    positions = particles.position.T.copy()
    return positions, in_flow(scene.escape.rate, positions, particles.velocity.T)


def end_of(scene, positions, velocities):
    """Run from there; return the ledger, and places and velocities at the end, (n, 3) each."""
    particles = state(scene, positions, velocities)
    ledger, _ = run_from(scene, particles)
    n = int(particles.size[0])
    return ledger, particles.position[:, :n].T, particles.velocity[:, :n].T


def assert_same(found, expected, rate, time, tolerance=1e-9):
    """Compare states, which may be in different images of the box, at a time in s."""
    for place, velocity, other, speed in zip(*found, *expected, strict=True):
        image, flow = np.array(other), np.array(speed)
        above = np.rint((place[1] - image[1]) / SIDE)
        image += (above * rate * SIDE * time, above * SIDE, 0.0)
        flow[0] += above * rate * SIDE
        way = place - image
        assert np.abs(way - SIDE * np.rint(way / SIDE)).max() <= tolerance * HALF
        assert np.abs(velocity - flow).max() <= tolerance * (SPEED + rate * HALF)


@pytest.mark.parametrize(
    ("seed", "count", "rate", "restitution", "ratio"),
    [(1, 7, 500.0, 1.0, 0.5), (2, 6, 3000.0, 0.8, 0.7), (3, 8, 50.0, 0.9, 0.65)],
)
def test_collisions_are_those_of_all_images(seed, count, rate, restitution, ratio):
    time = 6.0 * HALF / (SPEED + rate * HALF)
    scene = sheared(rate, restitution, particles=count, size_ratio=ratio, end_time=time)
    positions, velocities = start(scene, seed)
    reference = Reference(rate, positions, velocities, scene.radius, restitution)
    reference.run(time, 0.2 * HALF / (SPEED + rate * HALF))
    ledger, *found = end_of(scene, positions, velocities)
    assert ledger.counts[COLLISIONS] == reference.count > 5
    assert_same(found, reference.in_box(), rate, time)


@pytest.mark.parametrize(("seed", "rate", "sizes"), [(1, 300.0, False), (2, 3000.0, True)])
def test_cells_follow_the_offset(seed, rate, sizes, monkeypatch):
    """With cells, and grains too large for them, collisions are those of all pairs."""
    strain = 0.5
    scene = sheared(rate, 0.9, particles=130, size_ratio=0.45, end_time=strain / rate)
    positions, velocities = start(scene, seed)
    velocities += rate * HALF * np.random.default_rng(seed).uniform(-1.0, 1.0, velocities.shape)
    radii = np.full(len(positions), scene.radius)
    radii[5:] *= 0.8 if sizes else 1.0
    found = []
    for few in (10, 10**6):
        for module in (cells, event_state):
            monkeypatch.setattr(module, "max_all_pairs", lambda law, few=few: few)
        particles = state(scene, positions, velocities, radii)
        ledger, _ = run_from(scene, particles)
        shown = particles.position.T.copy(), particles.velocity.T.copy()
        found.append((ledger, shown))
    (celled, one), (paired, other) = found
    assert celled.counts[COLLISIONS] == paired.counts[COLLISIONS] > 20
    assert celled.counts[STEPS] > paired.counts[STEPS]
    assert_same(one, other, rate, scene.end_time)


def test_two_meet_across_the_sheared_face_with_the_velocity_of_the_image():
    """One below the upper face, the other above the lower; in closed form, head on at e = 0.5."""
    rate, time, e = 400.0, 2e-3, 0.5
    scene = sheared(rate, e, particles=2, size_ratio=0.25, end_time=2.0 * time)
    reach = 2.0 * scene.radius
    upper = np.array([0.3 * HALF, 0.9 * HALF, 0.1 * HALF])
    met = upper + np.array([0.0, reach, 0.0])  # there the image of the other is, right above
    fall = np.array([0.0, -3.0, 0.0])
    lower = met - fall * time - (0.0, SIDE, 0.0)
    positions = np.array([upper, lower])
    velocities = np.array([[0.0, 0.0, 0.0], fall - (rate * SIDE, 0.0, 0.0)])
    ledger, places, speeds = end_of(scene, positions, velocities)
    after = (1.0 + e) / 2.0 * fall
    image = met + (fall - after) * time
    expected = (
        [upper + after * time, boxed(rate, image, fall - after, 2.0 * time)[0]],
        [after, fall - after - (rate * SIDE, 0.0, 0.0)],
    )
    assert ledger.counts[COLLISIONS] == 1
    assert_same((places, speeds), expected, rate, 2.0 * time, 1e-12)
    loss = 0.25 * scene.mass * (1.0 - e * e) * 9.0
    assert ledger.energy[DISSIPATED] == pytest.approx(loss, rel=1e-12)


def test_a_common_velocity_changes_nothing():
    rate, time, drift = 800.0, 1.5e-3, np.array([30.0, -50.0, 20.0])
    scene = sheared(rate, 0.9, particles=12, size_ratio=0.6, end_time=time)
    positions, velocities = start(scene, 4)
    one, *found = end_of(scene, positions, velocities)
    other, *moved = end_of(scene, positions, velocities + drift)
    assert one.counts[COLLISIONS] == other.counts[COLLISIONS] > 5
    expected = found[0] + drift * time, found[1] + drift
    assert_same(moved, expected, rate, time)


def test_another_origin_changes_nothing():
    """No place of the flow is another than the rest: faces may be anywhere."""
    rate, time, way = 800.0, 1.5e-3, np.array([0.3, 0.7, -0.4]) * HALF
    scene = sheared(rate, 0.9, particles=12, size_ratio=0.6, end_time=time)
    positions, velocities = start(scene, 4)
    one, *found = end_of(scene, positions, velocities)
    shifted = [boxed(rate, r + way, v, 0.0) for r, v in zip(positions, velocities, strict=True)]
    other, *moved = end_of(scene, *(np.array(each) for each in zip(*shifted, strict=True)))
    assert one.counts[COLLISIONS] == other.counts[COLLISIONS] > 5
    assert_same(moved, (found[0] + way, found[1]), rate, time)


def test_the_flow_turned_half_around_z_is_the_flow():
    rate, time, turn = 800.0, 8e-4, np.array([-1.0, -1.0, 1.0])
    scene = sheared(rate, 0.9, particles=12, size_ratio=0.6, end_time=time)
    positions, velocities = start(scene, 5)
    _, *found = end_of(scene, positions, velocities)
    _, *turned = end_of(scene, positions * turn, velocities * turn)
    assert_same(turned, (found[0] * turn, found[1] * turn), rate, time)


def test_the_order_of_the_grains_changes_nothing():
    rate, time = 800.0, 8e-4
    scene = sheared(rate, 0.9, particles=12, size_ratio=0.6, end_time=time)
    positions, velocities = start(scene, 6)
    order = np.random.default_rng(6).permutation(12)
    _, *found = end_of(scene, positions, velocities)
    _, *other = end_of(scene, positions[order], velocities[order])
    assert_same(other, (found[0][order], found[1][order]), rate, time)


def test_without_shear_it_is_the_periodic_box():
    options = {"particles": 12, "size_ratio": 0.6, "end_time": 1e-3}
    scene, rate = sheared(1e-9, 0.9, **options), 1e-9
    positions, velocities = start(scene, 7)
    one, *found = end_of(scene, positions, velocities)
    other, *plain = end_of(event_periodic(0.9, **options), positions, velocities)
    assert one.counts[COLLISIONS] == other.counts[COLLISIONS] > 5
    assert_same(found, plain, rate, 1e-3)


def merging(rate, **options):
    return merging_event_periodic(1e6, **options)._replace(escape=Shear.Numbers(rate))


def breaking(rate, **options):
    scene = merging(rate, **options)
    laws = BREAKING._replace(duration=CompressionRecoveryDuration.Numbers(1e-6))
    return scene._replace(laws=laws)


def rough(rate, **options):
    friction = RoughFriction.Numbers(0.5, 0.4, 0.5)
    laws = CONSTANT._replace(friction=friction, heating=PairSplit.Numbers(), heat_capacity=500.0)
    return sheared(rate, 0.8, laws, **options)


@pytest.mark.parametrize("kind", [sheared, merging, breaking, rough])
@pytest.mark.parametrize(("count", "rate"), [(40, 3000.0), (150, 600.0)])
def test_energy_and_momentum_are_conserved(kind, count, rate):
    """The work of the shear stands in the ledger; momentum is that about the mean flow."""
    scene = kind(rate, particles=count, size_ratio=0.55, end_time=2.5 / rate)
    record, particles = simulate_scene(scene, np.random.default_rng(count))
    n = int(particles.size[0])
    assert record["state"] == 1
    assert record["collisions"] > 20
    assert abs(record["energy_error"]) < 1e-12
    assert record["momentum_error"] < 1e-12
    assert record["overlaps"] == 0 or kind in (merging, breaking)
    assert particles.mass[:n].sum() == pytest.approx(count * scene.mass, rel=1e-12)
    assert np.abs(particles.position[:, :n]).max() <= HALF


def test_overlaps_across_a_sheared_face_are_those_of_its_images():
    """One touches the other's image, which is ahead by a quarter of the edge and falls on it."""
    positions = np.array([[0.0, 9.5, 0.0], [-5.0, -9.5, 0.0]])
    velocities = np.array([[0.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    for ahead, expected in ((5.0, 1), (0.0, 0)):
        images = ahead, 100.0
        assert approaching_overlaps(positions, velocities, np.ones(2), 20.0, images) == expected


def test_work_is_what_the_flow_gives_who_crosses():
    """Without collisions, m(Δ²/2 + uΔ) for each crossing, Δ the velocity of the image."""
    rate, time = 200.0, 1.5e-3
    scene = sheared(rate, particles=2, size_ratio=1e-3, end_time=time)
    positions = np.array([[0.0, 0.5 * HALF, 0.0], [0.0, -0.5 * HALF, 0.5 * HALF]])
    velocities = np.array([[1.0, 10.0, 0.0], [-1.0, -10.0, 0.0]])
    ledger, _, speeds = end_of(scene, positions, velocities)
    change = 0.5 * scene.mass * (np.sum(speeds**2) - np.sum(velocities**2))
    assert ledger.energy[WORK] == pytest.approx(change, rel=1e-12)
    assert speeds[0, 0] == pytest.approx(1.0 - rate * SIDE, rel=1e-12)


def test_the_start_has_the_flow_and_temperature_is_about_it():
    scene = sheared(1000.0, particles=60, size_ratio=0.4, end_time=1e-9)
    scene = scene._replace(sizes=LognormalDistribution(0.2))
    _, sheared_start = simulate_scene(scene, np.random.default_rng(1))
    plain = event_periodic(1.0, particles=60, size_ratio=0.4, end_time=1e-9)
    plain = plain._replace(sizes=LognormalDistribution(0.2))
    _, at_rest = simulate_scene(plain, np.random.default_rng(1))
    about = sheared_start.velocity.copy()
    about[0] -= 1000.0 * sheared_start.position[1]
    np.testing.assert_allclose(about, at_rest.velocity, atol=1e-4)


SCENE = """
seed: 1
scene:
  particles: 40
  half_width: 1 cm
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  escape: ESCAPE
  restitution: {law: constant, value: 0.9}
  engine: ENGINE
  heating: HEATING
  end_time: 2 ms
variables:
  {relative_speed: 10, size_ratio: 0.5, density: 2000, heat_capacity: 500, temperature: 300}
objective: {law: growth_target, ratio: 1.5}
"""


def campaign_of(folder, escape="{law: shear, rate: 300 1/s}", engine="event", heating="pair_split"):
    text = SCENE.replace("ESCAPE", escape).replace("ENGINE", engine).replace("HEATING", heating)
    path = folder / "sheared.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"escape": "{law: shear, rate: 0}"}, "scene.escape.rate"),
        ({"escape": "{law: shear, rate: -5 1/s}"}, "scene.escape.rate"),
        ({"escape": "{law: shear, rate: 5 m}"}, "scene.escape.rate"),
        ({"escape": "{law: shear}"}, "scene.escape.rate"),
        ({"engine": "fixed"}, "scene.engine"),
        ({"engine": "adaptive"}, "scene.engine"),
        ({"heating": "own_energy"}, "scene.heating"),
    ],
)
def test_what_cannot_be_sheared_is_refused(changes, field, tmp_path):
    with pytest.raises(CampaignError) as refused:
        load_campaign(campaign_of(tmp_path, **changes))
    [problem] = refused.value.problems
    assert problem.field == field
    assert problem.line is not None


def test_steps_asked_for_are_refused(tmp_path):
    with pytest.raises(CampaignError, match="engine"):
        load_campaign(campaign_of(tmp_path)).simulate({}, engine="fixed")


def test_a_box_of_a_macroscopic_model_refuses_shear(tmp_path):
    with pytest.raises(ValueError, match=r"scene\.escape"):
        Box(campaign_of(tmp_path))


def test_a_campaign_shears_searches_the_rate_and_keeps_it(tmp_path):
    campaign = load_campaign(campaign_of(tmp_path))
    outcome = campaign.simulate({}, frames=2)
    account = outcome.ledger
    assert abs(account["energy_error"]) < 1e-12
    velocities = outcome.frames.velocities[-1] - outcome.frames.velocities[-1].mean(axis=0)
    velocities[:, 0] -= 300.0 * outcome.frames.positions[-1][:, 1]
    velocities -= velocities.mean(axis=0)
    energy = 0.5 * np.sum(outcome.frames.masses[-1][:, None] * velocities**2)
    assert account["fluctuation_energy"] == pytest.approx(energy, rel=1e-9)
    shown = evolution(outcome.frames, campaign.scene.escape)["granular_temperature"][-1]
    assert 1.5 * outcome.frames.masses[-1].sum() * shown == pytest.approx(energy, rel=1e-9)
    assert overlaps_part(campaign, [0])
    assert math.isfinite(account["shear_work"])
    text = campaign_of(tmp_path, "{law: shear}").read_text()
    search = "ensemble: {rule: fixed, samples: 2}\nstopping: {generations: 2}\n"
    works = []
    for rate, given, more in (("300", {}, ""), ("[100, 500]", {"escape.rate": 400.0}, search)):
        path = tmp_path / "searched.yaml"
        path.write_text(text.replace("{relative", f"{{escape.rate: {rate}, relative") + more)
        works.append(load_campaign(path).simulate(given).ledger["shear_work"])
    assert works[0] == account["shear_work"] != works[1]
