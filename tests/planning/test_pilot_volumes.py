"""How many grains a plan advises: by the shift against the error that the answer will have."""

import numpy as np
import pytest

from agglom_mpi.analysis.extrapolation import extrapolated
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.planning import pilot as module
from agglom_mpi.planning.pilot import GrainAdvice, advise_grains, run_pilot
from agglom_mpi.statistics import MeanEstimate

GRAINS = (100, 200, 400)


def advice(slope, spread, answer):
    means = [MeanEstimate(1.8 + slope / n, spread, 100) for n in GRAINS]
    return GrainAdvice(100, 100, extrapolated(GRAINS, means), answer, 50)


def test_a_resolved_shift_above_the_error_asks_for_more_grains():
    found = advice(8.0, 1e-4, 0.02)
    assert found.exceeds
    assert found.enough == pytest.approx(400, abs=10)
    assert "take" in found.text


@pytest.mark.parametrize(("spread", "answer"), [(0.5, 0.02), (1e-4, 0.2)])
def test_a_shift_that_is_not_resolved_or_within_the_error_keeps_the_grains(spread, answer):
    found = advice(8.0, spread, answer)
    assert not found.exceeds
    assert found.enough == 100
    assert found.as_dict()["enough_grains"] == 100


def test_the_best_pilot_string_is_simulated_in_each_volume(monkeypatch):
    monkeypatch.setattr(module, "MAX_ROUNDS", 2)
    campaign = load_campaign("jobs/quickstart.yaml")
    pilot = run_pilot(campaign, 0.5, lambda line: None)
    found = advise_grains(campaign, pilot, 600.0, lambda line: None)
    assert found is not None
    assert found.samples == 2 * module.ROUND
    assert found.grains == campaign.scene.particles
    assert np.isfinite([*found.fit.limit, *found.fit.shift, found.error]).all()


def test_the_largest_volume_is_left_out_where_it_has_too_many_grains(monkeypatch):
    monkeypatch.setattr(module, "MAX_ROUNDS", 1)
    monkeypatch.setattr(module, "MAX_PARTICLES", 399)
    campaign = load_campaign("jobs/quickstart.yaml")
    pilot = run_pilot(campaign, 0.5, lambda line: None)
    found = advise_grains(campaign, pilot, 600.0, lambda line: None)
    assert found is not None
    assert found.volumes == (1, 2)
    assert found.as_dict()["largest_grains"] == 200
    assert np.isfinite([*found.fit.shift, found.error]).all()


def test_nothing_is_advised_where_there_are_too_many_grains(monkeypatch):
    monkeypatch.setattr(module, "MAX_PARTICLES", 199)
    campaign = load_campaign("jobs/quickstart.yaml")
    assert advise_grains(campaign, None, 1.0, lambda line: None) is None
