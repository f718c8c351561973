"""An estimate of a string is the mean of the samples that `simulate` gives, with its error."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from campaign_text import campaign

from agglom_mpi import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import LEDGER, OUTCOME
from agglom_mpi.search.objectives.moment_targets import FOURTH_ORDER_INTERVALS
from agglom_mpi.verbs.simulate import simulate

QUICKSTART = Path(__file__).parents[2] / "jobs" / "quickstart.yaml"
VALUES = {"hardness": "67 MPa"}


@pytest.fixture(scope="module")
def quickstart():
    return load_campaign(QUICKSTART)


@pytest.fixture(scope="module")
def estimate(quickstart):
    return quickstart.estimate(VALUES, samples=12)


@pytest.fixture(scope="module")
def outcomes(quickstart):
    return [simulate(quickstart, VALUES, sample) for sample in range(12)]


def test_an_estimate_is_the_mean_of_the_samples(estimate, outcomes):
    ratios = [outcome.mean_radius_ratio for outcome in outcomes]
    assert estimate.samples == estimate.mean_radius_ratio.samples == 12
    assert estimate.failed == 0
    assert estimate.mean_radius_ratio.value == pytest.approx(np.mean(ratios))
    error = np.std(ratios, ddof=1) / math.sqrt(12)
    assert estimate.mean_radius_ratio.error == pytest.approx(error)
    assert estimate.objective.value == pytest.approx(abs(np.mean(ratios) / 2.0 - 1.0))
    assert estimate.collisions.value == np.mean([outcome.collisions for outcome in outcomes])
    assert estimate.parameters["hardness"] == 67e6
    assert set(estimate.ledger) == set(LEDGER)


def test_an_estimate_prints_as_the_command_does(estimate):
    lines = str(estimate).splitlines()
    assert "mean ± standard error over 12 samples" in lines
    assert any(line.startswith("  mean_radius_ratio") and " ± " in line for line in lines)
    assert estimate.as_dict()["measured"]["merges"]["mean"] == estimate.merges.value


def test_one_sample_has_no_standard_error(quickstart):
    found = quickstart.estimate(VALUES, samples=1)
    assert "result of 1 sample, without a standard error" in str(found).splitlines()
    assert "±" not in str(found)
    assert "1 samples" not in str(found)
    assert found.as_dict()["objective"]["standard_error"] is None


def cold_campaign():
    """Return a campaign whose scene has no temperature."""
    return campaign(
        ("  restitution", "  restitution: {law: constant, value: 0.5}"),
        ("  heating", "  heating: none"),
        ("  hardness: a", ""),
        ("  hardness: [", ""),
        ("  friction: c", ""),
        ("  friction: 0", ""),
        ("  reaction: c", ""),
        ("  reaction_heat", ""),
        ("  heat_capacity", ""),
        ("  temperature", ""),
        ("  activation_energy", ""),
        ("  contact_area", ""),
        ("  end_time", "  end_time: 1 ms"),
        ("  engine", ""),
    )


def test_a_scene_without_temperature_has_no_mean_temperature(outcomes):
    from agglom_mpi.verbs.estimate import estimate_of

    cold = cold_campaign()
    assert "temperature" not in cold.variables.used
    found = estimate_of(cold, cold.parameters(), outcomes)
    assert (found.temperature.samples, math.isnan(found.temperature.value)) == (0, True)
    assert "temperature_K" not in str(found)
    measured = found.as_dict()["measured"]
    assert measured["temperature_K"] == {"mean": None, "standard_error": None}
    assert measured["merges"]["mean"] is not None


class Grains(NamedTuple):
    """Final particles of a kernel that kept no temperatures, and did not count grains."""

    size: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    temperature: None = None
    grains: None = None
    spin: None = None


@pytest.mark.parametrize(("heat", "known"), [(False, False), (True, True)])
def test_particles_of_a_scene_without_temperature_have_none(monkeypatch, quickstart, heat, known):
    from agglom_mpi.verbs import simulate as module

    scene = quickstart if heat else cold_campaign()
    record = np.zeros(1, OUTCOME)
    record["state"], record["mean_radius_ratio"], record["particles"] = 1, 1.5, 2

    def simulated(scene, random, frames=None, ledger=None):
        if frames is not None:
            frames.particles[:] = 2
            frames.temperatures[:, :2] = scene.temperature
        return record[0], Grains(np.array([2]), np.ones(2), np.ones(2))

    monkeypatch.setattr(module, "simulate_scene", simulated)
    monkeypatch.setattr(module, "ensure_compiled", lambda *arguments: None)
    outcome = simulate(scene, {}, frames=3)
    assert np.isfinite(outcome.temperatures).all() == known
    assert np.isfinite(outcome.final.temperatures).all() == known
    assert outcome.frames.has_temperature == known
    assert ("temperatures=<none>" in repr(outcome)) is not known
    assert outcome.record["mean_temperature"] == 0.0  # as it is stored


def test_overlaps_are_explained_where_there_are_any(estimate):
    from dataclasses import replace

    assert "overlaps:" not in str(replace(estimate, ledger=estimate.ledger | {"overlaps": 0}))
    shown = str(replace(estimate, ledger=estimate.ledger | {"overlaps": 2})).splitlines()
    assert shown[-2] == "  overlaps              2"
    assert shown[-1].startswith("overlaps: pairs of particles at the end in which an aggregate")


def test_an_outcome_prints_without_its_arrays(outcomes):
    shown = repr(outcomes[0])
    assert shown.startswith("Outcome(mean_radius_ratio=")
    assert f"radii=<{pluralise(outcomes[0].particles, 'value')}, " in shown
    assert "\n" not in shown
    assert len(shown) < 600


def test_targets_of_moments_are_told_one_by_one(outcomes, quickstart):
    from agglom_mpi.verbs.estimate import estimate_of

    wanted = "objective: {law: moments, targets: {mean: 2, spread: 0.4}, weights: {spread: 2}}"
    moments = campaign(("objective", wanted))
    found = estimate_of(moments, quickstart.parameters(VALUES), outcomes)
    mean, spread = found.moments
    assert (mean.name, mean.target, spread.name, spread.weight) == ("mean", 2.0, "spread", 2.0)
    assert mean.value == pytest.approx(found.mean_radius_ratio.value, rel=1e-14)
    assert mean.error == pytest.approx(found.mean_radius_ratio.error)
    assert spread.error > 0.0
    assert mean.miss + spread.miss == pytest.approx(found.objective.value)
    assert spread.miss == pytest.approx(2.0 * abs(spread.value / 0.4 - 1.0))
    assert "  spread" in str(found).partition("targets\n")[2].splitlines()[1]
    assert found.as_dict()["moments"]["spread"]["target"] == 0.4


@pytest.mark.parametrize(("name", "noted"), [("kurtosis", True), ("spread", False)])
def test_a_kurtosis_is_shown_with_how_far_its_error_can_be_trusted(
    outcomes, quickstart, name, noted
):
    from agglom_mpi.verbs.estimate import estimate_of

    wanted = f"objective: {{law: moments, targets: {{mean: 2, {name}: 3}}}}"
    found = estimate_of(campaign(("objective", wanted)), quickstart.parameters(VALUES), outcomes)
    assert (FOURTH_ORDER_INTERVALS in str(found).splitlines()) is noted


@pytest.mark.parametrize("samples", [0, -1, 2.5, True, "many"])
def test_a_number_of_samples_is_a_whole_number(quickstart, samples):
    with pytest.raises(CampaignError, match=r"samples: is .*; must be a whole number"):
        quickstart.estimate(VALUES, samples)
