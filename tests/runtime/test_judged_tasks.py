"""A task that is judged ends with the last sample that its string needs, whichever way it runs."""

import numpy as np
import pytest
from campaign_runs import SMALL, write_campaign

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import summaries
from agglom_mpi.runtime import task_runner as module
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.simulation.sample_range import new_watch

MOST = 60
BEFORE = 3
"""Samples of the string that are known already."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    numbers = SMALL | {"tolerance": 0.12, "max_samples": MOST}
    return load_campaign(write_campaign(tmp_path_factory.mktemp("judged") / "a.yaml", **numbers))


def task(campaign, judged_from=None):
    batch = np.zeros(1, task_type(10))
    batch["first"], batch["count"] = BEFORE, MOST - BEFORE
    batch["parameters"] = campaign.parameters()
    if judged_from is not None:
        batch["judged"], batch["means"] = True, judged_from.means
    return batch[0]


def begun(campaign, judged_from=None):
    runner = SampleRunner(InversionExperiment(campaign), 0)
    return runner, runner.begin(task(campaign, judged_from))


def result(job):
    while job.simulate_next():
        pass
    return job.collect()


@pytest.fixture(scope="module")
def known(campaign):
    """The first samples of the string, and an ensemble of them."""
    first = task(campaign)
    first["first"], first["count"] = 0, BEFORE
    runner = SampleRunner(InversionExperiment(campaign), 0)
    rows = result(runner.begin(first)).results
    ensemble = Ensemble(campaign.ensemble, campaign.objective, campaign.scene.particles)
    for summary in summaries(rows):
        ensemble.add(summary)
    assert not ensemble.finished
    return ensemble


@pytest.fixture(scope="module")
def wanted(campaign, known):
    """The samples that the ensemble uses of those that follow."""
    ensemble = Ensemble(campaign.ensemble, campaign.objective, campaign.scene.particles)
    ensemble.follow(known.means, converged=False)
    rows = result(begun(campaign)[1]).results
    for summary in summaries(rows):
        if not ensemble.finished:
            ensemble.add(summary)
    assert BEFORE < ensemble.samples_used < MOST
    return rows[: ensemble.samples_used - BEFORE]


@pytest.mark.parametrize("at_once", [module.MAX_AT_ONCE, 7, 1])
def test_it_ends_where_the_ensemble_does(campaign, known, wanted, monkeypatch, at_once):
    monkeypatch.setattr(module, "MAX_AT_ONCE", at_once)
    message = result(begun(campaign, known)[1])
    assert message.results["mean_radius_ratio"].tobytes() == wanted["mean_radius_ratio"].tobytes()
    part = message.parts[["first", "size", "left_out"]].tolist()
    assert part == [(BEFORE, len(wanted), True)]


def test_after_a_sample_that_took_too_long_it_goes_on(campaign, known, wanted, monkeypatch):
    runner, job = begun(campaign, known)
    late = iter([True])
    end = runner.abort_flag.end
    monkeypatch.setattr(module, "MAX_AT_ONCE", 1)
    monkeypatch.setattr(runner.abort_flag, "end", lambda: (next(late, False), end()[1]))
    runner.abort_flag.max_seconds = 1.0
    message = result(job)
    assert len(message.results) == MOST - BEFORE
    assert message.parts["left_out"].tolist() == [0]


def test_without_a_judge_nothing_is_left_out():
    assert not new_watch(np.zeros(1, np.uint8)).judge.state["asked"][0]
