"""What may be given to a box, and what is refused, in one message."""

import math

import numpy as np
import pytest
from box_runs import BREAKING, GAS
from plain_python import PLAIN_ALONE, cases
from scenes import HALF, image
from scipy import stats

from agglom_mpi import Box
from agglom_mpi.config.yaml_source import CampaignError

PAIR = [[0.0, 0.0, 0.0], [0.004, 0.0, 0.0]]

pytestmark = PLAIN_ALONE


def test_a_box_lists_its_public_names():
    names = {"advance", "particles", "reset", "set", "state", "time", "volume"}
    assert set(dir(Box(GAS))) == names == set(dir(Box))


def test_distributions_are_drawn_the_same_for_the_same_sample():
    sizes = stats.lognorm(0.3, scale=5e-4)
    given = {
        "radii": sizes,
        "velocities": stats.norm(0.0, 2.0),
        "temperatures": lambda random, n: random.uniform(300.0, 400.0, n),
        "particles": 400,
    }
    first, again, other = (Box(GAS, **given, sample=k).particles for k in (1, 1, 2))
    for one, same, another in zip(first[:5], again[:5], other[:5], strict=True):
        assert one.tobytes() == same.tobytes() != another.tobytes()
    # Kolmogorov and Smirnov's test fails one time in ten thousand
    assert stats.kstest(first.radii, sizes.cdf).pvalue > 1e-4
    assert stats.kstest(first.velocities.ravel(), stats.norm(0.0, 2.0).cdf).pvalue > 1e-4
    assert stats.kstest(first.temperatures, stats.uniform(300, 100).cdf).pvalue > 1e-4
    np.testing.assert_allclose(first.masses, 2500 * 4 / 3 * np.pi * first.radii**3, rtol=1e-13)


@pytest.mark.parametrize("sample", [-1, 1.5, True, "1"])
def test_the_number_of_a_sample_is_a_whole_number(sample):
    with pytest.raises(ValueError, match=r"sample: is .*; must be a whole number of at least 0"):
        Box(GAS, sample=sample)


def test_spheres_of_different_sizes_are_placed_apart():
    rows = Box(GAS, radii=stats.uniform(2e-4, 1e-3), particles=400).particles
    for i in range(399):
        away = image(rows.positions[i + 1 :] - rows.positions[i], True)
        reach = rows.radii[i] + rows.radii[i + 1 :]
        assert np.all(np.linalg.norm(away, axis=1) >= reach * (1.0 - 1e-12))
    assert np.all(np.abs(rows.positions) <= HALF)


def test_two_spheres_that_are_given_meet_when_they_must():
    box = Box(GAS, radii=1e-3, positions=PAIR, velocities=[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert box.advance(0.00199).collisions == 0
    assert box.advance(0.00002).collisions == 1
    np.testing.assert_allclose(box.particles.velocities[:, 0], [0.1, 0.9], atol=1e-15)
    # e = 0.8: a pair of equals loses a quarter of m w² times 1 − e²
    mass = box.particles.masses[0]
    assert box.state.dissipation_rate * 2e-5 * box.volume == pytest.approx(0.09 * mass, rel=1e-9)


def test_aggregates_are_given_with_their_grains():
    rows = Box(BREAKING, radii=[5e-4, 1e-3], grains=[1, 8], positions=PAIR).particles
    np.testing.assert_array_equal(rows.grains, [1, 8])
    assert rows.masses[1] == pytest.approx(8.0 * rows.masses[0])


REFUSED = {
    "radii[1] is -0.001 m; must be greater than 0": {"radii": [1e-3, -1e-3]},
    "radii[0] is 0.02 m; must be greater than 0 m and less than half_width, 0.01 m": {
        "radii": 0.02
    },
    "radii[1] is nan m; must be finite": {"radii": [1e-3, np.nan]},
    "radii are 'large'; must be numbers in m": {"radii": "large"},
    "velocities have the shape (200, 2); must be (200, 3), or 3 numbers for all": {
        "velocities": np.zeros((200, 2))
    },
    "velocities[1, 2] is inf m/s; must be finite": {
        "velocities": [[0.0, 0.0, 0.0], [0.0, 0.0, np.inf]]
    },
    "temperatures[0] is -1 K; must be at least 0 K": {"temperatures": -1.0},
    "temperatures are for 3 particles, but radii for 2": {
        "radii": [1e-3, 1e-3],
        "temperatures": [300, 300, 300],
    },
    "temperatures are for 3 particles, but the scene is for 200; must be for as many, or give "
    "particles=3": {"temperatures": [300, 310, 320]},
    "temperatures are for 1 particle, but velocities for 2": {
        "temperatures": [300],
        "velocities": np.zeros((2, 3)),
    },
    "radii are for 2 particles, but particles for 5": {"radii": [1e-3, 1e-3], "particles": 5},
    "particles is 0; must be a whole number of at least 1": {"particles": 0},
    "positions[0, 1] is 0.011 m; must be from -0.01 to 0.01 m": {
        "positions": [[0, 0.011, 0], [0, 0, 0]]
    },
    "positions 0 and 1 overlap by 0.001 m; must not overlap": {
        "radii": 2.5e-3,
        "positions": PAIR,
    },
    "grains are [0, 1]; must be 2 whole numbers of at least 1": {
        "grains": [0, 1],
        "positions": PAIR,
    },
    "radii fill 0.943 of the box with 900 spheres": {"radii": 1.26e-3, "particles": 900},
}


@pytest.mark.parametrize(
    "message", cases(REFUSED, [m for m in REFUSED if "fill" not in m], pytest.mark.slow)
)
def test_what_cannot_be_is_refused_by_name_value_and_what_is_allowed(message):
    with pytest.raises(ValueError, match=r"must be|must not") as error:
        Box(GAS, **REFUSED[message])
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_the_number_of_particles_may_be_said_beside_the_temperatures():
    box = Box(GAS, temperatures=[300, 310, 320], particles=3)
    assert box.particles.temperatures.tolist() == [300, 310, 320]


def test_a_box_without_temperature_has_no_mean_temperature():
    assert math.isnan(Box(GAS).state.mean_temperature)
    warm = Box(GAS, temperatures=[300, 310, 320], particles=3)
    assert warm.state.mean_temperature == pytest.approx(310.0)


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf, "1 s", True, None])
def test_a_step_is_a_positive_time(dt):
    box = Box(GAS)
    with pytest.raises(ValueError, match=r"^dt is .*; must be .*greater than 0$"):
        box.advance(dt)
    assert box.time == 0.0


def test_what_is_set_is_checked_and_leaves_the_box_as_it_was():
    box = Box(GAS)
    box.advance(0.001)
    before = box.particles
    with pytest.raises(ValueError, match=r"velocities have the shape \(7, 3\); must be \(200, 3\)"):
        box.set(velocities=np.zeros((7, 3)))
    with pytest.raises(ValueError, match=r"temperatures\[0\] is -3 K; must be at least 0 K"):
        box.set(velocities=0.0 * before.velocities, temperatures=-3.0)
    np.testing.assert_array_equal(box.particles.velocities, before.velocities)


def test_variables_of_the_campaign_are_checked_as_ever():
    with pytest.raises(CampaignError, match="densty"):
        Box(GAS, {"densty": 1.0})
