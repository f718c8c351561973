"""Failures that scenes at extremes have shown, each as small as it could be made."""

import json
import math

import numpy as np
import pytest
from extreme_checks import assert_sound, motion
from extreme_scenes import Drawn
from extreme_states import Arranged
from plain_python import PLAIN, cases

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.outcome import COMPLETED, FAILED, OUTCOME, FailureReason
from agglom_mpi.physics.scales import grain_mass
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.simulation.boundary import Periodic, Reentry
from agglom_mpi.simulation.collision import merged_radius
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.initial_state import EqualSizes, place_randomly
from agglom_mpi.simulation.particles import BREAKUPS, EXHAUSTED, STEPS
from agglom_mpi.simulation.sample import carry_to_end, simulate_scene

SLOW = pytest.mark.slow
HARD = 1e15
"""A hardness in Pa at which slow impacts are elastic but for 1e-9."""

SCENE = {
    "particles": 20,
    "half_width": 0.01,
    "velocities": {"law": "spread", "mean": [0.0, 0.0, 0.0], "transverse": 1.0},
    "end_time": 0.01,
    "reaction": "contact_area",
    "cooling": {
        "law": "radiation",
        "emissivity": 0.0,
        "surroundings": 0.0,
        "convection": 0.0,
        "ambient": 0.0,
        "integration": "exact",
    },
    "restitution": "pressure",
    "duration": {"law": "mean_speed", "length_ratio": 1.0},
    "contact_area": {"initial": 0.0, "final": 1.0},
    "hardness": "arrhenius",
    "escape": "periodic",
    "friction": "restitution_scaled",
    "heating": "pair_split",
    "fragmentation": "pair_energy",
    "engine": {"law": "event", "budget": 20_000},
}
VALUES = {
    "relative_speed": 1.0,
    "size_ratio": 0.6,
    "density": 5000.0,
    "temperature": 300.0,
    "heat_capacity": 500.0,
    "reaction_heat": 0.0,
    "surface_energy": 1e16,
    "friction": 0.2,
    "hardness": 1e7,
    "activation_energy": 700.0,
}


def scene_of(cooling=None, engine=None, velocities=None, **changes):
    """Return a scene of the same kind as the most general ones that are drawn."""
    section = json.loads(json.dumps(SCENE))
    section["cooling"].update(cooling or {})
    section["velocities"].update(velocities or {})
    section["engine"] = engine or section["engine"]
    section.update({key: value for key, value in changes.items() if key not in VALUES})
    values = {key: value for key, value in changes.items() if key in VALUES}
    drawn = Drawn(section, {**VALUES, **values}, 0)
    campaign = drawn.campaign()
    return campaign.scene.build(campaign.parameters()), drawn


def sample_of(**changes):
    """Return a scene, the record of its sample 0, and its particles."""
    scene, drawn = scene_of(**changes)
    campaign = drawn.campaign()
    return scene, *simulate_scene(scene, sample_stream(0, campaign.parameters(), 0))


def state_of(positions, velocities, radii, grains=None, budget=100_000, **changes):
    """Return spheres at `positions` in half-widths, to be run."""
    scene, drawn = scene_of(**changes)
    count = len(positions)
    grains = np.ones(count, np.int64) if grains is None else np.asarray(grains)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), (count,))
    scene = scene._replace(
        engine=EventDriven.Numbers(budget), particles=int(grains.sum()), radius=float(radii.min())
    )
    places = np.array(positions, dtype=float) * scene.half_width
    temperatures = np.full(count, scene.temperature)
    speeds = np.array(velocities, dtype=float)
    return Arranged(drawn, scene, "", places, speeds, radii, temperatures, grains)


# events without end


@pytest.mark.plain
def test_approaches_below_the_rounding_of_velocities_are_no_contact():
    """Two spheres touch a third, obliquely: the impulse is lost in velocities of 1 m/s each."""
    step, b = 2.0**-52, 1.0 / 16.0
    corner = [2.0 * b * x for x in (0.6, 0.8, 0.0)]
    fast, slow = [1.0 + step, 1.0, 1.0], [1.0, 1.0, 1.0]
    state = state_of(
        [[0, 0, 0], [0, 0, 0], corner, [-0.9, 0.9, 0.5]],
        [fast, fast, slow, [-3.0, -3.0, -3.0]],
        b * 0.01,
        hardness=HARD,
        end_time=1e-4,
    )
    record, particles, ledger = state.carried()
    assert record["state"] == COMPLETED
    assert ledger.counts[STEPS] < 20
    assert_sound(state.scene, state.particles(), record, particles, ledger)


@pytest.mark.parametrize(
    ("seed", "pieces"),
    [
        pytest.param(0, 100, marks=PLAIN),
        *(pytest.param(seed, 100, marks=SLOW) for seed in (1, 2)),
        *(pytest.param(seed, 300, marks=SLOW) for seed in range(3)),
    ],
)
def test_pieces_that_touch_each_other_share_a_blow_in_finitely_many_impacts(pieces, seed):
    """An aggregate breaks into pieces, packed around its centre, and is hit again and again."""
    generator = np.random.default_rng(seed)
    count, b = 13, 0.32
    positions = generator.uniform(-1.0, 1.0, (count, 3))
    positions[generator.random((count, 3)) < 0.5] = 1.0
    radii = b * 10.0 ** -generator.uniform(0.0, 2.5, count) * 0.01
    radii[0] = b * 0.01
    grains = np.ones(count, np.int64)
    grains[0] = pieces
    state = state_of(
        positions,
        generator.uniform(-1.0, 1.0, (count, 3)),
        radii,
        grains,
        hardness=HARD,
        surface_energy=1e-9,
        end_time=0.03,
    )
    record, particles, ledger = state.carried()
    assert ledger.counts[BREAKUPS] >= 1
    assert ledger.counts[EXHAUSTED] == 0
    assert_sound(state.scene, state.particles(), record, particles, ledger)


@pytest.mark.slow
def test_an_aggregate_breaks_into_two_thousand_pieces():
    state = state_of(
        [[-0.6, 0.0, 0.0], [0.6, 0.0, 0.0]],
        [[10.0, 0.1, 0.0], [-10.0, 0.0, 0.0]],
        0.003,
        [2000, 1],
        hardness=HARD,
        surface_energy=1e-12,
        end_time=3.5e-4,
    )
    record, particles, ledger = state.carried()
    assert record["breakups"] == 1
    assert record["particles"] == 2001
    assert_sound(state.scene, state.particles(), record, particles, ledger)


@pytest.mark.parametrize("budget", cases([50, 1000], [50], SLOW))
@pytest.mark.plain
def test_spheres_without_any_room_fail_at_the_budget_and_not_by_hanging(budget):
    """A chain that fills the box from face to face: no time passes between impacts."""
    count = 8
    along = (np.arange(count) + 0.5) * 2.0 / count - 1.0
    places = np.stack([along, np.zeros(count), np.zeros(count)], axis=1)
    speeds = np.stack([np.cos(np.arange(count)), np.zeros(count), np.zeros(count)], axis=1)
    state = state_of(places, speeds, 0.01 / count, hardness=1e30, budget=budget)
    record, particles, _ = state.carried()
    assert (record["state"], record["reason"]) == (FAILED, FailureReason.BUDGET_EXCEEDED)
    assert 0.0 <= record["end_time"] < state.scene.end_time
    assert np.all(np.isfinite(particles.position))
    start, end = motion(state.particles()), motion(particles)
    assert end.energy == pytest.approx(start.energy, rel=1e-9)


# heat and temperatures


@pytest.mark.plain
@pytest.mark.parametrize("speed", [1e-12, 1e-6])
def test_heat_too_small_for_a_temperature_is_in_the_ledger(speed):
    """At 1 µm/s an impact warms by 1e-15 K, and float64 has steps of 6e-14 K at 300 K."""
    hardness = VALUES["density"] * speed**2
    scene, record, particles = sample_of(
        relative_speed=speed, hardness=hardness, end_time=0.05 / speed, activation_energy=0.0
    )
    assert record["collisions"] > 10
    assert np.all(particles.temperature[: particles.size[0]] == scene.temperature)
    assert abs(record["energy_error"]) <= 1e-12


@pytest.mark.plain
@pytest.mark.parametrize("ambient", [0.0, 1e-25])
def test_the_mean_of_temperatures_is_between_them_however_far_they_fell(ambient):
    cooling = {"convection": 1e6, "ambient": ambient}
    _, record, particles = sample_of(cooling=cooling, end_time=100.0, relative_speed=0.0)
    theta = particles.temperature[: particles.size[0]]
    assert 0.0 <= theta.min() <= record["mean_temperature"] <= theta.max() <= 1e-20


@pytest.mark.plain
def test_a_merge_with_a_far_larger_sphere_leaves_it_its_own_temperature():
    """A mean of 1e6 K and 1e-3 K by mass, 1 to 1e12, keeps all digits of the small one."""
    state = state_of(
        [[0, 0, 0], [0.6, 0, 0]],
        [[0, 0, 0], [-1e-6, 0, 0]],
        [5e-3, 5e-7],
        hardness=1e-12,
        activation_energy=0.0,
        end_time=1e4,
    )
    state = state._replace(temperatures=np.array([1e-3, 1e6]))
    record, particles, ledger = state.carried()
    assert record["particles"] == 1
    mixed = (1e-3 * 1e12 + 1e6) / (1e12 + 1.0)
    assert particles.temperature[0] == pytest.approx(mixed, rel=1e-14)
    assert_sound(state.scene, state.particles(), record, particles, ledger)


@pytest.mark.plain
def test_cooling_by_steps_that_are_too_long_closes_its_ledger():
    """Euler steps swing between 0 K and far above all; what they exchange is what flows."""
    scene, record, _ = sample_of(
        engine={"law": "fixed", "steps": 20},
        cooling={"emissivity": 1.0, "surroundings": 1e5, "integration": "euler"},
        heat_capacity=1e-12,
        temperature=1.0,
    )
    assert record["floored_temperatures"] > scene.particles
    assert math.isfinite(record["mean_temperature"])
    assert abs(record["energy_error"]) <= 1e-12


# places


@kernel
def place_all(random, escape, position, sizes, half_width):
    abort = np.zeros(1, np.uint8)
    return place_randomly(random, escape, position, sizes, half_width, abort)


COUNTS = [2, 3, 5, 12, 100, 300]


@pytest.mark.parametrize(
    ("count", "escape"),
    [
        *((count, Periodic.Numbers()) for count in COUNTS),
        *(pytest.param(count, Reentry.Numbers(), marks=PLAIN) for count in COUNTS[:4]),
        *(pytest.param(count, Reentry.Numbers(), marks=SLOW) for count in COUNTS[4:]),
    ],
)
def test_a_place_is_found_for_all_up_to_the_largest_size_ratio(count, escape):
    """Random sequential placement alone jams in nine of ten boxes of 300 there."""
    diameter = 2.0 * 0.8986 / count ** (1.0 / 3.0)
    for seed in range(5):
        position = np.full((3, count), np.nan)
        sizes = EqualSizes(diameter)
        assert place_all(np.random.default_rng(seed), escape, position, sizes, 1.0)
        assert np.all(np.abs(position) <= 1.0)
        low, high = np.triu_indices(count, 1)
        away = position[:, high] - position[:, low]
        if isinstance(escape, Periodic.Numbers):
            away -= 2.0 * np.rint(away / 2.0)
        assert np.linalg.norm(away, axis=0).min() >= diameter * (1.0 - 1e-14)


@pytest.mark.plain
def test_neighbours_stay_apart_after_a_drift_of_a_billion_boxes():
    """Two spheres touch and are at rest to each other; both are moved by the same way."""
    b = 1e-6
    state = state_of(
        [[0.1, 0.2, 0.3], [0.1 + 2.0 * b, 0.2, 0.3]],
        [[1e7, -3e6, 1.0]] * 2,
        b * 0.01,
        end_time=1.0,
    )
    record, particles, _ = state.carried()
    away = particles.position[:, 1] - particles.position[:, 0]
    away -= 0.02 * np.rint(away / 0.02)
    # The places themselves are rounded to 2⁻⁵³ of the half-width.
    np.testing.assert_allclose(away, [2.0 * b * 0.01, 0.0, 0.0], atol=1e-17)
    assert record["collisions"] == 0


# units


def campaign_of_two():
    return Drawn({**SCENE, "particles": 2}, VALUES, 0).campaign()


@kernel
def merged(first, second):
    return merged_radius(first, second)


@pytest.mark.parametrize("power", [-41, -2, -1, 1, 5, 40])
def test_the_radius_of_a_merged_sphere_is_the_same_in_any_unit_of_length(power):
    unit = 2.0**power
    for first, second in np.random.default_rng(1).uniform(0.1, 1.0, (200, 2)):
        radius = merged(first, second)
        assert merged(first * unit, second * unit) == radius * unit
        assert radius == merged(second, first)
        assert radius == pytest.approx((first**3 + second**3) ** (1.0 / 3.0), rel=1e-15)


@pytest.mark.parametrize("power", [-41, -2, -1, 1, 5, 40])
def test_the_mass_of_a_grain_is_the_same_in_any_unit_of_length(power):
    """The C library's power differs in the last digit for one of two thousand."""
    unit, scene = 2.0**power, campaign_of_two().scene
    other = scene.model_copy(update={"half_width": scene.half_width * unit})
    for size_ratio in np.random.default_rng(2).uniform(0.01, 0.8, 20_000):
        value = {"size_ratio": size_ratio, "density": 1234.5}
        mass = grain_mass(scene, value)
        assert grain_mass(other, value | {"density": 1234.5 * unit**-3}) == mass


@pytest.mark.plain
def test_an_end_time_of_zero_changes_nothing():
    state = state_of([[0.1, 0, 0], [0.5, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]], 1e-3)
    particles, out = state.particles(), np.zeros(1, OUTCOME)
    before = [None if values is None else values.copy() for values in particles]
    carry_to_end(state.scene._replace(end_time=0.0), particles, None, out)
    assert out[0]["state"] == COMPLETED
    assert out[0]["end_time"] == 0.0
    for values, old in zip(particles, before, strict=True):
        if values is not None:
            np.testing.assert_array_equal(values, old)
