"""A sample that hangs is named when it has taken 20 times as long as any, and not too often."""

from types import SimpleNamespace

import numpy as np
import pytest

from agglom_mpi.outcome import FailureReason
from agglom_mpi.runtime import abort_flag
from agglom_mpi.runtime.abort_flag import AbortFlag, SampleClock, SampleUnderWay
from agglom_mpi.runtime.failures import (
    FACTOR,
    FIRST_SECONDS,
    MIN_SECONDS,
    HangingSamples,
)
from agglom_mpi.runtime.messages import RESULT


def watching(longest, max_seconds=None):
    """Return what watches samples, and the list that it fills."""
    shown = []
    return HangingSamples(longest, max_seconds, "rank {} on a".format, shown.append), shown


def times_named(samples, shown, until, rank=1, string=5, sample=3):
    """Let a sample take a time in s; return when it was named."""
    named = []
    for second in range(until):
        before = len(shown)
        samples.check(rank, SampleUnderWay(string, sample, float(second)))
        named += [second] if len(shown) > before else []
    return named


@pytest.mark.parametrize("longest", [0.01, 2.0])
def test_a_sample_is_named_after_20_times_the_longest_and_again_at_doubled_times(longest):
    samples, shown = watching(longest)
    first = int(max(MIN_SECONDS, FACTOR * longest))
    named = times_named(samples, shown, 8 * first)
    assert named == [first + 1, 2 * first + 1, 4 * first + 1]
    assert shown[0] == (
        f"rank 1 on a: string 5 sample 3 has been under way for {first + 1} s, and the longest "
        f"sample so far took {longest:.2g} s; stopping.max_seconds ends samples that take too "
        "long, unless they are in a function of your own"
    )


def test_the_next_sample_of_a_rank_is_another_one():
    samples, shown = watching(0.1)
    for sample in (3, 4):
        assert times_named(samples, shown, 15, sample=sample) == [11]
    assert times_named(samples, shown, 15, rank=2, sample=4) == [11]


def test_the_first_sample_of_a_file_has_long():
    samples, shown = watching(0.0)
    assert times_named(samples, shown, int(FIRST_SECONDS) + 2) == [FIRST_SECONDS + 1]
    assert "no sample is finished yet" in shown[0]


def test_a_longer_sample_gives_all_others_longer():
    samples, shown = watching(0.1)
    rows = np.zeros(2, RESULT)
    rows["seconds"] = 1.0, 3.0
    samples.learn(rows)
    assert times_named(samples, shown, 100) == [61]


def test_samples_that_were_ended_early_are_no_measure():
    samples, shown = watching(0.1)
    rows = np.zeros(1, RESULT)
    rows["seconds"], rows["reason"] = 1e6, FailureReason.TIMED_OUT
    samples.learn(rows)
    assert times_named(samples, shown, 15) == [11]


def test_a_limit_that_does_not_end_a_sample_is_not_recommended():
    samples, shown = watching(0.1, max_seconds=5.0)
    times_named(samples, shown, 15)
    assert shown[0].endswith(
        "; stopping.max_seconds, 5 s, does not end it: it is in a function that does not return"
    )


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now=50.0)
    monkeypatch.setattr(abort_flag, "time", SimpleNamespace(monotonic=lambda: clock.now))
    return clock


def test_the_time_of_a_sample_counts_from_its_begin_without_stops_of_the_rank(clock):
    flag = AbortFlag(None)
    samples = SampleClock(flag)
    assert samples.read() is None
    flag.begin(7, 2)
    assert samples.read() == (7, 2, 0.0)
    for _ in range(4):
        clock.now += 0.5
        seconds = samples.read().seconds
    assert seconds == 2.0
    clock.now += 1000.0  # stopped
    assert samples.read() == (7, 2, 2.0 + abort_flag.LONGEST_STEP)
    flag.end()
    assert samples.read() is None


def test_samples_of_a_compiled_call_are_numbered(clock):
    flag, finished = AbortFlag(None), np.zeros(1, np.int64)
    samples = SampleClock(flag)
    flag.begin(7, 2)
    flag.follow(finished)
    clock.now += 0.5
    samples.read()
    finished[0] = 3
    assert samples.read() == (7, 5, 0.0)
    flag.end()
    flag.begin(8, 0)
    assert flag.under_way == (8, 0)
