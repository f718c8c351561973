"""Unbiased estimates of the strings that runs have found."""

import math

import numpy as np
import pytest
from accuracy_rows import made_up
from goals import growth_target, maximum_growth

from agglom_mpi.accuracy.answer.errors import (
    BOUND_ERRORS,
    FreshSamples,
    estimate_of,
    first_fresh_sample,
    floor_of,
    fresh_setups,
    upper_bound,
)
from agglom_mpi.config.answer_study import load_answer_study
from agglom_mpi.statistics import MeanEstimate


@pytest.fixture(scope="module")
def study():
    return load_answer_study("jobs/accuracy/answer_quick.yaml")


def test_no_run_can_have_used_a_fresh_sample(study):
    first = first_fresh_sample(study)
    for setting in study.settings:
        campaign = setting.campaign
        assert campaign.final is None
        assert first >= campaign.ensemble.max_samples
    strings = [study.question.parameters(), study.question.parameters(fill="lower")]
    setups = fresh_setups(study, strings)
    assert [setup.first_sample for setup in setups.values()] == [first, first]
    assert [setup.samples for setup in setups.values()] == [study.samples] * 2


def test_strings_are_estimated_in_the_scene_of_the_question(study):
    [setup] = fresh_setups(study, [study.question.parameters()]).values()
    assert setup.campaign.scene == study.question.scene
    assert setup.engine is None


def test_other_strings_or_samples_are_another_study(study):
    def sha(strings, of):
        return FreshSamples(of, strings).sha256()

    centre, lower = (study.question.parameters(fill=fill) for fill in ("centre", "lower"))
    found = {
        sha([centre], study),
        sha([lower], study),
        sha([centre, lower], study),
        sha([lower, centre], study),
        sha([centre], study._replace(samples=study.samples + 1)),
    }
    assert len(found) == 5
    assert sha([centre], study) in found


def test_an_estimate_is_the_objective_of_the_samples():
    ratios = 2.0 + 0.1 * np.arange(20)
    value, error = growth_target(2.0).of_rows(made_up(ratios))
    assert estimate_of(growth_target(2.0), made_up(ratios)) == MeanEstimate(value, error, 20)


def test_a_string_whose_samples_fail_is_worth_nothing():
    rows = made_up(np.full(20, 2.0), failed=range(3))
    assert estimate_of(growth_target(2.0), rows).value == math.inf
    assert upper_bound(estimate_of(growth_target(2.0), rows), MeanEstimate(0.0, 0.0, 0)) == math.inf
    assert estimate_of(growth_target(2.0), made_up(np.full(20, 2.0), failed=[1])).value == 0.0


def test_the_floor_of_a_target_is_zero():
    assert floor_of(growth_target(2.0), [made_up([3.0, 3.1])]) == MeanEstimate(0.0, 0.0, 0)


def test_the_floor_of_a_maximum_is_not_the_luckiest_estimate():
    # Equal strings: the lowest of 50 estimates is 2.2 standard errors too low, the floor unbiased.
    random, strings, samples, trials = np.random.default_rng(1), 50, 40, 200
    objective = maximum_growth(1000)
    truth = 1.0 - 4.0 / 10.0
    floors, lowest = [], []
    for _ in range(trials):
        rows = [made_up(random.normal(4.0, 0.5, samples)) for _ in range(strings)]
        floors.append(floor_of(objective, rows).value - truth)
        lowest.append(min(objective.of_rows(each)[0] for each in rows) - truth)
    error = 0.05 / math.sqrt(samples / 2)
    assert abs(np.mean(floors)) < 4 * error / math.sqrt(trials)
    assert np.mean(lowest) < -4 * error / math.sqrt(trials)


def test_luck_reaches_a_target_as_rarely_as_its_bound_states():
    # A string exactly on the target: one re-estimate in twenty is within it.
    random, trials, target = np.random.default_rng(3), 2000, 0.05
    objective, inside = growth_target(2.0), 0
    for _ in range(trials):
        rows = made_up(2.0 * (1.0 + target) + random.normal(0.0, 0.2, 200))
        inside += upper_bound(estimate_of(objective, rows), MeanEstimate(0.0, 0.0, 0)) <= target
    share = inside / trials
    # Of 200 samples, t and normal quantiles differ by less than 0.001 in probability.
    assert abs(share - 0.05) < 4 * math.sqrt(0.05 * 0.95 / trials) + 0.001


def test_a_bound_lies_above_the_floor_by_its_errors():
    bound = upper_bound(MeanEstimate(0.7, 0.01, 100), MeanEstimate(0.6, 0.0, 0))
    assert bound == pytest.approx(0.1 + 0.01 * BOUND_ERRORS)


def test_kernels_are_those_of_one_scene(study):
    centre, lower = (study.question.parameters(fill=fill) for fill in ("centre", "lower"))
    [(setup, string)] = FreshSamples(study, [centre, lower]).kernel_cases()
    assert setup.campaign.scene == study.question.scene
    assert string.tobytes() == centre.tobytes()
