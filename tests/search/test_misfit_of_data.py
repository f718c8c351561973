"""The misfit of a string is that of all its samples together; a sample alone has none."""

import math

import numpy as np
import pytest
from measured_runs import write_measured

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.measurements.misfit import misfit
from agglom_mpi.verbs.simulate import simulate

STRING = {"relative_speed": 0.08, "volume_fraction": 0.1}
SAMPLES = 8


@pytest.fixture
def campaign(tmp_path):
    return load_campaign(write_measured(tmp_path))


def samples_of(campaign):
    return [simulate(campaign, STRING, k).measured for k in range(SAMPLES)]


def test_the_objective_is_the_misfit_of_the_pooled_samples(campaign):
    samples = samples_of(campaign)
    objective = campaign.objective_at(campaign.parameters(STRING))
    pooled = objective._known.census([sample.census for sample in samples])
    found = misfit(pooled, campaign.data)
    assert objective.of_ensemble(samples) == (found.value, found.standard_error)
    assert found.rank == sum(part.rank for part in found.parts)


def test_the_mean_diameter_of_the_censuses_is_that_of_the_samples(campaign):
    samples = samples_of(campaign)
    objective = campaign.objective_at(campaign.parameters(STRING))
    particles = np.array([sample.particles for sample in samples])
    ratios = np.array([sample.mean_radius_ratio for sample in samples])
    pooled = 100e-6 * (particles * ratios).sum() / particles.sum()
    part = objective.misfit(samples).parts[1]
    assert part.residual[0] == pytest.approx(pooled - 130e-6, abs=1e-12)


def test_a_sample_alone_has_no_objective(campaign):
    assert math.isnan(simulate(campaign, STRING, 0).objective)


def test_influence_values_have_the_mean_and_error_of_the_objective(campaign):
    samples = samples_of(campaign)
    objective = campaign.objective_at(campaign.parameters(STRING))
    value, error = objective.of_ensemble(samples)
    values = objective.influence_values(samples)
    assert values.mean() == pytest.approx(value, rel=1e-9)
    assert values.std(ddof=1) / math.sqrt(SAMPLES) == pytest.approx(error, rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("{law: misfit}", "{law: growth_target, ratio: 1.5}", "objective.law"),
        (
            "{rule: fixed, samples: 3}",
            "{rule: successive_difference, quantity: mean_radius, tolerance: 0.1, max_samples: 9}",
            "ensemble.rule",
        ),
        (
            "{law: constant, value: 0}\n  heating: none\n  end_time: 5 ms\nvariables:",
            "{law: adhesive, youngs_modulus: 1 GPa, dry: {law: constant, value: 0.9}}\n"
            "  heating: none\n  end_time: characteristic\nvariables:\n  surface_energy: 0.1",
            "data.0.time",
        ),
    ],
)
def test_what_a_misfit_cannot_be_used_with_is_refused(tmp_path, old, new, field):
    with pytest.raises(CampaignError) as caught:
        load_campaign(write_measured(tmp_path, change=(old, new)))
    assert f"{field}:" in str(caught.value)


def test_a_misfit_without_data_is_refused(tmp_path):
    path = write_measured(tmp_path)
    lines = [line for line in path.read_text().splitlines() if "quantity:" not in line]
    path.write_text("\n".join(line for line in lines if line != "data:"))
    with pytest.raises(CampaignError) as caught:
        load_campaign(path)
    assert "objective.law:" in str(caught.value)
