import math

import pytest

from agglom_mpi.analysis.trade_off import (
    DOMINATED,
    FRONT,
    UNRESOLVED,
    TradeOffAxis,
    verdicts,
)

LOWER = TradeOffAxis("power", "W", False), TradeOffAxis("objective", "1", False)


def point(x, y, y_error=0.1, x_error=0.0):
    return (x, x_error), (y, y_error)


def test_a_front_has_the_points_that_nothing_else_beats():
    found = verdicts([point(1, 3), point(2, 2), point(3, 1), point(3, 2.5)], LOWER)
    assert found == [FRONT, FRONT, FRONT, DOMINATED]


def test_a_difference_below_two_standard_errors_dominates_nothing():
    """Two errors of 0.1 make one of 0.141 of their difference, which is resolved from 0.283 on."""
    for gap, expected in ((0.28, UNRESOLVED), (0.29, DOMINATED)):
        assert verdicts([point(1, 1), point(2, 1 + gap)], LOWER) == [FRONT, expected]


def test_equal_points_are_both_on_the_front():
    assert verdicts([point(1, 1), point(1, 1)], LOWER) == [FRONT, FRONT]
    assert verdicts([point(1, 1, 0.0), point(1, 1, 0.0)], LOWER) == [FRONT, FRONT]


def test_an_unknown_error_resolves_nothing():
    assert verdicts([point(1, 1, math.nan), point(2, 9)], LOWER) == [FRONT, UNRESOLVED]


@pytest.mark.parametrize("maximised", [False, True])
def test_what_is_maximised_is_better_the_higher_it_is(maximised):
    axes = LOWER[0], TradeOffAxis("growth", "1", maximised)
    better, worse = verdicts([point(1, 5), point(1, 1)], axes)
    assert (better == FRONT) is maximised
    assert (worse == FRONT) is not maximised


def test_numbers_without_errors_are_compared_as_they_are():
    exact = [point(1, 1, 0.0), point(1, 1 + 1e-9, 0.0)]
    assert verdicts(exact, LOWER) == [FRONT, DOMINATED]
