import math

import numpy as np
import pytest

from agglom_mpi.display.progress import (
    UNITS,
    DurationStatistics,
    RemainingTime,
    format_rounded,
    remaining_by_work,
    remaining_in_turns,
)

REPEATS = 4000
SECONDS = {unit: size for size, unit in UNITS}
TOLERANCE = 4.0 * math.sqrt(0.95 * 0.05 / REPEATS)
"""Four standard errors of a share of 95 %."""


def share_inside(draw, before, after):
    """Share of forecasts whose interval holds what the remaining turns then took."""
    inside = 0
    for seed in range(REPEATS):
        durations = draw(np.random.default_rng(seed), before + after)
        remaining = remaining_in_turns(DurationStatistics(durations[:before]), after)
        inside += abs(durations[before:].sum() - remaining.seconds) <= remaining.half_width
    return inside / REPEATS


@pytest.mark.parametrize(("before", "after"), [(3, 1), (3, 30), (10, 10), (40, 5)])
def test_the_interval_holds_the_remaining_time_as_often_as_it_says(before, after):
    share = share_inside(lambda random, n: random.normal(10.0, 2.0, n), before, after)
    assert abs(share - 0.95) < TOLERANCE


def test_the_interval_is_not_wider_than_it_must_be():
    """Two thirds of its width hold what a t interval of that width holds, and no more."""
    inside = 0
    for seed in range(REPEATS):
        durations = np.random.default_rng(seed).normal(10.0, 2.0, 40)
        remaining = remaining_in_turns(DurationStatistics(durations[:30]), 10)
        inside += abs(durations[30:].sum() - remaining.seconds) <= remaining.half_width * 2.0 / 3.0
    from scipy import stats

    wanted = 1.0 - 2.0 * stats.t.sf(2.0 / 3.0 * stats.t.ppf(0.975, 29), 29)
    assert abs(inside / REPEATS - wanted) < 4.0 * math.sqrt(wanted * (1.0 - wanted) / REPEATS)


def test_the_rate_of_many_pieces_forecasts_the_rest():
    """Pieces of gamma-distributed cost on eight ranks that are never idle."""
    done, rest, ranks, inside = 200, 400, 8, 0
    for seed in range(REPEATS):
        costs = np.random.default_rng(seed).gamma(4.0, 0.25, done + rest)
        remaining = remaining_by_work(
            DurationStatistics(costs[:done]), done, rest, costs[:done].sum() / ranks
        )
        inside += abs(costs[done:].sum() / ranks - remaining.seconds) <= remaining.half_width
    assert abs(inside / REPEATS - 0.95) < TOLERANCE


def test_the_time_of_the_present_turn_is_subtracted():
    durations = DurationStatistics([10.0, 12.0, 14.0])
    assert remaining_in_turns(durations, 5).seconds == pytest.approx(60.0)
    assert remaining_in_turns(durations, 5, 7.0).seconds == pytest.approx(53.0)
    assert remaining_in_turns(durations, 5, 700.0).seconds == pytest.approx(48.0), (
        "the others are still to come"
    )


def test_there_is_no_forecast_of_too_few_durations():
    assert remaining_in_turns(DurationStatistics([10.0, 12.0]), 5) is None
    assert remaining_in_turns(DurationStatistics([10.0, 12.0, 11.0]), 0) is None
    assert remaining_by_work(DurationStatistics(), 0, 10, 0.0) is None
    assert remaining_by_work(DurationStatistics([1.0, 1.0]), 2, 10, 1.0) is None


def test_statistics_are_the_mean_and_the_deviation_of_the_durations():
    durations = np.random.default_rng(1).normal(1e6, 1.0, 100)
    statistics = DurationStatistics(durations)
    assert statistics.count == 100
    assert statistics.mean == pytest.approx(durations.mean(), rel=1e-14)
    assert statistics.deviation == pytest.approx(durations.std(ddof=1), rel=1e-9)
    assert math.isnan(DurationStatistics([1.0]).deviation)


@pytest.mark.parametrize(
    ("seconds", "error", "text"),
    [
        (187.0, 23.0, "3 min 10 s ± 20 s"),
        (195.0, 12.0, "3 min 15 s ± 10 s"),
        (4.4, 0.3, "4 s ± 1 s"),
        (3700.0, 250.0, "1 h 2 min ± 4 min"),
        (86400.0 * 3.2, 7300.0, "3 d 5 h ± 2 h"),
        (5.0, 40.0, "1 min"),
        (0.0, 10.0, "10 s"),
        (105.0, 300.0, "8 min"),
        (105.0, 90.0, "2 min ± 1 min 30 s"),
        (59.7, 0.0, "1 min ± 1 s"),
    ],
)
def test_a_time_is_rounded_to_what_its_error_leaves_of_it(seconds, error, text):
    assert str(RemainingTime(seconds, error)) == text


@pytest.mark.parametrize("seconds", [3.0, 105.0, 4000.0])
@pytest.mark.parametrize("relative", [0.05, 0.3, 0.9, 1.0, 5.0])
def test_rounding_moves_a_time_by_at_most_a_quarter_of_its_error(seconds, relative):
    remaining = RemainingTime(seconds, relative * seconds)
    words = str(remaining).split(" ± ")[0].split()
    shown = sum(int(n) * SECONDS[unit] for n, unit in zip(words[::2], words[1::2], strict=True))
    most = max(0.5, remaining.half_width / 4.0)
    if remaining.is_bound:
        assert 0.0 <= shown - (seconds + remaining.half_width) < 2.0 * most
    else:
        assert abs(shown - seconds) <= most


def test_a_time_has_two_units():
    assert format_rounded(90061.0, 1) == "1 d 1 h"
    assert format_rounded(3601.0, 1) == "1 h"
    assert format_rounded(-3.0, 1) == "0 s"
