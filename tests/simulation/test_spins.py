"""Rough grains: impacts of two in closed form, conservation, symmetry, merging and breaking.

The references are written here with vectors of NumPy, independently of the package.
"""

import math
from typing import ClassVar, NamedTuple

import numpy as np
import pytest
from plain_python import PLAIN_ALONE
from scenes import BUDGET, CONSTANT, HALF, MERGING, make_scene, momentum, run_from, state

from agglom_mpi import load_campaign
from agglom_mpi.analysis.resimulation import is_same, recorded_sample, simulated_again
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import OUTCOME, SPIN_UNITS
from agglom_mpi.physics.contact import CompressionRecoveryDuration
from agglom_mpi.physics.fragmentation import PairEnergyFragmentation
from agglom_mpi.physics.hardness import ConstantHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.physics.rough import RoughFriction, SpinningFriction, sticking_impulse
from agglom_mpi.report.figures.evolution import evolution
from agglom_mpi.simulation.boundary import Periodic, Reentry
from agglom_mpi.simulation.collision import BOUNCED, merge, resolve_contact, split_particle
from agglom_mpi.simulation.engines import AdaptiveSteps, EventDriven, FixedSteps
from agglom_mpi.simulation.particles import (
    BREAKUPS,
    COLLISIONS,
    DISSIPATED,
    LEFT_TO_STRUCTURE,
    MERGES,
    SPIN_CAPS,
    compact,
    new_ledger,
)
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.storage.reader import read_campaign

pytestmark = PLAIN_ALONE

FEW = {"particles": 30, "size_ratio": 0.6, "end_time": 2e-3}


SOME = 0.3
"""Coefficient of friction at which some contacts slide and others stick."""


def rough(coefficient, tangential, spin_temperature=0.0):
    return RoughFriction.Numbers(spin_temperature, coefficient, tangential)


def rough_scene(e, friction, engine=None, escape=None, **options):
    laws = CONSTANT._replace(restitution=ConstantRestitution.Numbers(e), friction=friction)
    engine = engine or EventDriven.Numbers(BUDGET)
    return make_scene(laws, engine, escape or Periodic.Numbers(), **(FEW | options))


def inertia(particles):
    n = int(particles.size[0])
    return 0.4 * particles.mass[:n] * particles.radius[:n] ** 2


def energies(particles):
    """Kinetic energy of motion and of rotation, J."""
    n = int(particles.size[0])
    motion = 0.5 * particles.mass[:n] * np.sum(particles.velocity[:, :n] ** 2, axis=0)
    turning = 0.5 * inertia(particles) * np.sum(particles.spin[:, :n] ** 2, axis=0)
    return motion.sum(), turning.sum()


def angular_momentum(particles):
    """About the middle of the box, J s."""
    n = int(particles.size[0])
    orbital = np.cross(particles.position[:, :n].T, particles.velocity[:, :n].T)
    spins = inertia(particles)[:, None] * particles.spin[:, :n].T
    return (particles.mass[:n, None] * orbital + spins).sum(axis=0)


class Pair(NamedTuple):
    """Two spheres in contact along `normal`: their particles, and what they were before."""

    particles: object
    normal: np.ndarray


def touching(scene, radii, seed, spin=3e3, overlap=0.0):
    """Return two touching spheres at random, approaching each other, with random spins."""
    random = np.random.default_rng(seed)
    normal = random.normal(size=3)
    normal /= np.linalg.norm(normal)
    distance = (1.0 - overlap) * sum(radii)
    velocities = random.uniform(-10.0, 10.0, (2, 3))
    approach = (velocities[0] - velocities[1]) @ normal
    velocities[0] += (abs(approach) - approach) * normal
    particles = state(scene, [-0.3 * distance * normal, 0.7 * distance * normal], velocities, radii)
    particles.spin[:] = spin * random.uniform(-1.0, 1.0, (3, 2))
    return Pair(particles, normal)


def slip_of(pair):
    """Velocity of the first surface relative to the second where they touch, m/s."""
    velocity, spin, radius = (getattr(pair.particles, n) for n in ("velocity", "spin", "radius"))
    first = velocity[:, 0] + np.cross(spin[:, 0], radius[0] * pair.normal)
    second = velocity[:, 1] + np.cross(spin[:, 1], -radius[1] * pair.normal)
    relative = first - second
    return relative - (relative @ pair.normal) * pair.normal


def hit(scene, pair):
    ledger = new_ledger()
    assert resolve_contact(scene, pair.particles, ledger, 0, 1, 0.0) == BOUNCED
    return ledger


@pytest.mark.parametrize("tangential", [-1.0, -0.4, 0.0, 0.44, 1.0])
@pytest.mark.parametrize("coefficient", [0.0, 0.05, SOME, 1e6])
@pytest.mark.parametrize("radii", [(1e-3, 1e-3), (4e-4, 1.3e-3)])
def test_two_rough_spheres_part_as_walton_says(coefficient, tangential, radii):
    """A contact ends with the slip −β₀g, or has slid all along: then friction is μJ.

    From each sphere: an impulse at its surface changes its momentum, and that times the radius its
    spin. So momentum and angular momentum are kept, which with the slip and the approach is all.
    """
    e, sliding = 0.8, 0
    scene = rough_scene(e, rough(coefficient, tangential))
    for seed in range(12):
        pair = touching(scene, radii, seed)
        particles, normal = pair.particles, pair.normal
        before = slip_of(pair), particles.velocity.copy(), angular_momentum(particles)
        energy, total = sum(energies(particles)), momentum(particles)
        ledger = hit(scene, pair)
        scale = np.abs(particles.mass * particles.velocity).sum()
        np.testing.assert_allclose(momentum(particles), total, atol=1e-14 * scale)
        np.testing.assert_allclose(
            angular_momentum(particles), before[2], rtol=0, atol=1e-13 * scale * sum(radii)
        )
        old, new = (v[:, 0] - v[:, 1] for v in (before[1], particles.velocity))
        assert new @ normal == pytest.approx(-e * (old @ normal), rel=1e-12)
        lost = energy - sum(energies(particles))
        assert ledger.energy[DISSIPATED] == pytest.approx(lost, rel=1e-11)
        assert lost > 0.0
        impulse = particles.mass[0] * (particles.velocity[:, 0] - before[1][:, 0])
        along = impulse @ normal
        across = np.linalg.norm(impulse - along * normal)
        if across < abs(coefficient * along) * (1.0 - 1e-9):
            np.testing.assert_allclose(
                slip_of(pair), -tangential * before[0], atol=1e-12 * np.linalg.norm(before[0])
            )
        else:
            sliding += 1
            assert across == pytest.approx(abs(coefficient * along), rel=1e-9, abs=1e-14 * scale)
            # It acts against the slip.
            opposed = impulse @ before[0]
            assert opposed == pytest.approx(
                -across * np.linalg.norm(before[0]), rel=1e-9, abs=1e-14 * scale
            )
    if tangential > -1.0 and coefficient != SOME:  # of which it depends on the spheres drawn
        assert (sliding > 0) == (coefficient < SOME)


class EndsSlip(SpinningFriction):
    """Every contact ends without slip, as a law of one's own may say."""

    in_files: ClassVar[bool] = False
    summary: ClassVar[str] = "ends the slip"

    def tangential_impulse(self, pair, deficit):
        """(2/7)m*|g_t|."""
        return sticking_impulse(0.0, pair)

    def impulse_slopes(self, pair, lower, upper):
        """0."""
        return 0.0, 0.0


def test_a_law_with_a_tangential_formula_of_its_own_turns_grains():
    scene = rough_scene(0.8, EndsSlip.Numbers(0.0))
    assert scene.has_spins
    pair = touching(scene, (1e-3, 6e-4), 2)
    before, energy = np.linalg.norm(slip_of(pair)), sum(energies(pair.particles))
    ledger = hit(scene, pair)
    assert np.linalg.norm(slip_of(pair)) < 1e-12 * before
    lost = energy - sum(energies(pair.particles))
    assert ledger.energy[DISSIPATED] == pytest.approx(lost, rel=1e-12)


def test_elastic_perfectly_rough_spheres_keep_their_energy():
    scene = rough_scene(1.0, rough(1e6, 1.0))
    pair = touching(scene, (1e-3, 6e-4), 3)
    before = energies(pair.particles)
    hit(scene, pair)
    after = energies(pair.particles)
    assert sum(after) == pytest.approx(sum(before), rel=1e-14)
    assert abs(after[1] - before[1]) > 0.01 * before[1]


@pytest.mark.parametrize("heats", [False, True])
def test_spheres_that_overlap_keep_angular_momentum_and_the_books_close(heats):
    scene = rough_scene(0.8, rough(0.5, 0.4))
    if heats:
        scene = scene._replace(
            laws=scene.laws._replace(heating=PairSplit.Numbers(), heat_capacity=500.0)
        )
    pair = touching(scene, (1e-3, 7e-4), 4, overlap=0.3)
    particles = pair.particles
    energy, turning = sum(energies(particles)), angular_momentum(particles)
    ledger = hit(scene, pair)
    lost = energy - sum(energies(particles))
    assert ledger.energy[DISSIPATED] == pytest.approx(lost, rel=1e-12)
    np.testing.assert_allclose(angular_momentum(particles), turning, rtol=1e-12)
    if heats:
        heat = 500.0 * particles.mass @ (particles.temperature - 400.0)
        assert heat == pytest.approx(lost, rel=1e-9)


def test_a_reflected_pair_parts_like_its_mirror_image():
    """A spin is a pseudovector: in a mirror across x its y and z turn over."""
    scene = rough_scene(0.8, rough(0.4, 0.3))
    one, other = touching(scene, (1e-3, 7e-4), 5), touching(scene, (1e-3, 7e-4), 5)
    mirror = np.array([[-1.0], [1.0], [1.0]])
    other.particles.position[:] *= mirror
    other.particles.velocity[:] *= mirror
    other.particles.spin[:] *= -mirror
    hit(scene, one)
    hit(scene, other)
    np.testing.assert_allclose(other.particles.velocity, one.particles.velocity * mirror)
    np.testing.assert_allclose(other.particles.spin, -one.particles.spin * mirror)


def test_an_exchanged_pair_parts_alike():
    scene = rough_scene(0.8, rough(0.4, 0.3))
    one, other = touching(scene, (1e-3, 7e-4), 6), touching(scene, (1e-3, 7e-4), 6)
    other.particles.records[:2] = other.particles.records[1::-1].copy()
    hit(scene, one)
    hit(scene, other)
    np.testing.assert_allclose(other.particles.velocity[:, ::-1], one.particles.velocity)
    np.testing.assert_allclose(other.particles.spin[:, ::-1], one.particles.spin)


ENGINES = {
    "event": EventDriven.Numbers(BUDGET),
    "fixed": FixedSteps.Numbers(100),
    "adaptive": AdaptiveSteps.Numbers(1e-6, 1e-4),
}


@pytest.mark.parametrize("engine", ENGINES)
def test_grains_that_are_neither_rough_nor_turned_are_smooth_to_the_bit(engine):
    smooth = rough_scene(0.9, None, ENGINES[engine])
    one, kept = simulate_scene(smooth, np.random.default_rng(7))
    other, spun = simulate_scene(
        rough_scene(0.9, rough(0.0, -1.0), ENGINES[engine]), np.random.default_rng(7)
    )
    assert one["collisions"] > 20
    assert all(one[name].tobytes() == other[name].tobytes() for name in OUTCOME.names)
    assert other["rotational_temperature"] == other["spin_caps"] == 0.0
    for name in ("position", "velocity"):
        assert getattr(kept, name).tobytes() == getattr(spun, name).tobytes()
    assert not spun.spin.any()


@pytest.mark.parametrize("engine", ENGINES)
def test_the_energy_of_motion_and_rotation_is_accounted_for(engine):
    record, particles = simulate_scene(
        rough_scene(0.9, rough(0.3, 0.5), ENGINES[engine]), np.random.default_rng(8)
    )
    assert record["state"] == 1
    assert record["collisions"] > 20
    assert abs(record["energy_error"]) < 1e-13
    assert energies(particles)[1] > 0.01 * energies(particles)[0]


def cluster(scene, seed, spread=0.3):
    """Return grains that fly towards the middle of the box, far from its faces."""
    random = np.random.default_rng(seed)
    count, positions = scene.particles, np.empty((0, 3))
    while len(positions) < count:
        trial = random.uniform(-spread * HALF, spread * HALF, 3)
        if np.all(np.linalg.norm(positions - trial, axis=1) >= 2.0 * scene.radius):
            positions = np.vstack((positions, trial))
    velocities = -300.0 * positions + random.uniform(-0.3, 0.3, (count, 3))
    particles = state(scene, positions, velocities - velocities.mean(axis=0))
    particles.spin[:, :count] = random.uniform(-1e3, 1e3, (3, count))
    return particles


@pytest.mark.parametrize("friction", [rough(0.2, 0.4), rough(1e3, -0.2), rough(1e3, 1.0)])
def test_an_isolated_cluster_keeps_its_angular_momentum(friction):
    scene = rough_scene(0.7, friction, end_time=1.5e-3, size_ratio=0.3, escape=Reentry.Numbers())
    particles = cluster(scene, 9)
    before, scale = angular_momentum(particles), np.abs(particles.mass * HALF * 3.0).sum()
    ledger, _ = run_from(scene, particles)
    assert ledger.counts[COLLISIONS] > 20
    assert np.abs(particles.position).max() < HALF
    np.testing.assert_allclose(angular_momentum(particles), before, rtol=0, atol=1e-13 * scale)


def test_initial_spins_have_their_temperature_and_change_no_velocity():
    options = {"particles": 200, "size_ratio": 0.5}
    still, turning = (rough_scene(0.9, rough(0.2, 0.4, t), **options) for t in (0.0, 0.7))
    found = []
    for scene in (still, turning):
        _, particles = simulate_scene(scene._replace(end_time=1e-12), np.random.default_rng(3))
        found.append(particles)
    one, other = found
    assert one.velocity.tobytes() == other.velocity.tobytes()
    assert not one.spin.any()
    n = int(other.size[0])
    drift = other.velocity[:, :n].mean(axis=1, keepdims=True)
    motion = 0.5 * other.mass[:n] @ np.sum((other.velocity[:, :n] - drift) ** 2, axis=0)
    assert energies(other)[1] == pytest.approx(0.7 * motion, rel=1e-12)
    # 4 standard errors of the share of a component, whose square has a variance of 4/5 its mean².
    shares = np.mean(other.spin[:, :n] ** 2, axis=1)
    assert np.abs(shares / shares.mean() - 1.0).max() < 4.0 * math.sqrt(0.8 / n)


def left_to_structure(ledger):
    return ledger.energy[LEFT_TO_STRUCTURE : LEFT_TO_STRUCTURE + 3]


def test_a_grazing_pair_that_merges_spins_with_all_its_energy():
    """It would need 0.39 mu² to keep its angular momentum; its motion has 0.25 mu²."""
    laws = MERGING._replace(friction=rough(0.2, 0.4), reaction=None)
    scene = make_scene(laws, EventDriven.Numbers(BUDGET), Periodic.Numbers(), **FEW)
    radius, speed = 1e-3, 2.0
    positions = [[-radius, 0.0, 0.0], [radius, 0.0, 0.0]]
    velocities = [[0.0, 0.5 * speed, 0.0], [0.0, -0.5 * speed, 0.0]]
    particles, ledger = state(scene, positions, velocities, [radius, radius]), new_ledger()
    mass, before = particles.mass[0], angular_momentum(particles)
    assert np.linalg.norm(before) == pytest.approx(mass * radius * speed)
    merge(scene, particles, ledger, 0, 1, 0.0)
    compact(particles)
    motion, turning = energies(particles)
    assert motion == pytest.approx(0.0, abs=1e-30)
    assert turning == pytest.approx(0.25 * mass * speed**2, rel=1e-12)
    assert ledger.energy[DISSIPATED] == pytest.approx(0.0, abs=1e-15 * mass * speed**2)
    assert ledger.counts[SPIN_CAPS] == 1
    np.testing.assert_allclose(angular_momentum(particles) + left_to_structure(ledger), before)
    needed = 1.25 / 2.0 ** (5.0 / 3.0)  # over mu²: (mbu)²/2I, I = (2/5)(2m)(2^⅓b)²
    kept = angular_momentum(particles)[2] / before[2]
    assert kept == pytest.approx(math.sqrt(0.25 / needed))


@pytest.mark.parametrize("seed", range(8))
def test_a_pair_that_merges_keeps_what_it_may_and_the_books_close(seed):
    laws = MERGING._replace(friction=rough(0.2, 0.4), reaction=None)
    scene = make_scene(laws, EventDriven.Numbers(BUDGET), Periodic.Numbers(), **FEW)
    particles = touching(scene, (1e-3, 6e-4), seed, spin=2e4 * (seed % 2)).particles
    ledger, before = new_ledger(), angular_momentum(particles)
    energy, total = sum(energies(particles)), momentum(particles)
    merge(scene, particles, ledger, 0, 1, 0.0)
    compact(particles)
    np.testing.assert_allclose(momentum(particles), total, rtol=1e-12)
    np.testing.assert_allclose(
        angular_momentum(particles) + left_to_structure(ledger), before, rtol=1e-11
    )
    lost = energy - sum(energies(particles))
    assert lost >= -1e-14 * energy
    assert ledger.energy[DISSIPATED] == pytest.approx(lost, abs=1e-13 * energy)
    heat = 500.0 * particles.mass[0] * (particles.temperature[0] - 400.0)
    assert heat == pytest.approx(lost, abs=1e-9 * energy)
    assert (ledger.counts[SPIN_CAPS] == 0) == (not left_to_structure(ledger).any())


@pytest.mark.parametrize("pieces", [2, 3, 5, 13, 40])
@pytest.mark.parametrize("given", [0.0, 1e-3])
def test_pieces_rotate_as_one_body_with_the_angular_momentum_of_the_whole(pieces, given):
    laws = MERGING._replace(
        friction=rough(0.2, 0.4), fragmentation=PairEnergyFragmentation.Numbers(3.0)
    )
    scene = make_scene(laws, EventDriven.Numbers(BUDGET), Periodic.Numbers(), **FEW)
    particles = state(scene, np.zeros((pieces, 3)), np.zeros((pieces, 3)))
    particles.size[0] = 1
    particles.velocity[:, 0] = 1.0, -2.0, 3.0
    particles.spin[:, 0] = 700.0, -900.0, 800.0
    particles.radius[0], particles.mass[0], particles.grains[0] = 2e-3, 2e-4, pieces
    ledger, before, total = new_ledger(), angular_momentum(particles), momentum(particles)
    motion, turning = energies(particles)
    split_particle(scene, particles, ledger, 0, pieces, given)
    assert particles.size[0] == pieces
    np.testing.assert_allclose(momentum(particles), total, rtol=1e-12)
    np.testing.assert_allclose(
        angular_momentum(particles) + left_to_structure(ledger), before, rtol=1e-10
    )
    lost = motion + turning - sum(energies(particles))
    assert ledger.energy[DISSIPATED] == pytest.approx(lost, abs=1e-12 * (motion + turning))
    assert lost >= -given - 1e-12 * motion
    if given > turning:  # two pieces along the axis have less inertia than the whole
        assert ledger.counts[SPIN_CAPS] == 0
    heat = 500.0 * particles.mass @ (particles.temperature - 400.0)
    assert heat == pytest.approx(lost, abs=1e-9 * motion)
    for i in range(pieces):
        for j in range(i):
            line = particles.position[:, j] - particles.position[:, i]
            approach = (particles.velocity[:, i] - particles.velocity[:, j]) @ line
            assert approach < 0.0


@pytest.mark.parametrize("escape", [Reentry.Numbers(), Periodic.Numbers()])
def test_a_cluster_that_merges_and_breaks_keeps_angular_momentum_but_for_its_structure(escape):
    laws = MERGING._replace(
        duration=CompressionRecoveryDuration.Numbers(1.0),
        hardness=ConstantHardness.Numbers(300.0),
        friction=rough(0.3, 0.4),
        fragmentation=PairEnergyFragmentation.Numbers(0.01),
        reaction=None,
    )
    options = {"particles": 30, "size_ratio": 0.3, "end_time": 6e-3}
    scene = make_scene(laws, EventDriven.Numbers(BUDGET), escape, **options)
    particles = with_room(scene, cluster(scene, 11))
    before, scale = angular_momentum(particles), np.abs(particles.mass * HALF * 3.0).sum()
    energy = sum(energies(particles))
    ledger, _ = run_from(scene, particles)
    assert ledger.counts[MERGES] > 3
    assert ledger.counts[BREAKUPS] > 0
    assert np.abs(particles.position[:, : particles.size[0]]).max() < HALF
    np.testing.assert_allclose(
        angular_momentum(particles) + left_to_structure(ledger), before, rtol=0, atol=1e-12 * scale
    )
    assert ledger.energy[DISSIPATED] == pytest.approx(energy - sum(energies(particles)), rel=1e-11)


def with_room(scene, particles):
    """Return particles with room for as many pieces."""
    count = int(particles.size[0])
    roomy = state(scene, np.zeros((2 * count, 3)), np.zeros((2 * count, 3)))
    roomy.size[0] = roomy.labels_given[0] = count
    roomy.records[:count] = particles.records[:count]
    return roomy


def test_a_scene_that_merges_and_breaks_closes_its_energy_with_spins():
    laws = MERGING._replace(
        duration=CompressionRecoveryDuration.Numbers(1.0),
        hardness=ConstantHardness.Numbers(2e4),
        friction=rough(0.3, 0.4, 0.5),
        fragmentation=PairEnergyFragmentation.Numbers(0.3),
    )
    scene = make_scene(laws, EventDriven.Numbers(BUDGET), Periodic.Numbers(), **FEW)
    record, _ = simulate_scene(scene, np.random.default_rng(12))
    assert record["merges"] > 0
    assert record["breakups"] > 0
    assert record["floored_temperatures"] == 0
    assert abs(record["energy_error"]) < 1e-12


CAMPAIGN = """
title: rough grains
seed: 1
scene:
  particles: 30
  half_width: 1 cm
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: constant, value: 0.9}
  friction: {law: rough, coefficient: 0.3, tangential: 0.44, spin_temperature: 0.5}
  heating: none
  end_time: 2 ms
variables: {relative_speed: 10, volume_fraction: 0.1, density: 5000}
"""


def test_a_campaign_reports_the_spins_of_its_samples(tmp_path):
    file = tmp_path / "rough.yaml"
    file.write_text(CAMPAIGN)
    campaign = load_campaign(file)
    outcome = campaign.simulate({}, frames=3)
    kept = campaign.simulate({})
    assert kept.ledger == outcome.ledger
    assert kept.final.spins.tobytes() == outcome.final.spins.tobytes()
    np.testing.assert_array_equal(outcome.frames.spins[-1], outcome.final.spins)
    velocities, masses = outcome.frames.velocities, outcome.final.masses[:, None]
    radii = outcome.final.radii[:, None]
    for f, ratio in ((0, 0.5), (-1, outcome.ledger["rotational_ratio"])):
        relative = velocities[f] - velocities[f].mean(axis=0)
        turning = 0.4 * masses * radii**2 * outcome.frames.spins[f] ** 2
        assert turning.sum() / (masses * relative**2).sum() == pytest.approx(ratio, rel=1e-9)
    run = evolution(outcome.frames)
    for name in ("granular_temperature", "rotational_temperature"):
        assert run[name][-1] == pytest.approx(outcome.record[name], rel=1e-9)
    assert outcome.ledger["spin_caps"] == 0
    assert outcome.ledger["angular_momentum_left"] == 0.0
    assert abs(outcome.ledger["energy_error"]) < 1e-13


SHARE = """
def share(sample):
    turning, moving = sample.rotational_temperature, sample.granular_temperature
    return turning / (turning + moving)
"""

SEARCHED = """
objective: {law: function, call: "shape:share"}
search: {population: 4, parents: 2}
ensemble: {rule: fixed, samples: 2}
stopping: {generations: 1}
final: none
output: {final_particles: true, frames: {strings: 1, samples: 1, count: 2}}
"""


def test_rows_of_spinning_grains_have_their_temperatures_and_what_merging_left(tmp_path):
    text = CAMPAIGN.replace("particles: 30", "particles: 8").replace("10, v", "[5, 9], v")
    plastic = "restitution: {law: pressure}\n  duration: mean_speed\n  hardness: constant"
    text = text.replace("restitution: {law: constant, value: 0.9}", plastic)
    text = text.replace("5000}", "5000, hardness: 1e7}").replace("action: 0.1", "action: 0.25")
    (tmp_path / "rough.yaml").write_text(text + SEARCHED)
    (tmp_path / "shape.py").write_text(SHARE)
    campaign = load_campaign(tmp_path / "rough.yaml", allow_code=True)
    file = campaign.run(tmp_path / "rough.h5", progress=False)
    samples, strings = file.samples, file.strings
    assert {name: samples.attrs["units"][name] for name in SPIN_UNITS} == SPIN_UNITS
    assert samples["spin_caps"].sum() > 0.0
    assert ((samples["angular_momentum_left"] > 0.0) == (samples["spin_caps"] > 0.0)).all()
    turning, moving = (samples[f"{name}_temperature"] for name in ("rotational", "granular"))
    np.testing.assert_array_equal(samples["objective"], turning / (turning + moving))
    mean = samples.groupby("string")["rotational_temperature"].mean()
    np.testing.assert_allclose(strings["rotational_temperature"], mean, rtol=1e-14)
    assert campaign.simulate_many(file.best(1)).failed.shape == (1, 1)  # no column is a variable
    many = campaign.simulate_many([campaign.parameters()], samples=2)
    for row in samples.itertuples():
        left = file.final_particles(row.string, row.sample)
        turning = 0.4 * left.masses @ (left.radii**2 * (left.spins**2).sum(axis=1))
        assert turning / (3.0 * left.masses.sum()) == pytest.approx(
            row.rotational_temperature, rel=1e-12
        )
    assert many.units["rotational_temperature"] == "m^2/s^2"
    alone = campaign.simulate({})
    assert many.rotational_temperature[0, 0] == alone.record["rotational_temperature"]
    [(string, sample)] = file.framed()
    last = file.frames(string, sample)
    left = file.final_particles(string, sample)
    np.testing.assert_array_equal(last.spins[-1, : len(left.spins)], left.spins)
    data = read_campaign(tmp_path / "rough.h5", allow_code=True)
    again = simulated_again(data, string, sample)
    assert is_same(recorded_sample(data, string, sample), again.record, data.sizes.version)


@pytest.mark.parametrize(
    "more",
    [
        "derived: {granular_temperature: relative_speed^2}",
        'objective: {law: function, call: "a:b", quantities: [spin_caps], of_means: "a:c"}',
    ],
)
def test_columns_of_spins_are_no_names_of_other_quantities(tmp_path, more):
    (tmp_path / "a.py").write_text("def b(sample):\n    pass\n\ndef c(means):\n    pass\n")
    file = tmp_path / "rough.yaml"
    file.write_text(CAMPAIGN.replace("friction:", "# friction:") + more)
    load_campaign(file, allow_code=True)
    file.write_text(CAMPAIGN + more)
    with pytest.raises(CampaignError, match=r"rough.yaml:\d+.*(granular_temp|spin_caps).*choose"):
        load_campaign(file, allow_code=True)


@pytest.mark.parametrize(
    ("key", "law"), [("heating", "own_energy"), ("fragmentation", "own_energy")]
)
def test_laws_that_know_no_spins_are_refused_with_them(tmp_path, key, law):
    file = tmp_path / "rough.yaml"
    text = CAMPAIGN.replace("heating: none", f"{key}: {law}\n  end_time: 1 ms")
    text = text.replace("  end_time: 2 ms\n", "").replace("5000}", "5000, heat_capacity: 500, ")
    file.write_text(text + "temperature: 300, surface_energy: 1}\n")
    with pytest.raises(CampaignError, match=rf"rough.yaml:\d+.*scene.{key}: is '{law}'"):
        load_campaign(file)
