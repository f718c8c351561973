"""Expected run times and their bands, in cases that are known in closed form."""

import math

import numpy as np
import pytest

from agglom_mpi.accuracy.answer.times_to_targets import TimesToTargets, cost_to

INF = math.inf


def times(reached, spent):
    return TimesToTargets(np.array(reached, float).reshape(len(spent), -1), np.array(spent, float))


def test_a_run_reaches_a_target_at_its_first_answer_within_it():
    costs, errors = [10, 20, 30, 40], [0.5, 0.2, 0.3, 0.05]
    assert cost_to(costs, errors, [1.0, 0.3, 0.2, 0.1, 0.01]).tolist() == [10, 20, 20, 40, INF]


def test_an_unknown_error_is_within_no_target():
    assert cost_to([1, 2, 3], [math.nan, INF, 0.1], [0.5]).tolist() == [3]


def test_the_expected_run_time_counts_the_cost_of_runs_that_fail():
    # Auger and Hansen 2005: (2 + 4 + 10 + 10) / 2.
    found = times([2, 4, INF, INF], [9, 9, 10, 10])
    assert found.expected.tolist() == [13.0]
    assert found.successes.tolist() == [2]


def test_without_failures_the_expected_run_time_is_the_mean():
    assert times([3, 5, 10], [20, 20, 20]).expected.tolist() == [6.0]


def test_a_target_that_no_run_reaches_costs_without_end():
    found = times([[1, INF], [2, INF]], [5, 5])
    assert found.expected.tolist() == [1.5, INF]
    band = found.band(np.random.default_rng(0))[1]
    # Of two runs, each reaches it with a probability p of at most 1 − √0.025.
    p = 1.0 - math.sqrt(0.025)
    assert (band.value, band.high) == (INF, INF)
    assert band.low == pytest.approx(5 * (1 - p) / p)


def test_the_bound_of_an_unreached_target_holds_as_often_as_it_states():
    # Runs that cost 1 and succeed with p, where the bound is just broken if none of n does.
    n, trials = 10, 4000
    p = 1.0 - 0.025 ** (1.0 / n)
    none = (np.random.default_rng(8).random((trials, n)) >= p).all(axis=1).mean()
    assert abs(none - 0.025) < 4 * math.sqrt(0.025 * 0.975 / trials)
    assert times([INF] * n, [1.0] * n).least == pytest.approx((1 - p) / p)


def test_a_band_is_open_where_few_runs_reach_the_target():
    band = times([4, INF, INF, INF], [10, 10, 10, 10]).band(np.random.default_rng(0))[0]
    assert band.value == 34.0
    assert band.low < 34.0
    assert band.high == INF


def test_the_expected_run_time_is_that_of_restarts():
    # A run succeeds at cost 3 with probability p, else ends at 7: restarted until it succeeds it
    # costs 3 + 7 (1 - p)/p. The ratio of sums of n runs is within 4 standard errors of that.
    p, n = 0.3, 100_000
    hits = np.random.default_rng(2).random(n) < p
    found = times(np.where(hits, 3.0, INF), np.full(n, 7.0)).expected[0]
    error = 7.0 / p**2 * math.sqrt(p * (1 - p) / n)  # delta method: d/dp of 7/p
    assert abs(found - (3 + 7 * (1 - p) / p)) < 4 * error


def test_the_share_of_reached_targets_rises_in_steps():
    found = times([[1, 4], [2, INF]], [6, 6])
    assert found.share([0.5, 1, 2, 3.9, 4, 100]).tolist() == [0, 0.25, 0.5, 0.5, 0.75, 0.75]


def test_runs_are_read_from_costs_and_errors():
    costs, errors = [[1, 2], [1, 3]], [[0.5, 0.1], [0.6, 0.4]]
    found = TimesToTargets.of_runs(
        [np.array(c, float) for c in costs], [np.array(e) for e in errors], [0.5, 0.2]
    )
    assert found.reached.tolist() == [[1, 2], [3, INF]]
    assert found.spent.tolist() == [2, 3]


def coverage(draw, truth, runs, trials=600):
    random = np.random.default_rng(5)
    inside = 0
    for _ in range(trials):
        band = times(*draw(random, runs)).band(random)[0]
        inside += band.low <= truth <= band.high
    return inside / trials, math.sqrt(0.95 * 0.05 / trials)


def test_bands_contain_the_mean_of_run_times_as_often_as_they_state():
    def draw(random, runs):
        return random.uniform(1.0, 3.0, runs), np.full(runs, 5.0)

    # The percentiles expand to Student's t interval up to terms in 1/n (Hesterberg 2015).
    for runs in (10, 40):
        share, error = coverage(draw, 2.0, runs)
        assert abs(share - 0.95) < 4 * error + 0.5 / runs


def test_bands_contain_the_expected_time_where_runs_fail():
    def draw(random, runs):
        hits = random.random(runs) < 0.5
        return np.where(hits, 3.0, INF), np.full(runs, 7.0)

    # The number of successes is discrete: its share of one value is up to 1.3/√n.
    share, error = coverage(draw, 10.0, 40)
    assert 0.95 - 4 * error - 0.5 * 1.3 / math.sqrt(40) < share
