"""Running and pooled means, standard errors and t intervals."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agglom_mpi.statistics import (
    MeanEstimate,
    PooledMoments,
    RunningMean,
    gap_between,
    mean_of,
    t_95,
    t_quantile,
    t_tails,
    weighted_quantiles,
)

numbers = st.floats(-100, 100)
groups = st.lists(st.lists(numbers, min_size=1, max_size=12), min_size=1, max_size=12)


@given(st.lists(numbers, min_size=2, max_size=60))
@settings(derandomize=True, deadline=None)
def test_running_mean_and_error_are_those_of_all_values(values):
    running = RunningMean()
    for value in values:
        running.add(value)
    # Each step rounds a few times at the size of the values, 100; their squared deviations are
    # at most 200 times as large as the deviations.
    slack = 4 * len(values) * np.finfo(float).eps * 100
    assert running.count == len(values)
    assert running.mean == pytest.approx(np.mean(values), rel=0, abs=slack)
    variance = running.standard_error**2 * len(values)
    assert variance == pytest.approx(np.var(values, ddof=1), rel=0, abs=200 * slack)


def test_a_running_mean_of_equal_values_is_exact_and_without_error():
    running = RunningMean()
    for _ in range(50):
        running.add(0.1)
    assert running.mean == 0.1
    assert running.standard_error == 0.0


def test_running_errors_survive_a_large_offset():
    running = RunningMean()
    for value in (1e9 + 4, 1e9 + 7, 1e9 + 13, 1e9 + 16):
        running.add(value)
    assert running.standard_error**2 * 4 == pytest.approx(30.0, rel=1e-12)


def test_nothing_and_one_value_have_no_standard_error():
    running = RunningMean()
    assert np.isnan(running.mean)
    running.add(3.0)
    assert running.mean == 3.0
    assert np.isnan(running.standard_error)


@given(groups)
@settings(derandomize=True, deadline=None)
def test_pooled_moments_are_those_of_all_members_together(members):
    pooled = PooledMoments()
    for group in members:
        away = np.array(group) - np.mean(group)
        moments = tuple(float(np.mean(away**order)) for order in (2, 3, 4))
        pooled.add(len(group), float(np.mean(group)), moments)
    everyone = np.concatenate(members)
    away = everyone - np.mean(everyone)
    assert pooled.count == everyone.size
    # Deviations are at most 200; each of at most 144 members and 12 groups rounds a few times.
    slack = 1000 * np.finfo(float).eps
    assert pooled.mean == pytest.approx(np.mean(everyone), rel=0, abs=slack * 100)
    for order, moment in zip((2, 3, 4), pooled.central, strict=True):
        assert moment == pytest.approx(np.mean(away**order), rel=0, abs=slack * 200.0**order)


def test_groups_of_equal_members_have_moments_of_exactly_zero():
    pooled = PooledMoments()
    for count in (100, 37, 1):
        pooled.add(count, 1.0, (0.0, 0.0, 0.0))
    assert pooled.central == (0.0, 0.0, 0.0)


def test_a_mean_has_a_standard_error_and_t_interval():
    found = mean_of([1.0, 2.0, 3.0, 6.0])
    assert found.value == 3.0
    assert found.error == pytest.approx(math.sqrt(14.0 / 3.0 / 4.0), rel=1e-14)
    assert found.half_width == pytest.approx(3.182446305 * found.error, rel=1e-8)


def test_one_value_has_no_error_and_none_no_mean():
    assert math.isnan(mean_of([2.0]).error)
    assert mean_of([2.0]).half_width == math.inf
    assert math.isnan(mean_of([]).value)


def test_equal_values_have_no_error():
    assert mean_of([2.0, 2.0, 2.0]) == MeanEstimate(2.0, 0.0, 3)


@pytest.mark.parametrize(
    ("degrees_of_freedom", "quantile"),
    [(1, 12.706), (2, 4.303), (4, 2.776), (9, 2.262), (120, 1.980)],
)
def test_t_quantiles_are_those_of_printed_tables(degrees_of_freedom, quantile):
    assert t_95(degrees_of_freedom) == pytest.approx(quantile, abs=5e-4)
    assert t_tails(t_quantile(degrees_of_freedom, 0.9), degrees_of_freedom) == pytest.approx(0.1)


def test_quantiles_weigh():
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([0.1, 0.8, 0.1])
    assert weighted_quantiles(values, weights, (0.5, 0.85, 1.0)) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("share", [0.03, 0.5, 0.8])
def test_two_groups_are_split_where_there_is_nothing(share):
    rng, count = np.random.default_rng(2), 4000
    values = np.where(rng.random(count) < share, rng.normal(0.0, 0.1, count), 3.0)
    assert 1.0 < gap_between(values, rng.uniform(0.5, 1.5, count)) < 3.0


@pytest.mark.parametrize("draw", ["normal", "uniform", "exponential"])
def test_one_group_is_not_split(draw):
    rng = np.random.default_rng(3)
    assert gap_between(getattr(rng, draw)(size=4000), np.ones(4000)) is None
    assert gap_between(np.ones(5), np.ones(5)) is None
