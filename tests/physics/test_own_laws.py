"""The laws of jobs/own_laws, the worked example of the pages: closed forms, limits, and a run."""

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from campaign_runs import finish
from contact_pairs import contact_pair
from scipy.integrate import solve_ivp

import agglom_mpi
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.declaration.own_modules import OwnModule, executed
from agglom_mpi.physics.cooling import cooling_rate, exact_temperature
from agglom_mpi.physics.friction import friction_loss, impulse_slopes, tangential_impulse
from agglom_mpi.physics.restitution import solve_restitution
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.estimate import estimate
from agglom_mpi.verbs.simulate import simulate

JOB = Path(__file__).parents[2] / "jobs" / "own_laws"
PAGE = Path(agglom_mpi.__file__).parent / "physics" / "README.md"
DECADES = 10.0 ** np.arange(-6.0, 7.0)


@pytest.fixture(scope="module")
def laws():
    """The executed module."""
    return executed(OwnModule.of("laws.py", (JOB / "laws.py").read_bytes()))


def test_the_page_on_adding_a_law_shows_the_law_of_the_module():
    (shown,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    (law,) = re.findall(r"class SpeedRestitution.*?(?=\n\n\n)", (JOB / "laws.py").read_text(), re.S)
    assert law in shown


def test_a_fully_plastic_contact_loses_speed_by_its_fourth_root(laws):
    law = laws.SpeedRestitution.Numbers(1.0)
    for speed in DECADES:
        e = 1.0 - solve_restitution(law, None, contact_pair(speed)).deficit
        assert e == pytest.approx(min(1.0, speed**-0.25), rel=1e-12, abs=1e-15)
    assert 1.0 - solve_restitution(law, None, contact_pair(16.0)).deficit == 0.5
    slower = laws.SpeedRestitution.Numbers(20.0)
    assert solve_restitution(slower, None, contact_pair(16.0)).deficit == 0.0


def test_dust_sticks_up_to_a_speed_and_loses_the_energy_of_it_above(laws):
    law = laws.DustSticking.Numbers(0.3)
    for speed in 0.3 * DECADES:
        solution = solve_restitution(law, None, contact_pair(speed))
        assert solution.bonds == (speed <= 0.3)
        lost = speed**2 * solution.deficit * (2.0 - solution.deficit)  # w²(1 − e²)
        assert lost == pytest.approx(min(speed, 0.3) ** 2, rel=1e-9)
    just = solve_restitution(law, None, contact_pair(0.3 * (1.0 + 1e-12)))
    assert not just.bonds
    assert just.deficit == pytest.approx(1.0, abs=2e-6)


@pytest.mark.parametrize("rolling", [-1.0, 0.0, 0.44, 1.0])
@pytest.mark.parametrize("friction", [0.0, 0.05, 1.0, 10.0])
def test_a_contact_slides_or_rolls_and_makes_no_energy(laws, rolling, friction):
    law = laws.RollingFriction.Numbers(rolling, friction)
    for slip in DECADES:
        pair = contact_pair(1.0, slip)
        for deficit in (0.0, 0.3, 1.0):
            impulse = tangential_impulse(law, pair, deficit)
            slides = friction * pair.reduced_mass * (2.0 - deficit)
            rolls = 2.0 / 7.0 * (1.0 + rolling) * pair.reduced_mass * slip
            assert impulse == pytest.approx(min(slides, rolls), rel=1e-12)
            assert impulse <= pair.reduced_mass * slip
            assert friction_loss(pair, impulse) >= 0.0


def test_the_slopes_of_its_impulse_hold_those_of_differences(laws):
    law, step = laws.RollingFriction.Numbers(0.44, 0.2), 1e-6
    for slip in np.geomspace(0.05, 5.0, 30):
        pair = contact_pair(1.0, slip)
        lower, upper = 0.1, 0.9
        least, most = impulse_slopes(law, pair, lower, upper)
        at = np.linspace(lower, upper - step, 40)
        ends = (
            [tangential_impulse(law, pair, d) for d in at],
            [tangential_impulse(law, pair, d + step) for d in at],
        )
        slopes = np.subtract(*ends[::-1]) / step
        scale = 1e-6 * pair.reduced_mass
        assert (slopes >= least - scale).all()
        assert (slopes <= most + scale).all()


@pytest.mark.parametrize("start", [10.0, 299.9, 300.0, 300.5, 2000.0])
def test_free_convection_cools_as_its_equation_integrated(laws, start):
    law, surface, capacity = laws.FreeConvection.Numbers(40.0, 10.0, 300.0), 2e-11, 8e-12
    for time in (0.0, 1e-3, 1.0, 100.0):
        equation = solve_ivp(
            lambda _, y: [-cooling_rate(law, y[0], surface, capacity)],
            (0.0, time),
            [start],
            rtol=1e-11,
            atol=1e-11,
        )
        found = exact_temperature(law, start, surface, capacity, time)
        assert found == pytest.approx(equation.y[0, -1], rel=1e-8)
        half = exact_temperature(law, start, surface, capacity, 0.5 * time)
        twice = exact_temperature(law, half, surface, capacity, 0.5 * time)
        assert twice == pytest.approx(found, rel=1e-12)
        assert min(start, 300.0) <= found <= max(start, 300.0)


@pytest.mark.slow(guard="physics/test_own_laws.py::test_a_law_of_the_page_runs_in_a_scene")
def test_the_campaign_of_dust_searches_the_speed_below_which_it_sticks(tmp_path):
    for file in ("laws.py", "dust.yaml"):
        shutil.copy(JOB / file, tmp_path)
    text = (tmp_path / "dust.yaml").read_text()
    for old, new in (
        ("initial: 24, batch: 12", "initial: 8, batch: 4"),
        ("generations: 8", "generations: 3"),
        ("strings: 4, samples: 100", "strings: 2, samples: 10"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / "dust.yaml").write_text(text)
    campaign = load_campaign(tmp_path / "dust.yaml", allow_code=True)
    described = campaign.describe()
    for own in ("DustSticking", "RollingFriction", "FreeConvection"):
        assert f"laws.py:{own} " in described
    slow, fast = ({"restitution.sticking": s, "relative_speed": 1.0} for s in (0.1, 10.0))
    few, many = (estimate(campaign, string, samples=5) for string in (slow, fast))
    assert few.mean_radius_ratio.value + 1.0 < many.mean_radius_ratio.value
    outcome = simulate(campaign, slow)
    assert abs(outcome.ledger["momentum_error"]) < 1e-12
    assert abs(outcome.ledger["energy_error"]) < 1e-9
    assert outcome.merges == 200 - outcome.particles
    assert math.isclose(outcome.temperatures.min(), 300.0, abs_tol=200.0)
    finish(tmp_path, "dust.yaml", "--allow-code")
    data = read_campaign(tmp_path / "dust.h5")
    assert np.isfinite(data.result_rows()["objective"]).sum() == 12
    assert (data.string_rows()["restitution.sticking"] >= 0.1).all()


def test_a_law_of_the_page_runs_in_a_scene(tmp_path):
    shutil.copy(JOB / "laws.py", tmp_path)
    (tmp_path / "plastic.yaml").write_text("""
seed: 1
scene:
  particles: 20
  half_width: 1 cm
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: "laws.py:SpeedRestitution", speed: 10 cm/s}
  heating: none
  end_time: 20 ms
variables: {relative_speed: 5, size_ratio: 0.5, density: 2500}
""")
    campaign = load_campaign(tmp_path / "plastic.yaml", allow_code=True)
    assert "fourth root" in campaign.describe()
    outcome = simulate(campaign, {})
    assert outcome.collisions > 3
    assert outcome.merges == 0
    assert outcome.record["momentum_error"] < 1e-12
