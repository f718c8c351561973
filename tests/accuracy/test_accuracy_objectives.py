"""What a study says of a campaign whose objective looks at more than mean radii."""

import numpy as np
import pytest
from accuracy_rows import frame_of, made_up
from scipy import stats

from agglom_mpi.accuracy.time_integration import steps as time_integration
from agglom_mpi.accuracy.time_integration.ensemble import ensemble_section
from agglom_mpi.accuracy.time_integration.stopping_study import OWN
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.user_function import UserFunction
from agglom_mpi.declaration.own_modules import OwnModule

TARGET = "{law: growth_target, ratio: 2}"
MOMENTS = "{law: moments, targets: {mean: 2, spread: 0.5, skewness: 0}}"
FUNCTION = "{law: function, call: 'shape:worth'}"


def campaign(objective):
    text = load_campaign("jobs/quickstart.yaml").text
    assert text.count(TARGET) == 1
    return Campaign.from_text(
        text.replace(TARGET, objective),
        user_function=UserFunction("shape:worth", OwnModule("shape.py", "0", b"")),
    )


def pool(seed, count):
    """Return rows of samples whose columns belong to radii that were drawn."""
    rng = np.random.default_rng(seed)
    rows = made_up(np.zeros(count))
    for row in rows:
        radii = 1.0 + rng.gamma(8.0, 0.15 * rng.uniform(0.8, 1.2), rng.integers(5, 30))
        row["particles"], row["mean_radius_ratio"] = len(radii), radii.mean()
        for order in (2, 3, 4):
            row[f"radius_moment_{order}"] = np.mean((radii - radii.mean()) ** order)
    rows["objective"] = rng.normal(-1.0, 0.3, count)
    return rows


@pytest.mark.parametrize("objective", [MOMENTS, FUNCTION])
def test_stopping_rules_are_studied_by_growth_and_the_campaigns_own_is_left_out(objective):
    found = ensemble_section(campaign(objective), pool(1, 60), quick=True)
    assert "the campaign's objective looks at more than mean radii" in found.setups
    assert OWN not in set(frame_of(found.tables[-1])["rule"])
    published = ensemble_section(campaign(TARGET), pool(1, 60), quick=True)
    assert "within its own limits" in published.setups
    assert OWN in set(frame_of(published.tables[-1])["rule"])


@pytest.mark.parametrize("objective", [MOMENTS, FUNCTION, TARGET])
def test_the_bias_of_an_objective_is_that_of_its_ensembles(objective):
    studied, ours, reference = campaign(objective), pool(2, 50), pool(3, 50)
    law = studied.objective
    bias = time_integration.objective_bias(studied, ours, reference)
    (value, error), (other, other_error) = law.of_rows(ours), law.of_rows(reference)
    # These samples are independent; so the paired error is that of a difference, but for the
    # chance correlation of 50 pairs, 4/sqrt(49) at most.
    assert bias.value == pytest.approx(value - other, rel=1e-9, abs=1e-12)
    independent = error**2 + other_error**2
    assert abs(bias.error**2 - independent) <= 2 * error * other_error * 4 / np.sqrt(49)
    assert bias.samples == 50


def test_a_function_is_estimated_from_what_is_stored():
    rows = pool(4, 20)
    value, error = campaign(FUNCTION).objective.of_rows(rows)
    assert value == pytest.approx(rows["objective"].mean(), rel=1e-13)
    assert error == pytest.approx(stats.sem(rows["objective"]), rel=1e-12)
