"""What the section on time steps concludes from samples that are made up."""

import numpy as np
import pytest
from accuracy_rows import made_up

from agglom_mpi.accuracy import time_integration as module
from agglom_mpi.accuracy.document import Section
from agglom_mpi.accuracy.study import paired_difference
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.formatting import format_seconds

COUNT = 400


@pytest.fixture(scope="module")
def campaign():
    return load_campaign("jobs/quickstart.yaml")


def section(campaign, bias, noise=1e-3, seconds=1e-3, **extra) -> Section:
    """Section of steppers whose growth is 2 + bias(shortest step over the end time) + noise."""
    parameters = campaign.parameters()
    random = np.random.default_rng(5)
    shared = 2.0 + 0.3 * random.normal(size=COUNT)
    samples = {module.EVENT: made_up(shared, seconds)}
    end_time = module.end_time_of(campaign, parameters)
    for stepper in module.steppers(end_time, quick=False):
        own = shared + bias(stepper.step / end_time) + noise * random.normal(size=COUNT)
        cost = seconds * (0.1 + 1e-3 * end_time / stepper.step)
        samples[module.name_of(stepper)] = made_up(own, cost, **extra)
    return module.time_integration_section(campaign, parameters, samples, quick=False)


def test_every_setup_is_on_the_samples_of_the_event_engine(campaign):
    setups = module.setups(campaign, campaign.parameters(), 7, quick=False)
    assert len(setups) == 1 + len(module.STEPS) + len(module.CAPS) * len(module.FLOORS)
    assert {setup.first_sample for setup in setups.values()} == {0}
    assert len({setup.parameters.tobytes() for setup in setups.values()}) == 1
    assert {setup.campaign.seed for setup in setups.values()} == {campaign.seed}


def test_a_bias_of_first_order_reaches_each_tolerance_where_it_should(campaign):
    # 2 + 10 h/T: within 1 % of 2 (0.02, bound 0.02 + noise) from 1000 steps on, 0.2 % from 5000.
    found = section(campaign, lambda share: 10.0 * share, noise=1e-6)
    frame = found.tables[0].frame
    fixed = frame[frame["method"] == "fixed"]
    growth = 2.0
    shares = 1.0 / np.array(module.STEPS)
    assert np.allclose(fixed["bias of b/b0"], 10.0 * shares, atol=1e-6)
    assert np.allclose(fixed["relative bias"], 10.0 * shares / growth, rtol=0.03)
    at_one_percent = next(text for text in found.conclusions if text.startswith("At 1 %"))
    assert "fixed 1.1 ms (steps of" in at_one_percent
    at_two_permille = next(text for text in found.conclusions if text.startswith("At 0.2 %"))
    assert "fixed 5.1 ms (steps of" in at_two_permille


def test_a_bias_that_no_step_removes_is_said_not_to_reach(campaign):
    found = section(campaign, lambda share: 0.06)
    assert "fixed does not reach it" in found.conclusions[1]
    assert "adaptive, steps to 1000 × the floor does not reach it" in found.conclusions[1]


def test_a_coarse_step_that_is_right_by_accident_does_not_count(campaign):
    found = section(campaign, lambda share: 0.0 if share > 0.015 else (0.2 if share > 3e-3 else 0))
    at_one_percent = found.conclusions[1]
    end_time = module.end_time_of(campaign, campaign.parameters())
    assert f"fixed {format_seconds(1e-3 * 0.6)} (steps of {end_time / 500:.2g} s)" in at_one_percent


def test_noise_is_not_taken_for_accuracy(campaign):
    found = section(campaign, lambda share: 0.0, noise=1.0)
    assert "fixed is not shown to reach it" in found.conclusions[1]


def test_failed_samples_and_overlaps_are_reported(campaign):
    found = section(campaign, lambda share: 0.0, failed=[3, 4], overlaps=2)
    assert any("2 of 400 samples failed" in text for text in found.failures)
    assert any("fixed leaves up to 2 overlapping pairs" in text for text in found.failures)


def test_the_coverage_of_the_bias_interval_is_95_percent(campaign):
    covered = 0
    random = np.random.default_rng(11)
    repetitions = 2000
    for _ in range(repetitions):
        shared = random.normal(size=20)
        own = shared + 0.1 + 0.5 * random.normal(size=20)
        bias = paired_difference(made_up(own), made_up(shared), "mean_radius_ratio")
        covered += abs(bias.value - 0.1) <= bias.half_width
    error = np.sqrt(0.95 * 0.05 / repetitions)
    assert abs(covered / repetitions - 0.95) <= 4.0 * error
