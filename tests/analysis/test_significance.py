"""Which means differ: p-values against SciPy, Holm's correction, and how often tests err."""

import math
from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from agglom_mpi.analysis.selection_bias import p_value, paired_p_value, significant_differences
from agglom_mpi.statistics import MeanEstimate, mean_of


def test_p_values_are_those_of_welchs_test():
    rng = np.random.default_rng(1)
    for first, second in ((5, 40), (2, 3), (100, 100)):
        one, other = rng.normal(0.3, 1.0, first), rng.normal(0.0, 3.0, second)
        wanted = stats.ttest_ind(one, other, equal_var=False).pvalue
        assert p_value(mean_of(one), mean_of(other)) == pytest.approx(wanted, rel=1e-9)


def test_means_without_error_differ_if_they_are_not_equal():
    assert p_value(MeanEstimate(1.0, 0.0, 5), MeanEstimate(1.0, 0.0, 5)) == 1.0
    assert p_value(MeanEstimate(1.0, 0.0, 5), MeanEstimate(1.1, 0.0, 5)) == 0.0


def test_a_difference_that_is_clear_alone_may_not_be_among_many():
    error, samples = 0.1, 1000
    pair = [
        MeanEstimate(0.0, error, samples),
        MeanEstimate(2.2 * error * math.sqrt(2.0), error, samples),
    ]
    assert significant_differences(pair) == {(0, 1)}
    middle = [MeanEstimate(1.1 * error * math.sqrt(2.0), error, samples)] * 3
    assert significant_differences([*pair, *middle]) == set()


def test_each_clear_difference_makes_the_next_easier():
    error, samples = 0.1, 10_000
    unit = error * math.sqrt(2.0)
    far, near = 20.0 * unit, stats.norm.isf(0.5 * 0.05 / 2.5) * unit
    assert significant_differences([MeanEstimate(v, error, samples) for v in (0.0, near)]) == {
        (0, 1)
    }
    three = [MeanEstimate(v, error, samples) for v in (0.0, near, far)]
    # Two differences to the far one come first; the third needs 5 % alone, not a third of that.
    assert significant_differences(three) == {(0, 1), (0, 2), (1, 2)}
    assert p_value(three[0], three[1]) > 0.05 / 3


def test_equal_strings_are_rarely_told_from_the_one_that_happens_to_be_first():
    repeats, strings, samples = 3000, 6, 20
    values = np.random.default_rng(3).gamma(9.0, 1.0, (repeats, strings, samples))
    wrong = 0
    for ensembles in values:
        means = sorted(map(mean_of, ensembles))
        wrong += any(place == 0 for place, _ in significant_differences(means))
    assert wrong / repeats < 0.05 + 4.0 * math.sqrt(0.05 * 0.95 / repeats)
    assert wrong, "it is no test if it never errs"


def alike(rng, correlation, strings, samples):
    """Samples of equal strings of which each two have a correlation, shape (strings, samples)."""
    covariance = np.full((strings, strings), correlation) + (1.0 - correlation) * np.eye(strings)
    return rng.multivariate_normal(np.zeros(strings), covariance, samples).T


SLOW = [pytest.param(correlation, marks=pytest.mark.slow) for correlation in (-0.8, 0.0, 0.3)]


@pytest.mark.parametrize("correlation", [*SLOW, 0.9])
def test_the_paired_test_errs_as_often_as_it_says_however_alike_samples_are(correlation):
    repeats, samples = 4000, 20
    rng, paired, welch = np.random.default_rng(5), 0, 0
    for _ in range(repeats):
        one, other = alike(rng, correlation, 2, samples)
        paired += paired_p_value(mean_of(one - other)) < 0.05
        welch += p_value(mean_of(one), mean_of(other)) < 0.05
    four_errors = 4.0 * math.sqrt(0.05 * 0.95 / repeats)
    assert abs(paired / repeats - 0.05) < four_errors
    if correlation == 0.0:
        assert abs(welch / repeats - 0.05) < four_errors
    else:
        assert (welch / repeats - 0.05) * correlation < 0.0
        assert abs(welch / repeats - 0.05) > four_errors


@pytest.mark.parametrize("correlation", [0.0, pytest.param(0.6, marks=pytest.mark.slow)])
def test_equal_strings_are_rarely_told_apart_in_pairs(correlation):
    repeats, strings, samples = 2000, 6, 20
    rng, wrong = np.random.default_rng(6), 0
    for _ in range(repeats):
        values = alike(rng, correlation, strings, samples)
        values = values[np.argsort(values.mean(axis=1))]
        pairs = combinations(range(strings), 2)
        differences = {(i, j): mean_of(values[i] - values[j]) for i, j in pairs}
        found = significant_differences([mean_of(row) for row in values], differences)
        wrong += any(place == 0 for place, _ in found)
    assert wrong / repeats < 0.05 + 4.0 * math.sqrt(0.05 * 0.95 / repeats)
    assert wrong, "it is no test if it never errs"


def test_pairs_without_error_differ_if_they_are_not_equal_and_one_pair_tells_nothing():
    assert paired_p_value(MeanEstimate(0.0, 0.0, 5)) == 1.0
    assert paired_p_value(MeanEstimate(0.1, 0.0, 5)) == 0.0
    assert paired_p_value(MeanEstimate(math.nan, math.nan, 1)) == 1.0


def test_nothing_differs_where_there_is_nothing_to_compare():
    assert significant_differences([]) == set()
    assert significant_differences([MeanEstimate(1.0, 0.1, 5)]) == set()
