"""What estimates on fresh samples say together, in numbers and in words."""

import math

import pytest

from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.analysis.summary import describe_bias, selection_bias


def estimate(string, objective, error=0.01, own=0.2, samples=100):
    lower, upper = objective - 2 * error, objective + 2 * error
    return Estimate(string, objective, error, lower, upper, samples, 0, 2.0, own, 0.02)


def said(estimates, shown, estimated=None):
    count = len(estimates) if estimated is None else estimated
    return list(describe_bias(selection_bias(estimates), shown, count))


def test_the_optimism_of_the_search_is_the_mean_of_all_and_has_an_error():
    found = selection_bias([estimate(4, 0.25, own=0.2), estimate(1, 0.28, own=0.27)])
    assert found.optimism == pytest.approx(0.03)
    assert found.standard_error == pytest.approx(0.01 / math.sqrt(2.0))
    words = said([estimate(4, 0.25, own=0.2), estimate(1, 0.28, own=0.27)], [4, 1])
    assert "objectives are too low, by 0.0300 ± 0.0071 on average" in words[0]
    assert "are too high, by 0.100 ± 0.010" in said([estimate(4, 0.1)], [4])[0]


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


def test_strings_without_estimate_are_still_said_to_be_biased():
    biased = "objectives are the search's own; the lucky survive, so they are biased low"
    assert said([], [3, 4]) == [biased]
    assert "without re-estimate" in said([estimate(3, 0.1)], [3, 4])[1]


def test_an_estimate_without_an_error_says_nothing():
    assert selection_bias([estimate(3, math.inf), estimate(4, 0.1, math.nan)]) is None
