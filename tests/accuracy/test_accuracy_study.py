"""A study as work for the farm."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from summary_rows import rows_of

from agglom_mpi.accuracy import plan as planning
from agglom_mpi.accuracy.plan import Options, make_plan
from agglom_mpi.accuracy.study import FEWEST, Study
from agglom_mpi.accuracy.trials import MOVES_PER_STEP, Quota, Trial, refusal, with_scene
from agglom_mpi.config.campaign import load_campaign
from agglom_mpi.config.scene import FixedEngine
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import COMPLETED, FAILED, OUTCOME, summaries
from agglom_mpi.runtime.sample_runner import SampleRunner
from agglom_mpi.scheduling.interface import TASK

JOB = "jobs/quickstart.yaml"


@pytest.fixture(scope="module")
def campaign():
    return load_campaign(JOB)


def done(simulator, task):
    """Return what comes of one task."""
    job = simulator.begin(task)
    while job.simulate_next():
        pass
    return job.collect()


def outcome(steps=10, state=COMPLETED):
    row = np.zeros(1, OUTCOME)
    row["state"], row["steps"], row["mean_radius_ratio"], row["particles"] = state, steps, 2.0, 50
    return summaries(row)[0]


def test_a_trial_takes_its_samples_and_no_more(campaign):
    quota = Quota(Trial(campaign, campaign.parameters(), 7), 2, 1e9)
    for _ in range(6):
        quota.add(outcome())
        assert not quota.finished
    quota.add(outcome())
    assert quota.finished


def test_long_samples_end_a_trial_at_its_budget_but_not_before_the_fewest(campaign):
    trial = Trial(campaign, campaign.parameters(), 100)
    for budget, expected in ((2.5, 3), (0.1, 2)):
        quota = Quota(trial, 2, budget * MOVES_PER_STEP * 10)
        count = 0
        while not quota.finished:
            quota.add(outcome(steps=10))
            count += 1
        assert count == expected


def test_a_trial_that_mostly_fails_is_given_up(campaign):
    quota = Quota(Trial(campaign, campaign.parameters(), 1000), 2, 1e9)
    while not quota.finished:
        quota.add(outcome(state=FAILED))
    assert quota.samples_used == 10


def test_every_trial_of_a_study_has_its_own_quota(campaign):
    wanted = {"a": 3, "b": 5, "c": 7}
    parameters = campaign.parameters()
    trials = {name: Trial(campaign, parameters, count) for name, count in wanted.items()}
    inversion = Study(campaign, trials, 1e9).inversion(None)
    list(inversion.start())
    assert inversion.propose_ahead(4) is None
    assert [progress.max_samples for progress in inversion.open_strings.values()] == [3, 5, 7]
    for string in range(3):
        list(inversion.complete(string, 0, rows_of([outcome()] * 9)))
    assert inversion.finished
    assert [inversion.samples_used(string) for string in range(3)] == [3, 5, 7]


def test_a_study_travels_between_ranks_and_stays_the_same(campaign):
    study = make_plan(Options((JOB,), "x", {}, quick=True)).study
    again = pickle.loads(pickle.dumps(study))
    assert again.identity() == study.identity()
    assert again.table_sizes == study.table_sizes
    assert [str(setup) for setup, _ in again.kernel_cases()] == [
        str(setup) for setup, _ in study.kernel_cases()
    ]


def test_whatever_decides_samples_is_part_of_the_identity(campaign):
    parameters = campaign.parameters()
    trial = Trial(campaign, parameters, 5)
    changed = [
        trial._replace(samples=6),
        trial._replace(engine=FixedEngine(steps=7)),
        trial._replace(first_sample=1),
        trial._replace(parameters=parameters * 1.001),
        trial._replace(campaign=with_scene(campaign, particles=99)),
    ]
    studies = [Study(campaign, {"one": each}, 1e6) for each in (trial, *changed)]
    studies += [Study(campaign, {"one": trial}, 2e6), Study(campaign, {"two": trial}, 1e6)]
    assert len({study.sha256() for study in studies}) == len(studies)
    assert Study(campaign, {"one": trial}, 1e6).sha256() == studies[0].sha256()


def test_a_rank_computes_what_the_campaign_does_with_that_engine(campaign):
    parameters = campaign.parameters()
    engine = FixedEngine(steps=20)
    trials = {"a": Trial(campaign, parameters, 3), "b": Trial(campaign, parameters, 3, engine, 40)}
    simulator = SampleRunner(Study(campaign, trials, 1e9), 0)
    tasks = np.zeros(2, TASK)
    tasks["string"], tasks["first"], tasks["count"] = [0, 1], 2, 1
    tasks["parameters"] = parameters
    plain, stepped = (done(simulator, task).results for task in tasks)
    expected = campaign.simulate(parameters, 2)
    assert plain["mean_radius_ratio"] == expected.mean_radius_ratio
    assert plain["objective"] == expected.objective
    assert (
        stepped["mean_radius_ratio"]
        == campaign.simulate(parameters, 42, engine).record["mean_radius_ratio"]
    )


def test_samples_of_a_study_are_enough_for_every_section():
    for quick in (True, False):
        trials = make_plan(Options((JOB,), "x", {}, quick=quick)).study.trials
        extent = planning.QUICK if quick else planning.FULL
        assert trials["event"].samples == extent.pool
        assert {trial.samples for name, trial in trials.items() if name != "event"} == {
            extent.samples
        }
        assert extent.samples >= FEWEST


def test_two_scenes_at_a_time_are_refused():
    with pytest.raises(CampaignError, match=r"accretion_2003.yaml: SOURCE: is a second file"):
        make_plan(Options((JOB, "jobs/accretion_2003.yaml"), "x", {}))


def test_a_directory_without_scenes_is_refused(tmp_path):
    with pytest.raises(CampaignError, match="is a directory without any scene"):
        make_plan(Options((str(tmp_path),), "x", {}))


def test_a_scene_that_cannot_be_simulated_is_refused_before_anything_runs(campaign):
    settings = {"activation_energy": 1e9}
    assert "U/(R theta)" in refusal(Trial(campaign, campaign.parameters(settings), 1))
    with pytest.raises(CampaignError, match=r"quickstart.yaml: scene: .*U/\(R theta\)"):
        make_plan(Options((JOB,), "x", settings))


def test_a_scene_that_is_not_searched_can_be_studied_too(tmp_path):
    text = Path(JOB).read_text().partition("objective:")[0]
    for name, value in (("relative_speed", 5), ("size_ratio", 0.6), ("hardness", 1e8)):
        text = re.sub(rf"{name}: \[[^]]*\]", f"{name}: {value}", text)
    (tmp_path / "scene.yaml").write_text(text)
    study = make_plan(Options((str(tmp_path / "scene.yaml"),), "x", {}, quick=True)).study
    task = np.zeros(1, TASK)
    task["count"], task["parameters"] = 1, study.trials["event"].parameters
    message = done(SampleRunner(study, 0), task[0])
    assert (len(message.failures), message.final_particles, message.frames) == (0, None, ())
    assert message.results["state"].tolist() == [COMPLETED]
    quota = Quota(study.trials["event"], 2, 1e9)
    quota.add(outcome())
    assert quota.result().mean_radius_ratio == 2.0
