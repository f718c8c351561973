"""A study as an experiment that the run time executes."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from accuracy_rows import made_up
from path_campaigns import COLD, COLD_VARIABLES, text_of
from summary_rows import rows_of

from agglom_mpi.accuracy.command import FULL, QUICK, scene_study
from agglom_mpi.accuracy.study import (
    FEWEST_SAMPLES,
    MOVES_PER_STEP,
    BudgetedEnsemble,
    Setup,
    Study,
    StudyOptions,
    paired_difference,
    scene_error,
    with_scene,
)
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import COMPLETED, FAILED, OUTCOME, summaries
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.simulation.engines import FixedSteps
from agglom_mpi.variables import TEN, volume_fraction
from agglom_mpi.verbs.simulate import simulate

JOB = "jobs/quickstart.yaml"


def study_of(options):
    """Return the study that the command plans."""
    return next(scene_study(options))[1]


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


def test_a_setup_takes_its_samples_and_no_more(campaign):
    ensemble = BudgetedEnsemble(Setup(campaign, campaign.parameters(), 7), 1e9)
    for _ in range(6):
        ensemble.add(outcome())
        assert not ensemble.finished
    ensemble.add(outcome())
    assert ensemble.finished


def test_long_samples_end_a_setup_at_its_budget_but_not_before_the_fewest(campaign):
    setup = Setup(campaign, campaign.parameters(), 100)
    for budget, expected in ((4.5, 5), (0.1, FEWEST_SAMPLES)):
        ensemble = BudgetedEnsemble(setup, budget * MOVES_PER_STEP * 10)
        count = 0
        while not ensemble.finished:
            ensemble.add(outcome(steps=10))
            count += 1
        assert count == expected


def test_a_budget_ends_a_setup_whose_samples_come_at_once(campaign):
    setups = {"one": Setup(campaign, campaign.parameters(), 100)}
    inversion = Study(campaign, setups, 4.5 * MOVES_PER_STEP * 10).inversion(None)
    list(inversion.start())
    list(inversion.complete(0, 0, rows_of([outcome(steps=10)] * 100)))
    assert inversion.samples_used(0) == 5


def test_a_setup_that_mostly_fails_is_given_up(campaign):
    ensemble = BudgetedEnsemble(Setup(campaign, campaign.parameters(), 1000), 1e9)
    while not ensemble.finished:
        ensemble.add(outcome(state=FAILED))
    assert ensemble.samples_used == 10


def test_every_setup_of_a_study_has_its_own_number_of_samples(campaign):
    wanted = {"a": 3, "b": 5, "c": 7}
    parameters = campaign.parameters()
    setups = {name: Setup(campaign, parameters, count) for name, count in wanted.items()}
    inversion = Study(campaign, setups, 1e9).inversion(None)
    list(inversion.start())
    assert inversion.propose_ahead(4) is None
    assert [progress.max_samples for progress in inversion.open_strings.values()] == [3, 5, 7]
    for string in range(3):
        list(inversion.complete(string, 0, rows_of([outcome()] * 9)))
    assert inversion.finished
    assert [inversion.samples_used(string) for string in range(3)] == [3, 5, 7]


def test_a_study_travels_between_ranks_and_stays_the_same(campaign, tmp_path):
    study = study_of(StudyOptions((JOB,), str(tmp_path), {}, quick=True))
    again = pickle.loads(pickle.dumps(study))
    assert again.identity() == study.identity()
    assert again.table_sizes == study.table_sizes
    assert [str(setup) for setup, _ in again.kernel_cases()] == [
        str(setup) for setup, _ in study.kernel_cases()
    ]


def test_whatever_decides_samples_is_part_of_the_identity(campaign):
    parameters = campaign.parameters()
    setup = Setup(campaign, parameters, 5)
    changed = [
        setup._replace(samples=6),
        setup._replace(engine=FixedSteps(steps=7)),
        setup._replace(first_sample=1),
        setup._replace(parameters=parameters * 1.001),
        setup._replace(campaign=with_scene(campaign, particles=99)),
    ]
    studies = [Study(campaign, {"one": each}, 1e6) for each in (setup, *changed)]
    studies += [Study(campaign, {"one": setup}, 2e6), Study(campaign, {"two": setup}, 1e6)]
    assert len({study.sha256() for study in studies}) == len(studies)
    assert Study(campaign, {"one": setup}, 1e6).sha256() == studies[0].sha256()


def test_a_rank_computes_what_the_campaign_does_with_that_engine():
    campaign = load_campaign("jobs/quickstart.yaml")
    parameters = campaign.parameters()
    engine = FixedSteps(steps=20)
    setups = {"a": Setup(campaign, parameters, 3), "b": Setup(campaign, parameters, 3, engine, 40)}
    simulator = SampleRunner(Study(campaign, setups, 1e9), 0)
    tasks = np.zeros(2, task_type(10))
    tasks["string"], tasks["first"], tasks["count"] = [0, 1], 2, 1
    tasks["parameters"] = parameters
    plain, stepped = (done(simulator, task).results for task in tasks)
    expected = simulate(campaign, parameters, 2)
    assert plain["mean_radius_ratio"] == expected.mean_radius_ratio
    assert plain["objective"] == expected.objective
    assert (
        stepped["mean_radius_ratio"]
        == simulate(campaign, parameters, 42, engine).record["mean_radius_ratio"]
    )


def test_samples_of_a_study_are_enough_for_every_section(tmp_path):
    for quick in (True, False):
        setups = study_of(StudyOptions((JOB,), str(tmp_path), {}, quick=quick)).setups
        samples, pool, *_ = QUICK if quick else FULL
        assert setups["event"].samples == pool
        assert {setup.samples for name, setup in setups.items() if name != "event"} == {samples}
        assert samples >= FEWEST_SAMPLES


def test_two_scenes_at_a_time_are_refused():
    with pytest.raises(CampaignError, match=r"accretion_2003.yaml: SOURCE: is a second file"):
        study_of(StudyOptions((JOB, "jobs/accretion_2003.yaml"), "x", {}))


def test_a_directory_without_scenes_is_refused(tmp_path):
    with pytest.raises(CampaignError, match="is a directory without any scene"):
        study_of(StudyOptions((str(tmp_path),), "x", {}))


def test_a_scene_that_cannot_be_simulated_is_refused_before_anything_runs(campaign):
    settings = {"activation_energy": 1e9}
    assert "U/(R theta)" in scene_error(Setup(campaign, campaign.parameters(settings), 1))
    with pytest.raises(CampaignError, match=r"quickstart.yaml: scene: .*U/\(R theta\)"):
        study_of(StudyOptions((JOB,), "x", settings))


def test_a_scene_that_is_not_searched_can_be_studied_too(tmp_path):
    text = Path(JOB).read_text().partition("objective:")[0]
    for name, value in (("relative_speed", 5), ("size_ratio", 0.6), ("hardness", 1e8)):
        text = re.sub(rf"{name}: \[[^]]*\]", f"{name}: {value}", text)
    (tmp_path / "scene.yaml").write_text(text)
    study = study_of(StudyOptions((str(tmp_path / "scene.yaml"),), str(tmp_path), {}, quick=True))
    task = np.zeros(1, task_type(10))
    task["count"], task["parameters"] = 1, study.setups["event"].parameters
    message = done(SampleRunner(study, 0), task[0])
    assert (len(message.failures), message.final_particles, message.frames) == (0, None, ())
    assert message.results["state"].tolist() == [COMPLETED]
    ensemble = BudgetedEnsemble(study.setups["event"], 1e9)
    ensemble.add(outcome())
    assert ensemble.result().mean_radius_ratio == 2.0


def test_paired_differences_cancel_what_samples_share():
    shared = np.random.default_rng(1).normal(size=50)
    difference = paired_difference(
        made_up(2.0 + shared + 0.25), made_up(2.0 + shared), "mean_radius_ratio"
    )
    assert difference.value == pytest.approx(0.25, rel=1e-13)
    assert difference.error < 1e-15


def test_samples_that_failed_on_either_side_have_no_pair():
    ours = made_up([1.0, 2.0, 3.0, 4.0], failed=[1])
    theirs = made_up([0.5, 0.0, 0.0, 3.0, 9.0], failed=[2])
    difference = paired_difference(ours, theirs, "mean_radius_ratio")
    assert (difference.value, difference.samples) == (0.75, 2)


def test_a_long_reference_is_no_mismatch():
    difference = paired_difference(made_up([1.0, 1.0]), made_up([0.0] * 9), "mean_radius_ratio")
    assert difference.samples == 2


def test_a_study_has_the_numbers_of_its_string_in_its_scene(tmp_path):
    """Its set-ups are of the ten variables alone, whatever numbers campaigns search."""
    scene = {**COLD, "restitution": "constant", "sizes": "lognormal"}
    numbers = {"restitution.value": "[0.2, 0.8]", "sizes.spread": "[1.1, 1.3]"}
    fraction = {"size_ratio": None, "volume_fraction": "[0.05, 0.2]"}
    (tmp_path / "paths.yaml").write_text(text_of(scene, COLD_VARIABLES | numbers | fraction))
    settings = {"restitution.value": 0.5, "volume_fraction": 0.1}
    options = StudyOptions([str(tmp_path / "paths.yaml")], out=str(tmp_path), settings=settings)
    study = study_of(options._replace(quick=True))
    setup = study.setups["event"]
    section, values = setup.campaign.at(setup.parameters)
    assert section.restitution.value == 0.5
    assert section.sizes.spread == pytest.approx(1.2)
    assert study.variables == TEN
    fraction = volume_fraction(values["size_ratio"], section.third_moment)
    assert fraction == pytest.approx(0.1)
    assert all(each.parameters.shape == (TEN.count,) for each in study.setups.values())
    assert dict(setup.identity())["scene.sizes"] is not None
