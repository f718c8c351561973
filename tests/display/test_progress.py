import math

import pytest

from agglom_mpi.display.progress import (
    Best,
    RemainingTime,
    RunProgress,
    format_clock,
    format_rate,
    log_line,
    terminal_lines,
)

FULL = RunProgress(
    done=12,
    total=100,
    unit="generations",
    elapsed=201.0,
    samples=129619,
    rate=705.2,
    busy=0.974,
    strings_open=5,
    in_flight=24,
    failed=3,
    best=Best(762, 0.01234, 0.0045, 0.0201),
    remaining=RemainingTime(187.0, 23.0),
    may_end_sooner=True,
    note="a note",
)


def shown(progress, width, encoding="utf-8"):
    return [line.plain for line in terminal_lines(progress, width, encoding)]


def test_an_estimate_of_the_search_is_told_from_what_the_table_shows():
    best = Best(762, 0.01234, 0.0045, 0.0201, estimated=True)
    line = log_line(FULL._replace(best=best))
    assert "best 0.0123 ± 0.0045 (string 762), as the search estimates, mean of top" in line
    assert "estimates" not in log_line(FULL)


def test_all_that_is_known_is_shown():
    assert log_line(FULL) == (
        "12/100 generations, 3:21, left at most 3 min 10 s ± 20 s, best 0.0123 ± 0.0045 "
        "(string 762), mean of top 0.0201, 3 samples failed, 129619 samples, 705/s, 97% busy, "
        "5 strings open, 24 in flight, a note"
    )


def test_what_is_not_known_is_left_out():
    assert log_line(RunProgress(0, 100, "generations", 0.0, 0)) == "0/100 generations"
    worst = FULL._replace(best=Best(3, math.inf, math.nan, math.inf))
    assert "best no result (string 3), 3 samples failed" in log_line(worst)
    assert "left 3 min 10 s ± 20 s" in log_line(FULL._replace(may_end_sooner=False))


@pytest.mark.parametrize("width", [*range(1, 130), 500])
def test_no_line_is_as_wide_as_the_terminal_and_nothing_is_lost_where_there_is_room(width):
    found = shown(FULL, width)
    assert max(map(len, found)) < max(2, width)
    if width > 40:
        for words in log_line(FULL).split(", "):
            assert any(words in line for line in found)


@pytest.mark.parametrize(("width", "rows"), [(120, 3), (80, 3), (40, 6)])
def test_a_wider_terminal_needs_fewer_lines(width, rows):
    assert len(shown(FULL, width)) == rows


@pytest.mark.parametrize(("done", "full"), [(0, 0), (50, 20), (100, 40), (130, 40)])
def test_the_bar_shows_how_much_is_done(done, full):
    found = shown(FULL._replace(done=done), 120)[0]
    assert (found.count("━"), found.count("─")) == (full, 40 - full)


def test_ascii_is_enough():
    found = shown(FULL, 80, "ascii")
    assert "left at most 3 min 10 s +- 20 s" in found[0]
    assert "#" in found[0]
    assert all(line.isascii() for line in found)
    assert max(map(len, found)) < 80


def test_a_rate_has_two_digits():
    rates = (705.4, 10.0, 1.34, 0.0251)
    assert [format_rate(rate) for rate in rates] == ["705/s", "10/s", "1.3/s", "0.025/s"]


def test_a_clock_shows_hours_when_there_are_any():
    assert [format_clock(s) for s in (7.9, 61.0, 3723.0)] == ["0:07", "1:01", "1:02:03"]


THOUSAND = FULL._replace(
    done=9_999,
    total=10_000,
    elapsed=1e6,
    samples=1_234_567_890,
    rate=654_321.0,
    strings_open=1000,
    in_flight=2_048_000,
    failed=1_234_567,
    best=Best(12_345_678, 0.01234, 0.0045, 0.0201, estimated=True),
    remaining=RemainingTime(1e6, 1e5),
)
"""A thousand ranks with a thousand open strings, after days."""


@pytest.mark.parametrize(("width", "rows"), [(80, 6), (120, 5)])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_a_thousand_open_strings_take_a_few_lines_that_fit(width, rows, encoding):
    found = shown(THOUSAND, width, encoding)
    assert len(found) <= rows
    assert max(map(len, found)) < width
    assert any("1000 strings open" in line for line in found)
    assert "1000 strings open, 2048000 in flight" in log_line(THOUSAND)


def test_what_is_shown_does_not_grow_with_the_strings():
    more = THOUSAND._replace(strings_open=1_000_000)
    assert len(shown(more, 80)) == len(shown(THOUSAND, 80))
    assert len(log_line(more)) == len(log_line(THOUSAND)) + 3
