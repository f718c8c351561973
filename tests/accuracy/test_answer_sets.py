"""Errors of sets against the true one, and when a point is known to be in or out."""

import math

import numpy as np
import pytest
from accuracy_rows import made_up

from agglom_mpi.accuracy.answer.errors import FreshSamples
from agglom_mpi.accuracy.answer.runs import (
    CLEAR_ERRORS,
    ClearMembership,
    TrueSet,
    box_points,
    true_set,
)
from agglom_mpi.config.answer_study import load_answer_study
from agglom_mpi.search.stopping import EnsembleState


@pytest.fixture(scope="module")
def study():
    found = load_answer_study("jobs/accuracy/answer_doubling_in_three.yaml")
    return found._replace(points=128, samples=40)


def test_the_error_of_a_set_counts_points_that_are_wrongly_in_or_out():
    truth = TrueSet(np.array([True, True, False, False]), 0.0)
    found = np.array([[1, 1, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 0, 0, 0]], bool)
    assert truth.errors(found).tolist() == [0.0, 0.5, 1.0, 1.0]


def test_members_have_means_within_the_tolerance(study):
    ratios = (2.0, 2.09, 2.11, 1.91, 1.89)
    spread = 0.001 * np.resize([-1.0, 1.0], 40)
    found = true_set(study, [made_up(ratio + spread) for ratio in ratios])
    assert found.members.tolist() == [True, True, False, True, False]
    assert found.blur == pytest.approx(0.0, abs=1e-6)


def test_the_resolution_is_the_share_of_points_that_noise_moves_over_the_edge(study):
    # True means one standard error beside the edge, which 400 estimates are told of.
    random, points, error = np.random.default_rng(4), 400, 0.02
    edge = 2.0 * (1.0 + study.tolerance)
    means = edge + error * np.resize([-1.0, 1.0], points)
    rows = [made_up(random.normal(mean, error * math.sqrt(40), 40)) for mean in means]
    truth = true_set(study, rows)
    wrong = (truth.members != (means <= edge)).sum()
    # The number of wrong points is binomial with Φ(−1). Its estimate is by the distances of the
    # means, which are themselves off: with z normal, Φ(−|1 + z|) is 0.182 ± 0.150.
    assert abs(wrong - 0.1587 * points) < 4 * math.sqrt(points * 0.1587 * 0.8413)
    assert abs(truth.blur - 0.182 * points) < 4 * math.sqrt(points) * 0.150 + 0.01 * points


def state(objective, error, samples=20):
    return EnsembleState(samples, 2.0, objective, error, None)


def test_a_point_is_sampled_until_the_edge_is_far():
    rule = ClearMembership(tolerance=0.05, max_samples=100)
    near = 0.05 + 0.99 * CLEAR_ERRORS * 0.01
    far = 0.05 + 1.01 * CLEAR_ERRORS * 0.01
    assert not rule.holds(state(near, 0.01), state(near, 0.01))
    assert rule.holds(state(far, 0.01), state(far, 0.01))
    assert rule.holds(state(0.0, 0.009), state(0.0, 0.009))
    assert not rule.holds(state(0.0, 0.009, 5), state(0.0, 0.009, 5))


def test_points_are_the_same_for_every_run(study):
    assert box_points(study).tobytes() == box_points(study).tobytes()
    assert study.question.allowed_strings(box_points(study)).all()


def test_a_study_of_points_is_another_one_with_another_tolerance(study):
    points = box_points(study)[:5]
    one = FreshSamples(study, points)
    other = FreshSamples(study._replace(tolerance=0.1), points)
    assert one.sha256() != other.sha256()
    assert one.sha256() == FreshSamples(study, points).sha256()
