"""Samples of grains of different sizes: placement, engines, boxes, frames; mixtures."""

import math
from pathlib import Path

import kinetic_theory as theory
import numpy as np
import pytest
from event_runs import bouncing, recorded
from plain_python import cases
from scenes import HALF, SMALL_SCENES, ball_mass, state

from agglom_mpi import Box
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.size_warnings import MOST_FILLED
from agglom_mpi.outcome import REASONS
from agglom_mpi.physics.kinetic_theory import mixture_rates
from agglom_mpi.physics.size_distributions import (
    ListedDistribution,
    LognormalDistribution,
    draw_radii,
)
from agglom_mpi.physics.velocities import UniformX
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.initial_state import DifferentSizes, scatter
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.verbs.simulate import simulate

QUICKSTART = (Path(__file__).parents[2] / "jobs" / "quickstart.yaml").read_text()
NEVER = np.zeros(1, np.uint8)
ENGINES = {"event": "event", "fixed": "fixed:100"}


def quickstart(sizes=None, particles=60, end_time="characteristic"):
    """The quickstart campaign with other grains."""
    line = f"half_width: 1 cm\n  sizes: {sizes}" if sizes else "half_width: 1 cm"
    text = QUICKSTART.replace("particles: 100", f"particles: {particles}")
    text = text.replace("half_width: 1 cm", line)
    text = text.replace("end_time: characteristic", f"end_time: {end_time}")
    return Campaign.from_text(text.replace("size_ratio: [0.4, 0.8]", "size_ratio: [0.4, 0.7]"))


LOGNORMAL = quickstart("{law: lognormal, spread: 1.4}")
AT_THE_START = quickstart("{law: lognormal, spread: 1.4}", end_time="1 ns")


@pytest.mark.plain
@pytest.mark.parametrize("engine", ["event", pytest.param("fixed", marks=pytest.mark.slow)])
def test_grains_of_one_size_are_equal_grains_to_the_bit(engine):
    campaign = quickstart()
    chosen = campaign.engine(ENGINES[engine])
    scene = campaign.scene.build(campaign.parameters(), chosen)
    one = scene._replace(sizes=ListedDistribution(np.ones(3)))
    records = [simulate_scene(s, np.random.default_rng(5))[0] for s in (scene, one)]
    assert records[0].tobytes() == records[1].tobytes()
    assert records[0]["merges"] > 10


@pytest.mark.plain
@pytest.mark.parametrize("engine", cases(ENGINES, ["event", "fixed"], pytest.mark.slow))
def test_no_grain_and_no_mass_is_lost(engine):
    outcome = simulate(LOGNORMAL, {}, 2, ENGINES[engine], frames=[0.0])
    first, final = outcome.frames, outcome.final
    assert outcome.merges > 10
    assert final.grains.sum() == 60
    assert final.masses.sum() == pytest.approx(first.masses[0].sum(), rel=1e-12)
    assert abs(outcome.ledger["energy_error"]) < 1e-9
    radius = LOGNORMAL.scene.build(LOGNORMAL.parameters()).radius
    assert outcome.radii == pytest.approx(final.radii / radius, rel=1e-15)
    volumes = first.radii[0] ** 3
    assert first.masses[0] == pytest.approx(volumes * (first.masses[0, 0] / volumes[0]), rel=1e-12)


@pytest.mark.plain
def test_grains_are_placed_apart_the_largest_first():
    frames = simulate(AT_THE_START, {}, 0, frames=[0.0]).frames
    radii, places = frames.radii[0], frames.positions[0]
    assert np.all(np.diff(radii) <= 0.0)
    assert radii[0] > 1.5 * radii[-1]
    away = places[:, None] - places
    away -= 0.02 * np.rint(away / 0.02)
    gaps = np.linalg.norm(away, axis=2) - np.add.outer(radii, radii)
    assert gaps[np.triu_indices(60, 1)].min() > 0.0
    assert frames.grains[0].tolist() == [1] * 60


@pytest.mark.plain
def test_each_sample_draws_its_own_sizes_and_again_the_same():
    first, again, other = (
        simulate(AT_THE_START, {}, sample, frames=[0.0]).frames.radii[0] for sample in (0, 0, 1)
    )
    assert first.tobytes() == again.tobytes()
    assert np.all(first != other)


def test_the_mean_radius_at_the_start_is_that_of_the_law():
    campaign = quickstart("{law: lognormal, spread: 1.4}", particles=4000)
    scene = campaign.scene.build(campaign.parameters())
    radii = scene.radius * draw_radii(scene.sizes, np.random.default_rng(1), 4000)
    error = radii.std() / math.sqrt(4000)
    assert radii.mean() == pytest.approx(scene.radius, abs=4.0 * error)


@pytest.mark.plain
@pytest.mark.parametrize("engine", cases(ENGINES, ["event"], pytest.mark.slow))
def test_a_box_has_the_grains_of_the_sample_of_its_number(engine):
    outcome = simulate(LOGNORMAL, {}, 3, ENGINES[engine])
    box = Box(LOGNORMAL, sample=3, engine=ENGINES[engine])
    box.advance(float(outcome.record["end_time"]))
    assert box.particles.radii.tobytes() == outcome.final.radii.tobytes()
    assert box.particles.grains.tolist() == outcome.final.grains.tolist()


@pytest.mark.slow(guard="simulation/test_simulation_sizes.py::test_no_grain_and_no_mass_is_lost")
def test_aggregates_of_different_grains_break_into_no_more_pieces_than_they_have_grains():
    text = (Path(__file__).parents[2] / "jobs/extremes/always_breaking.yaml").read_text()
    line = next(line for line in text.splitlines() if line.strip().startswith("half_width"))
    text = text.replace(line, f"{line}\n  sizes: {{law: uniform, ratio: 3}}")
    campaign = Campaign.from_text(text)
    outcome = simulate(campaign, {})
    assert outcome.breakups > 0
    assert outcome.final.grains.sum() == campaign.scene.particles
    assert outcome.final.grains.min() >= 1


@pytest.mark.parametrize("spread", [1.2, 1.6])
def test_grains_find_their_places_up_to_the_fraction_that_is_allowed(spread):
    campaign = quickstart(f"{{law: lognormal, spread: {spread}}}", particles=300)
    string = campaign.parameters({"volume_fraction": 0.38})
    scene = campaign.scene.build(string)
    radii = scene.radius * draw_radii(scene.sizes, np.random.default_rng(1), 300)
    places = np.empty((3, 300))
    laws, sizes = (scene.escape, scene.velocities), DifferentSizes(radii, float(radii[0]))
    assert scatter(*laws, np.random.default_rng(1), sizes, scene.half_width, places, None, NEVER)


def test_a_grain_larger_than_the_box_finds_no_place():
    wide = SMALL_SCENES["event"]._replace(sizes=LognormalDistribution(2.5), end_time=1e-6)
    found = [simulate_scene(wide, np.random.default_rng(seed))[0]["reason"] for seed in range(40)]
    assert {REASONS[reason] for reason in found if reason} == {
        "placement: no free place was found for every sphere"
    }


MIXTURES = {  # volume fraction: large over small diameter, share of large ones
    0.05: (3.0, 0.1),
    0.2: (2.0, 0.3),
}
NUMBER, RUNS, COLLISIONS = 1000, 8, 200_000
RUNS_OF_PAIRS = {0.05: RUNS, 0.2: 30}
GAS = """
seed: 1
scene:
  particles: {number}
  sizes: {{file: sizes.csv}}
  velocities: {{law: spread, mean: [0, 0, 0], transverse: 1}}
  restitution: {{law: constant, value: 1}}
  heating: none
  end_time: 1 s
  engine: {{law: event, budget: 1000000000}}
variables: {{relative_speed: 1, volume_fraction: {fraction}, density: 2500}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("fraction", MIXTURES)
def test_a_box_of_two_sizes_from_a_file_collides_at_the_rate_of_kinetic_theory(fraction, tmp_path):
    """Elastic spheres in equilibrium, with the contact values of BMCSL: all collisions, to 1 %."""
    ratio, share = MIXTURES[fraction]
    rows = [
        "diameter (um)",
        *["50"] * round(10 - 10 * share),
        *[f"{50 * ratio}"] * round(10 * share),
    ]
    (tmp_path / "sizes.csv").write_text("\n".join(rows))
    (tmp_path / "gas.yaml").write_text(GAS.format(number=NUMBER, fraction=fraction))
    found = [box_over_theory(tmp_path / "gas.yaml", sample) for sample in range(RUNS)]
    mean, error = np.mean(found), np.std(found, ddof=1) / math.sqrt(RUNS)
    assert error < 0.0025
    assert mean == pytest.approx(1.0, abs=0.01)


def box_over_theory(path, sample):
    """Collisions of a box of a sample's grains over those of kinetic theory for these grains."""
    box = Box(path, sample=sample)
    masses, temperature = box.particles.masses, box.particles.masses.mean()
    random = np.random.default_rng(sample)
    box.set(velocities=theory.maxwellian(masses, temperature, random))
    diameters, numbers = np.unique(2.0 * box.particles.radii, return_counts=True)
    kinds = np.unique(masses)
    assert len(diameters) == 2
    rates = mixture_rates(numbers / box.volume, diameters, kinds, temperature)
    # A sphere has one partner fewer of its own kind than there are.
    pairs = 0.5 * (numbers[:, None] * rates) * (1.0 - np.eye(2) / numbers)
    box.advance(50 * NUMBER / 2 / pairs.sum())
    wanted = 400 * NUMBER / 2
    return box.advance(wanted / pairs.sum()).collisions / wanted


@pytest.mark.slow
@pytest.mark.parametrize("fraction", MIXTURES)
def test_pairs_of_each_kind_collide_at_the_rates_of_kinetic_theory(fraction):
    """No rate of a kind of pair is off by more than 1 % and four standard errors of the runs.

    Of large spheres with each other there are few, and the theory is low for them: by 0.95 ± 0.04 %
    at φ = 0.2.
    """
    (ratio, share), runs = MIXTURES[fraction], RUNS_OF_PAIRS[fraction]
    large = round(10 * share)
    ratios = np.array([1.0] * (10 - large) + [ratio] * large)
    law = ListedDistribution(ratios / ratios.mean())
    found = np.array([measured_over_expected(law, fraction, seed) for seed in range(runs)])
    mean, error = found.mean(axis=0), found.std(axis=0, ddof=1) / math.sqrt(runs)
    assert np.all(error[[0, 1, 3]] < 0.002)  # there are too few large ones for that
    assert np.all(np.abs(mean - 1.0) < 0.01 + 4.0 * error)


def measured_over_expected(law, fraction, seed):
    """Collision rates of small with small, of both, of large with large, and of all."""
    scene, particles = mixture(law, fraction, seed)
    radii = particles.radius[:NUMBER].copy()
    is_large = radii > radii.mean()
    # Fifty collisions per sphere, since random sequential places are not those of a gas.
    recorded(scene, particles, 50 * NUMBER // 2)
    run = recorded(scene, particles, COLLISIONS)
    counts = np.bincount(is_large[run.pairs].sum(axis=1), minlength=3)
    assert counts.sum() == COLLISIONS
    diameters = 2.0 * np.array([radii.min(), radii.max()])
    numbers = np.array([np.sum(~is_large), np.sum(is_large)])
    masses = np.array([ball_mass(0.5 * diameter) for diameter in diameters])
    single = mixture_rates(numbers / (2.0 * HALF) ** 3, diameters, masses, 1.0)
    rates = numbers[:, None] * single
    # A sphere has one partner fewer of its own kind than there are.
    own = 1.0 - 1.0 / numbers
    expected = np.array([0.5 * rates[0, 0] * own[0], rates[0, 1], 0.5 * rates[1, 1] * own[1]])
    measured = counts / run.time
    return [*(measured / expected), measured.sum() / expected.sum()]


def mixture(law, fraction, seed):
    """A scene of spheres by a law, at random places, Maxwellian at the temperature 1 J."""
    random = np.random.default_rng(seed)
    ratios = draw_radii(law, random, NUMBER)
    filled = 6.0 * fraction / (np.pi * np.mean(ratios**3))
    radius = filled ** (1.0 / 3.0) * HALF / NUMBER ** (1.0 / 3.0)
    scene = bouncing(1.0, budget=10**7, particles=NUMBER, size_ratio=0.5, end_time=1e9)
    radii, places = radius * ratios, np.empty((3, NUMBER))
    sizes = DifferentSizes(radii, float(radii[0]))
    assert scatter(scene.escape, scene.velocities, random, sizes, HALF, places, None, NEVER)
    velocities = theory.maxwellian(ball_mass(radius) * ratios**3, 1.0, random)
    scene = scene._replace(radius=radius, mass=ball_mass(radius))
    return scene, state(scene, places.T, velocities, radii)


def test_samples_that_draw_too_much_of_the_box_jam_and_others_do_not():
    """The rule by which a wide law is warned of before a run: see `size_warnings.MOST_FILLED`.

    It counts on one large grain. Two or three of its size may leave no place for the last of them,
    so the rest has to fill less of what the largest leaves than equal spheres do that are placed at
    random until none finds a place, 0.384; and a hundredth of the box, its corners as seen from the
    largest, is left for the second. With π/6 for the largest, and for two generations of grains in
    what is left 1 − (1 − 0.384)², no sample fills more than 0.82.
    """
    law, count, half = LognormalDistribution(math.log(2.0)), 50, 1.0
    unit = half * (0.2 * 6.0 / math.pi / math.exp(3.0 * math.log(2.0) ** 2)) ** (1 / 3)
    places = np.empty((3, count))
    fitting, others = {}, {}
    for seed in range(300):
        random = np.random.default_rng(seed)
        radii = unit / count ** (1 / 3) * draw_radii(law, random, count)
        fractions = 4.0 / 3.0 * math.pi * radii**3 / (2.0 * half) ** 3
        filled, largest = fractions.sum(), fractions[0]
        if filled > 0.45 and radii[0] < half:
            sizes = DifferentSizes(radii, float(radii[0]))
            laws, drawn = (Periodic.Numbers(), UniformX.Numbers(1.0)), places.copy()
            placed = scatter(*laws, random, sizes, half, places, drawn, NEVER)
            room = filled - largest < 0.384 * (1.0 - largest) and radii[:2].sum() < 1.5 * half
            (fitting if room else others)[filled] = placed
    assert fitting
    assert all(placed for filled, placed in fitting.items() if filled < MOST_FILLED - 0.05)
    assert not any(placed for filled, placed in others.items() if filled > MOST_FILLED + 0.22)
