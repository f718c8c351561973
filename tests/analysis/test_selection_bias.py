"""What estimates on fresh samples say together, in numbers and in words."""

import math

import pytest

from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.analysis.selection_bias import describe_bias, selection_bias
from agglom_mpi.statistics import MeanEstimate


def estimate(string, objective, error=0.01, own=0.2, samples=100, own_error=0.02):
    lower, upper = objective - 2 * error, objective + 2 * error
    return Estimate(string, objective, error, lower, upper, samples, 0, 2.0, own, own_error)


def said(estimates, shown, estimated=None):
    count = len(estimates) if estimated is None else estimated
    return list(describe_bias(selection_bias(estimates), shown, count))


def test_the_optimism_of_the_search_is_the_mean_of_all_and_has_the_errors_of_both():
    found = selection_bias([estimate(4, 0.25, own=0.2), estimate(1, 0.32, own=0.27)])
    assert found.optimism == pytest.approx(0.05)
    assert found.standard_error == pytest.approx(math.hypot(0.01, 0.02) / math.sqrt(2.0))
    assert found.is_bias
    words = said([estimate(4, 0.25, own=0.2), estimate(1, 0.32, own=0.27)], [4, 1])
    assert "objectives are too low, by 0.050 ± 0.016 on average" in words[0]
    assert "are too high, by 0.100 ± 0.022" in said([estimate(4, 0.1)], [4])[0]


@pytest.mark.parametrize(("objective", "claimed"), [(0.244, False), (0.246, True), (0.154, True)])
def test_a_bias_is_claimed_beyond_two_standard_errors_alone(objective, claimed):
    strings = [estimate(4, objective)]  # two errors are 2·√(0.01² + 0.02²) = 0.0447
    assert selection_bias(strings).is_bias is claimed
    assert ("objectives are too" in said(strings, [4])[0]) is claimed
    assert ("no bias" in said(strings, [4])[0]) is not claimed


def test_strings_searched_by_one_sample_show_no_bias():
    strings = [estimate(4, 0.1, own_error=math.nan), estimate(5, 0.2, own=0.9)]
    found = selection_bias(strings)
    assert math.isnan(found.standard_error)
    assert not found.is_bias
    assert "lower by 0.4 on average, and no bias can be claimed" in said(strings, [4, 5])[0]


def test_errors_of_strings_that_share_configurations_do_not_average_out():
    class Paired:
        def difference(self, one, other):
            return MeanEstimate(0.0, 0.01, 100)

        def average(self):
            return MeanEstimate(0.3, 0.01, 100)

    found = selection_bias([estimate(4, 0.25), estimate(1, 0.3, own_error=0.04)], Paired())
    assert found.standard_error == pytest.approx(math.hypot(0.01, 0.03))


def test_those_that_cannot_be_told_from_the_first_are_named_by_their_columns():
    close = [estimate(7, 0.10), estimate(2, 0.11), estimate(5, 0.5), estimate(9, 0.11, 0.4)]
    found = selection_bias(close)
    assert (found.first, found.same, found.pairs) == (7, [2, 9], 6)
    assert said(close, [7, 2, 5, 9])[-1] == (
        "#2 and #4 do not differ significantly from #1 at 95 % (Welch's t, 6 pairs, Holm)"
    )
    assert said(close, [7, 2])[-1].startswith("#2 and string 9 do not differ significantly from #1")


def test_a_best_one_that_stands_alone_is_said_to():
    apart = [estimate(7, 0.10), estimate(2, 0.31)]
    assert said(apart, [7, 2])[-1] == (
        "#1 is the best of those estimated again, at 95 % (Welch's t, 1 pair, Holm)"
    )


def test_one_estimate_is_compared_with_nothing():
    assert len(said([estimate(7, 0.1)], [7])) == 1


def test_strings_without_estimate_are_said_to_be_as_searched():
    [searched] = said([], [3, 4])
    assert searched.startswith("objectives are as searched")
    assert said([estimate(3, 0.1)], [3, 4])[1].startswith("1 of 2 strings were estimated again")


def test_an_estimate_without_an_error_says_nothing():
    assert selection_bias([estimate(3, math.inf), estimate(4, 0.1, math.nan)]) is None
