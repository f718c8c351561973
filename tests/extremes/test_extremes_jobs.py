"""Every scene in jobs/extremes is sound, and does what it is about."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from plain_python import PLAIN

from agglom_mpi import load_campaign
from agglom_mpi.cli import main
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.physics.constants import GAS_CONSTANT, STEFAN_BOLTZMANN
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.simulation.impact import solve_impact
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.variables import volume_fraction
from agglom_mpi.verbs.simulate import simulate

SCENES = sorted((Path(__file__).parents[2] / "jobs" / "extremes").glob("*.yaml"))
NAMES = [path.stem for path in SCENES]
SAMPLES = 3
TRANSIENT = {"thousand_pieces", "coarse_steps"}
"""Scenes in which many spheres overlap at the end, in heaps that move apart."""
NEIGHBOURS = 12
"""Number of equal spheres that can touch one."""

IN_PLAIN_PYTHON = {
    "at_rest", "cold", "fold", "hot", "kilometres", "nanometres", "no_time", "soft",
    "strong_softening", "thermal_runaway", "two_particles", "zero_initial_contact_area",
}  # fmt: skip
"""Small ones of the type of `jobs/accretion_2003.yaml`."""
LONG = {"coarse_steps", "creeping", "hard", "very_dilute"}
ROUGH = {"perfectly_rough", "spinning_tops", "spinning_plastic"}
SHEARED = {"sheared_fast", "sheared_slowly", "sheared_binder"}
RARE = (
    {"adhesive_kilometres", "adhesive_nanometres", "collapse", "viscous_binder"} | ROUGH | SHEARED
)
"""Of laws that no other quick test compiles; `tests/physics` has their formulas."""

tested: set[str] = set()


def marks_of(name):
    return [PLAIN] * (name in IN_PLAIN_PYTHON) + [pytest.mark.slow] * (name in LONG | RARE)


def about(*names):
    """Note that a test is about these scenes, and mark it as they are."""
    tested.update(names)

    def mark(test):
        for each in marks_of(names[0]):
            test = each(test)
        return test

    return mark


@cache
def campaign(name):
    return load_campaign(next(path for path in SCENES if path.stem == name))


@cache
def outcomes(name, samples=None):
    samples = samples or (1 if name == "elastic" else SAMPLES)
    return [simulate(campaign(name), {}, sample) for sample in range(samples)]


def simulated(name, samples=SAMPLES, **changes):
    """Simulate a scene with some entries of its section changed."""
    scene = campaign(name).scene.model_copy(update=changes)
    return [simulate(replace(campaign(name), scene=scene), {}, n) for n in range(samples)]


def total(name, quantity):
    return sum(getattr(outcome, quantity) for outcome in outcomes(name))


@cache
def built(name):
    return campaign(name).scene.build(campaign(name).parameters())


def head_on(name, speed, laws=None):
    """Let two grains of a scene meet head-on with an approach speed in m/s."""
    scene = built(name)
    theta = scene.temperature
    pair = ContactPair(
        speed, 0.0, scene.mass, scene.mass, 0.5 * scene.mass, *[scene.radius] * 3, theta, theta,
        speed, 0.0, 0.0, 0.0,
    )  # fmt: skip
    return solve_impact(laws or scene.laws, pair)


def exponent(name):
    """U/(R theta) at the start."""
    values = campaign(name).variables.fixed
    return values["activation_energy"] / (GAS_CONSTANT * values["temperature"])


@pytest.mark.parametrize("path", SCENES, ids=NAMES)
def test_every_extreme_is_a_valid_scene_that_says_what_it_is(path):
    done = CliRunner().invoke(main, ["check", str(path)])
    assert done.exit_code == 0
    assert all(line.startswith(f"warning: {path}:") for line in done.stderr.splitlines())
    assert "a scene: nothing is searched" in done.stdout
    text = path.read_text()
    assert text.startswith("# ")
    assert "Expected:" in " ".join(text.partition("title:")[0].split())


@pytest.mark.parametrize("name", [pytest.param(n, marks=marks_of(n)) for n in NAMES])
def test_samples_of_every_extreme_are_sound(name):
    for outcome in outcomes(name):
        assert outcome.record["state"] == COMPLETED
        assert all(math.isfinite(value) for value in outcome.record.item())
        if built(name).has_temperature:
            assert np.all(np.isfinite(outcome.temperatures) & (outcome.temperatures >= 0.0))
        else:
            assert np.all(np.isnan(outcome.temperatures))
        assert np.all(outcome.radii > 0.0)
        assert outcome.record["end_time"] == built(name).end_time
        assert abs(outcome.ledger["energy_error"]) <= 1e-9
        assert outcome.ledger["momentum_error"] <= 1e-12
        assert outcome.ledger["floored_temperatures"] == 0
        assert outcome.ledger["capped_iterations"] == 0
        assert outcome.ledger["largest_residual"] <= 1e-12
        # Who grows may come to overlap a neighbour that recedes; who only bounces never does.
        pairs = NEIGHBOURS * outcome.particles / 2 if name in TRANSIENT else 2
        assert outcome.ledger["overlaps"] <= (pairs if outcome.merges else 0)
        # All grains are still there, by their volume.
        assert np.sum(outcome.radii**3) == pytest.approx(built(name).particles, rel=1e-12)


# impacts


@about("zero_initial_contact_area")
def test_without_initial_contact_area_restitution_has_its_closed_form():
    name = "zero_initial_contact_area"
    laws = built(name).laws
    assert (laws.contact_area.initial, laws.hardness.activation_energy) == (0.0, 0.0)
    values = campaign(name).variables.fixed
    critical = math.sqrt(6.0 * values["hardness"] * 1e-6 / values["density"])
    for x in (1e-12, 1e-6, 0.1, 0.5, 0.9, 0.999, 1.0 - 1e-6):
        deficit = 2.0 * math.sqrt(x) / (1.0 + math.sqrt(x))
        assert head_on(name, critical * math.sqrt(x)).deficit == pytest.approx(deficit, rel=1e-12)
    assert total(name, "collisions") > 1000
    assert 0 < total(name, "merges") < total(name, "collisions")


@about("marginal_bonding")
def test_a_pair_bonds_exactly_from_the_critical_pressure_on():
    name = "marginal_bonding"
    values = campaign(name).variables.fixed
    critical = math.sqrt(6.0 * values["hardness"] / values["density"])
    for hair in (1e-13, 1e-10, 1e-6, 1e-2):
        assert head_on(name, critical * (1.0 + hair)).bonds
        below = head_on(name, critical * (1.0 - hair))
        assert not below.bonds
        assert below.deficit == pytest.approx(1.0 - hair, rel=1e-14)  # e = 1 - sqrt X  [B 4.14]
    assert 0 < total(name, "merges") < 0.2 * total(name, "collisions")


def log_ratio(name, speed, logarithm):
    """Ln r − ln d of two grains that meet head-on, from the equations of [A] alone."""
    scene, value = built(name), campaign(name).variables.fixed
    deficit = np.exp(logarithm)
    area = scene.laws.contact_area.initial + (1.0 - scene.laws.contact_area.initial) * deficit
    heat = speed**2 / 8.0 * deficit * (2.0 - deficit)
    heat += 0.75 * value["reaction_heat"] * area / (value["density"] * scene.radius)
    theta = value["temperature"] + heat / value["heat_capacity"]
    softened = value["activation_energy"] / (GAS_CONSTANT * theta)
    scale = math.log(value["density"] * speed**2 / (6.0 * value["hardness"] * 1e-6))
    return scale + np.log((2.0 - deficit) ** 2 / area) - softened - logarithm


@about("strong_softening")
def test_of_several_solutions_the_one_of_least_restitution_is_taken():
    name = "strong_softening"
    assert exponent(name) == pytest.approx(100.0, rel=1e-12)
    grid = np.linspace(0.0, -60.0, 100_001)
    several, bounces = 0, 0
    for speed in np.linspace(36.0, 60.0, 49):
        excess = log_ratio(name, speed, grid)
        roots = grid[np.flatnonzero(np.diff(np.sign(excess)))]
        impact = head_on(name, speed)
        assert impact.bonds == (excess[0] >= 0.0)
        if impact.bonds:
            several += len(roots) == 2  # bounces that bonding excludes
        else:
            bounces += 1
            assert math.log(impact.deficit) == pytest.approx(roots[0], abs=1.01 * 60.0 / 1e5)
    assert several >= 30
    assert bounces >= 10


@about("fold")
def test_at_a_fold_restitution_jumps_at_one_speed_and_is_solved_on_both_sides():
    name = "fold"
    low, high = 40.0, 49.5
    while math.nextafter(low, high) < high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if head_on(name, middle).deficit < 0.1 else (low, middle)
    before, after = head_on(name, low), head_on(name, high)
    assert before.deficit < 0.03
    assert after.deficit > 0.6
    for impact in (before, after):
        assert not impact.bonds
        assert not impact.capped
        # At the fold the equation is flat: e − G(e) vanishes to second order.
        assert impact.residual <= 1e-12


@about("soft")
def test_what_is_softer_than_any_impact_always_bonds():
    for outcome in outcomes("soft"):
        assert outcome.merges == outcome.collisions > 50


@about("hard")
def test_what_is_harder_than_any_impact_never_bonds_and_only_reacts():
    values = campaign("hard").variables.fixed
    for outcome in outcomes("hard"):
        assert outcome.merges == 0
        assert outcome.particles == 100
        radius, mass = built("hard").radius, built("hard").mass
        reaction = 2.0 * values["reaction_heat"] * 0.01 * math.pi * radius**2
        rise = outcome.collisions * reaction / (100 * mass * values["heat_capacity"])
        found = outcome.record["mean_temperature"] - values["temperature"]
        assert rise < found < 1.1 * rise
    assert 0.0 < head_on("hard", values["relative_speed"]).deficit < 1e-2


# temperatures


@about("cold")
def test_next_to_absolute_zero_slow_grains_bounce_and_fast_ones_warm_enough_to_bond():
    assert exponent("cold") == pytest.approx(1e6, rel=1e-12)
    slow = head_on("cold", 0.2)
    assert slow.deficit < 1e-90
    capacity = built("cold").mass * campaign("cold").variables.fixed["heat_capacity"]
    assert 4.0 < slow.heat_i / capacity < 4.5
    assert head_on("cold", 4.3).bonds
    for outcome in outcomes("cold"):
        assert outcome.collisions - outcome.merges > 100
        assert outcome.merges > 50
        assert outcome.temperatures.min() > 100.0


@about("hot")
def test_at_a_million_kelvin_hardness_is_its_limit():
    assert exponent("hot") == pytest.approx(1e-6, rel=1e-12)
    laws = built("hot").laws
    limit = laws._replace(hardness=ArrheniusHardness.Numbers(laws.hardness.hardness, 0.0))
    for speed in (1e-6, 1e-3, 0.1, 0.25):
        found, expected = head_on("hot", speed), head_on("hot", speed, limit)
        assert found.deficit == pytest.approx(expected.deficit, rel=2e-5)
    for outcome in outcomes("hot"):
        np.testing.assert_allclose(outcome.temperatures, 1e6, rtol=1e-2)


def time_constant(name, temperature):
    """Time constant in s of a grain that radiates, near a temperature in K."""
    scene, values = built(name), campaign(name).variables.fixed
    capacity = values["density"] * scene.radius / 3.0 * values["heat_capacity"]
    emissivity = scene.cooling.law.emissivity
    return capacity / (4.0 * STEFAN_BOLTZMANN * emissivity * temperature**3)


@about("fast_radiation")
def test_radiation_within_a_millionth_of_a_millionth_of_the_run_keeps_all_particles_at_rest():
    name = "fast_radiation"
    share = time_constant(name, 300.0) / built(name).end_time
    assert share == pytest.approx(1e-12, rel=0.1)
    for outcome in outcomes(name):
        np.testing.assert_allclose(outcome.temperatures, 300.0, rtol=1e-12)
        assert outcome.merges > 800


@about("hot_surroundings")
def test_grains_among_hot_walls_are_as_hot_at_once():
    assert built("hot_surroundings").temperature == 1e-3
    for outcome in outcomes("hot_surroundings"):
        np.testing.assert_allclose(outcome.temperatures, 1e6, rtol=1e-2)


@about("slow_radiation")
def test_radiation_that_takes_a_million_million_runs_changes_nothing_but_the_last_digits():
    name = "slow_radiation"
    share = time_constant(name, 300.0) / built(name).end_time
    assert share == pytest.approx(1e12, rel=0.1)
    dark = campaign(name).scene.cooling.model_copy(update={"emissivity": 0.0})
    short = {"end_time": 2e-4}  # before chaos magnifies the last digits
    pairs = zip(simulated(name, **short), simulated(name, cooling=dark, **short), strict=True)
    for radiant, without in pairs:
        assert radiant.merges == without.merges > 100
        np.testing.assert_allclose(radiant.temperatures, without.temperatures, rtol=1e-10)


@about("thermal_runaway")
def test_a_reaction_may_raise_a_grain_by_a_hundred_thousand_kelvin():
    name = "thermal_runaway"
    scene, values = built(name), campaign(name).variables.fixed
    heat = values["reaction_heat"] * math.pi * scene.radius**2
    assert heat / (scene.mass * values["heat_capacity"]) == pytest.approx(1e5, rel=1e-2)
    for outcome in outcomes(name):
        assert outcome.merges > 50
        assert 3e4 < outcome.record["mean_temperature"] < 1e6


# speeds


@about("at_rest", "no_time")
@pytest.mark.parametrize("name", ["at_rest", "no_time"])
def test_without_motion_or_time_nothing_happens(name):
    for outcome in outcomes(name):
        assert (outcome.collisions, outcome.steps, outcome.particles) == (0, 0, 100)
        assert np.all(outcome.radii == 1.0)
        assert np.all(outcome.temperatures == built(name).temperature)


@about("creeping")
def test_who_creeps_bounces_without_loss():
    assert head_on("creeping", 1e-12).deficit < 1e-20
    for outcome in outcomes("creeping"):
        assert outcome.merges == 0
        assert outcome.collisions > 1000


@about("hypervelocity")
def test_at_a_third_of_the_speed_of_light_everything_bonds():
    for outcome in outcomes("hypervelocity"):
        assert (outcome.merges, outcome.collisions, outcome.particles) == (999, 999, 1)
        assert outcome.mean_radius_ratio == pytest.approx(10.0, rel=1e-12)


@about("fast_mean_flow")
def test_a_mean_flow_a_million_times_the_spread_changes_no_collision():
    name = "fast_mean_flow"
    velocities = campaign(name).scene.velocities
    spread = campaign(name).variables.fixed["relative_speed"]
    assert np.linalg.norm(velocities.mean) / spread > 9e5
    still = velocities.model_copy(update={"mean": (0.0, 0.0, 0.0)})
    short = {"end_time": 5e-5}  # before chaos magnifies the digits that the start has lost
    flowing, resting = simulated(name, **short), simulated(name, velocities=still, **short)
    for fast, slow in zip(flowing, resting, strict=True):
        assert fast.merges == slow.merges > 100
        # A touch whose approach is nothing but rounding counts as a collision, too.
        assert abs(fast.collisions - slow.collisions) <= 3
        np.testing.assert_allclose(fast.radii, slow.radii, rtol=1e-13)
    whole = simulated(name, velocities=still)
    assert total(name, "steps") == pytest.approx(sum(o.steps for o in whole), rel=0.1)


# sizes


@about("nanometres", "kilometres")
def test_a_scene_is_the_same_in_nanometres_and_in_kilometres():
    parameters = campaign("nanometres").parameters()
    ends = []
    for name in ("nanometres", "kilometres"):
        record, particles = simulate_scene(built(name), sample_stream(1, parameters, 0))
        left = int(record["particles"])
        ends.append((record, particles.radius[:left] / built(name).radius, particles.temperature))
    (small, radii, theta), (large, same_radii, same_theta) = ends
    assert small["merges"] > 50
    for count in ("collisions", "merges", "steps"):
        assert small[count] == large[count]
    np.testing.assert_allclose(radii, same_radii, rtol=1e-12)
    np.testing.assert_allclose(theta[: len(radii)], same_theta[: len(radii)], rtol=1e-6)
    assert built("kilometres").radius / built("nanometres").radius == pytest.approx(1e12)


@about("mass_ratio")
def test_aggregates_come_to_weigh_hundreds_of_times_as_much_as_others():
    for outcome in outcomes("mass_ratio"):
        masses = outcome.radii**3
        assert masses.max() / masses.min() > 100.0
        assert outcome.merges == outcome.collisions


@about("very_dilute")
def test_a_gas_of_a_billionth_collides_at_the_rate_of_kinetic_theory():
    name = "very_dilute"
    values, scene = campaign(name).variables.fixed, built(name)
    assert volume_fraction(values["size_ratio"]) == pytest.approx(1e-9, rel=1e-3)
    velocities = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 100_000, 3))
    relative = values["relative_speed"] * np.mean(
        np.linalg.norm(np.diff(velocities, axis=0)[0], axis=1)
    )
    swept = 4.0 * math.pi * scene.radius**2 * relative * scene.end_time
    pairs = scene.particles * (scene.particles - 1) / 2
    expected = SAMPLES * pairs * swept / (8.0 * scene.half_width**3)
    found = total(name, "collisions")
    assert abs(found - expected) <= 4.0 * math.sqrt(expected)
    assert total(name, "steps") > 1e5 * found


@about("nearly_jammed")
def test_next_to_jamming_every_grain_finds_a_place_and_bounces():
    fraction = volume_fraction(campaign("nearly_jammed").variables.fixed["size_ratio"])
    assert 0.3795 < fraction < 0.38
    for outcome in outcomes("nearly_jammed"):
        assert outcome.particles == 100
        assert outcome.collisions > 10 * 100


# restitution


@about("elastic")
def test_a_million_elastic_collisions_keep_the_kinetic_energy():
    for outcome in outcomes("elastic"):
        assert outcome.collisions > 900_000
        assert abs(outcome.ledger["energy_error"]) <= 1e-10


@about("perfectly_plastic", "all_merge_at_once")
@pytest.mark.parametrize("name", ["perfectly_plastic", "all_merge_at_once"])
def test_what_always_bonds_ends_as_one_aggregate(name):
    grains = built(name).particles
    for outcome in outcomes(name):
        assert outcome.merges == outcome.collisions == grains - 1
        assert outcome.particles == 1
        assert outcome.radii[0] == pytest.approx(grains ** (1.0 / 3.0), rel=1e-13)


@about("collapse")
def test_collapse_ends_if_contacts_last_and_else_exhausts_the_budget():
    for outcome in outcomes("collapse"):
        assert outcome.particles == 300
        assert outcome.steps < 0.5 * 500 * 300
    lasting = campaign("collapse").scene.restitution
    restitution = ConstantRestitution(value=lasting.value)
    with pytest.raises(RuntimeError, match="sample 0 failed: budget of steps or events exceeded"):
        simulated("collapse", restitution=restitution)


# breaking


@about("always_breaking")
def test_where_surface_costs_nothing_an_aggregate_that_bounces_is_its_grains_again():
    for outcome in outcomes("always_breaking"):
        assert outcome.breakups > 300
        assert outcome.particles >= 0.98 * 500


@about("cascade")
def test_grains_bond_and_break_and_bond_again():
    for outcome in outcomes("cascade"):
        assert outcome.merges > 1.5 * 2000
        assert outcome.breakups > 1000


@about("thousand_pieces")
def test_an_aggregate_may_break_into_hundreds_of_pieces_at_once():
    """On average of its breakups, in every second sample; one in five breaks nothing."""
    assert any(pieces_of_a_breakup(sample) > 100.0 for sample in range(30))


def pieces_of_a_breakup(sample):
    outcome = simulate(campaign("thousand_pieces"), {}, sample)
    if outcome.breakups == 0:
        return 0.0
    return (outcome.particles - 5000 + outcome.merges) / outcome.breakups + 1.0


# sticking


@about("adhesive_nanometres")
def test_slow_nanograins_stick_at_every_contact():
    for outcome in outcomes("adhesive_nanometres"):
        assert outcome.merges == outcome.collisions > 50
    assert head_on("adhesive_nanometres", 1.0).bonds
    assert not head_on("adhesive_nanometres", 1e5).bonds


@about("adhesive_kilometres")
def test_adhesion_does_nothing_to_kilometres():
    for outcome in outcomes("adhesive_kilometres"):
        assert outcome.merges == 0
        assert outcome.collisions > 200
    assert head_on("adhesive_kilometres", 1.0).deficit < 1e-9
    assert head_on("adhesive_kilometres", 1e-12).bonds


@about("viscous_binder")
def test_grains_in_pitch_stick_at_any_speed():
    for outcome in outcomes("viscous_binder"):
        assert outcome.merges == outcome.collisions > 50
    assert head_on("viscous_binder", 1e6).bonds


# spins


@about("perfectly_rough")
def test_perfectly_rough_elastic_grains_come_to_equipartition():
    """Of 300 directions each, a share of energy has a standard error of √(2/300)/2, some 4 %."""
    ratios = [outcome.ledger["rotational_ratio"] for outcome in outcomes("perfectly_rough")]
    error = 2.0 * math.sqrt(2.0 / 300.0 / 2.0) / math.sqrt(len(ratios))
    assert np.mean(ratios) == pytest.approx(1.0, abs=4.0 * error)
    for outcome in outcomes("perfectly_rough"):
        assert outcome.collisions > 1000
        assert abs(outcome.ledger["energy_error"]) <= 1e-12


@about("spinning_tops")
def test_fast_spins_give_their_energy_to_the_motion():
    for outcome in outcomes("spinning_tops"):
        assert outcome.ledger["rotational_ratio"] < 10.0
        assert outcome.collisions > 100


@about("spinning_plastic")
def test_merges_leave_angular_momentum_that_no_spin_has_the_energy_for():
    for outcome in outcomes("spinning_plastic"):
        assert outcome.merges == outcome.collisions == 99
        assert 0 < outcome.ledger["spin_caps"] < 99
        assert outcome.ledger["angular_momentum_left"] > 0.0


# shear


@about("sheared_fast")
def test_a_fast_flow_heats_grains_at_rest():
    for outcome in outcomes("sheared_fast"):
        assert outcome.collisions > 1000
        assert abs(outcome.ledger["energy_error"]) <= 1e-12
        assert outcome.ledger["shear_work"] > outcome.ledger["fluctuation_energy"] > 0.0
        start = 0.5 * outcome.final.masses.sum() * 0.01**2
        assert outcome.ledger["fluctuation_energy"] > 1e6 * start


@about("sheared_slowly")
def test_a_slow_flow_does_nothing():
    """Grains that cross a face of y change by what rounding has no digits for."""
    for outcome in outcomes("sheared_slowly"):
        assert outcome.collisions > 500
        assert abs(outcome.ledger["shear_work"]) < 1e-8 * outcome.ledger["fluctuation_energy"]


@about("sheared_binder")
def test_grains_that_shear_brings_together_bond():
    for outcome in outcomes("sheared_binder"):
        assert outcome.merges == outcome.collisions > 150
        assert abs(outcome.ledger["energy_error"]) <= 1e-12
        assert outcome.ledger["momentum_error"] <= 1e-12


# few and coarse


@about("two_particles")
def test_two_grains_bond_or_go_on_bouncing():
    ends = outcomes("two_particles", samples=12)
    bonded = [outcome for outcome in ends if outcome.particles == 1]
    assert 0 < len(bonded) < 12
    for outcome in ends:
        assert outcome.merges == 2 - outcome.particles
        assert outcome.mean_radius_ratio == pytest.approx(2.0 ** (outcome.merges / 3.0), rel=1e-14)
    assert max(outcome.collisions for outcome in ends if outcome.particles == 2) > 10


@about("coarse_steps")
def test_steps_beyond_the_mean_free_time_miss_bonds_and_leave_overlaps():
    for outcome in outcomes("coarse_steps"):
        assert outcome.steps == 10
        assert outcome.ledger["overlaps"] > 10
    exact = [simulate(campaign("coarse_steps"), {}, n, engine="event") for n in range(SAMPLES)]
    assert total("coarse_steps", "merges") < 0.95 * sum(outcome.merges for outcome in exact)
    assert max(outcome.ledger["overlaps"] for outcome in exact) <= 2


def test_every_extreme_has_a_test_of_what_it_is_about():
    assert tested == set(NAMES)
