"""What to measure next to tell two laws apart: expected probabilities and Bayes factors."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from test_law_comparison import law_of
from toy_posteriors import linear_emulator, measurements

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference import next_measurement
from agglom_mpi.inference.data_posterior import posterior_of
from agglom_mpi.inference.expected_volume import Candidate, WeightedPoints
from agglom_mpi.inference.law_comparison import LawComparison
from agglom_mpi.inference.telling_apart import Prediction, telling_measurements, told_apart

SHARED = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
LAWS = np.array([[*SHARED, [0.5, -0.5]], [*SHARED, [-0.5, 0.5]]])
"""Two laws that differ in the last number, of which the data know little."""
TRUTH = np.array([0.7, 0.3])
ERRORS = np.array([0.05, 0.05, 0.06, 0.4])
LOG_ODDS = 0.4


def doubt_and_factor(first, other, log_odds):
    """Return both for normal predictions, each a mean and a variance, by quadrature."""
    p = 1.0 / (1.0 + np.exp(-log_odds))
    one, two = (norm(mean, np.sqrt(variance)) for mean, variance in (first, other))

    def wrong(y):
        mixed = p * one.pdf(y) + (1.0 - p) * two.pdf(y)
        return 2.0 * p * (1.0 - p) * one.pdf(y) * two.pdf(y) / mixed if mixed > 0.0 else 0.0

    def divergence(a, b):
        return 0.5 * (a[1] / b[1] + (a[0] - b[0]) ** 2 / b[1] - 1.0 + np.log(b[1] / a[1]))

    middle, wide = 0.5 * (first[0] + other[0]), 10.0 * np.sqrt(max(first[1], other[1]))
    doubt = quad(wrong, middle - wide, middle + wide, limit=200)[0]
    return doubt, p * divergence(first, other) + (1.0 - p) * divergence(other, first)


def normal(mean, variance, error=0.0):
    candidate = Candidate(np.full((1, 1), mean), np.full((1, 1, 1), variance), np.eye(1) * error)
    return Prediction(WeightedPoints(np.ones(1), 1.0), candidate)


@pytest.mark.parametrize(
    ("first", "other", "log_odds"),
    [((0.0, 1.0), (1.5, 1.0), 0.0), ((0.0, 1.0), (0.0, 9.0), 1.0), ((2.0, 0.5), (0.0, 1.0), -2.0)],
)
def test_normal_predictions_have_the_doubt_and_the_factor_of_quadrature(first, other, log_odds):
    found = told_apart(normal(*first), normal(other[0], 0.0, other[1]), log_odds, seed=3)
    doubt, factor = doubt_and_factor(first, other, log_odds)
    assert found.doubt == pytest.approx(doubt, abs=4.5 * found.doubt_error)
    assert found.doubt_error < 0.01
    assert found.log_bayes_factor == pytest.approx(factor, rel=0.3)
    p = 1.0 / (1.0 + np.exp(-log_odds))
    assert found.gain == pytest.approx(2.0 * p * (1.0 - p) - found.doubt)
    assert found.is_worth_it


def test_laws_that_predict_the_same_are_not_told_apart():
    found = told_apart(normal(1.0, 2.0), normal(1.0, 0.5, 1.5), 0.7, seed=3)
    assert found.gain == pytest.approx(0.0, abs=1e-12)
    assert found.log_bayes_factor == pytest.approx(0.0, abs=1e-12)
    assert not found.is_worth_it


@pytest.fixture(scope="module")
def posteriors(tmp_path_factory):
    """Posteriors of data that no law contradicts: the last number is that between both laws."""
    values = 1.0 + np.append(SHARED @ TRUTH, 0.0)
    data, found = measurements(values, ERRORS), []
    for slopes in LAWS:
        folder = tmp_path_factory.mktemp("law")
        own = single_threaded(posterior_of)(linear_emulator(folder, slopes, data, noise=1e-3))
        found.append(dataclasses.replace(own, file=object()))
    return found


def expected(slopes, i, values):
    """Return mean and variance of a repetition of a datum with half of its error."""
    covariance = np.linalg.inv(slopes.T @ np.diag(ERRORS**-2.0) @ slopes)
    place = covariance @ slopes.T @ ((values - 1.0) / ERRORS**2)
    return slopes[i] @ place, slopes[i] @ covariance @ slopes[i] + 0.25 * ERRORS[i] ** 2


def test_the_number_in_which_laws_differ_tells_them_apart_as_least_squares_say(
    posteriors, monkeypatch
):
    monkeypatch.setattr(next_measurement, "_new_quantities", lambda *_: ())
    ranked = telling_measurements(posteriors, LOG_ODDS)
    values = np.array([datum.values[0] for datum in posteriors[0].of.data])
    assert len(ranked) == len(values)
    for each in ranked:
        i = int(each.name.split()[1].rstrip(","))
        doubt, factor = doubt_and_factor(*(expected(law, i, values) for law in LAWS), LOG_ODDS)
        error = 4.5 * each.apart.doubt_error
        assert each.apart.doubt == pytest.approx(doubt, abs=error + 0.02)
        assert each.apart.log_bayes_factor == pytest.approx(factor, rel=0.3, abs=0.05)
        assert each.apart.is_worth_it == (i == 3)
    assert [each.apart.doubt for each in ranked] == sorted(each.apart.doubt for each in ranked)
    # Both predict the last number from the others, apart by more than its half error.
    assert ranked[0].name == "number 3, again"
    assert ranked[0].apart.log_bayes_factor > 0.5

    found = LawComparison((law_of("a", LOG_ODDS), law_of("b", 0.0)), ranked)
    assert "measure number 3, again" in found.verdict
    assert list(found.next_measurements["measurement"]) == [each.name for each in ranked]
    entries = json.loads(json.dumps(found.as_dict(), allow_nan=False))["next_measurements"]
    assert entries[0]["expected_probability"] == 1.0 - ranked[0].apart.doubt
    nothing = LawComparison(found.laws, ranked[1:])
    assert "measure" not in nothing.verdict
