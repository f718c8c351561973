"""What rank 0 makes of the programs that the other ranks say they run."""

from types import SimpleNamespace

import numpy as np
import pytest

from agglom_mpi.runtime import launch
from agglom_mpi.runtime.launch import (
    GIVEN_UP_AFTER,
    NOTED_AFTER,
    RECORD,
    LaunchError,
    MixedJobError,
    Start,
    own_program,
    receive_programs,
    receive_start,
    refuse_others,
)


def test_many_other_ranks_are_counted():
    found = ["1.0 abc node0"] * 2 + ["1.1 abc node1"] * 5000
    with pytest.raises(LaunchError, match=r"rank 2 on node1, and 4999 more ranks .* 1\.1 .* 1\.0"):
        refuse_others(found)
    refuse_others(["1.0 abc node0", "1.0 abc node 1"])


class World:
    """Ranks, of which each sends its program at a time in s, or never."""

    def __init__(self, times, clock):
        self.size, self._times, self._clock = 1 + len(times), times, clock

    def Irecv(self, record, source, tag):  # noqa: N802
        def arrived():
            done = self._clock.now >= self._times[source - 1]
            if done:
                record[:3] = list(b"abc")
            return done

        return SimpleNamespace(Test=arrived)


@pytest.fixture
def clock(monkeypatch):
    """Replace time by one that passes while the code sleeps, 1000 times as fast."""
    clock = SimpleNamespace(now=0.0, monotonic=lambda: clock.now)

    def sleep(seconds):
        clock.now += 1e3 * seconds

    clock.sleep = sleep
    monkeypatch.setattr(launch, "time", clock)
    return clock


def test_ranks_that_load_for_minutes_are_waited_for(clock):
    found, shown = np.zeros(4, RECORD), []
    receive_programs(
        World([0.0, NOTED_AFTER + 60.0, GIVEN_UP_AFTER - 60.0], clock), found, shown.append
    )
    assert found.tolist() == [b"", b"abc", b"abc", b"abc"]
    assert shown == ["waiting for the first message from rank 2, 3"]


def test_ranks_that_never_say_what_they_are_are_named(clock):
    times = [0.0, *8 * [np.inf]]
    named = r"no first message from rank 2, 3, 4, 5, 6 and 3 more ranks in 15 min"
    with pytest.raises(MixedJobError, match=named):
        receive_programs(World(times, clock), np.zeros(10, RECORD), lambda line: None)


def test_a_start_of_another_rank_zero_is_refused():
    def received(sent):
        return receive_start(SimpleNamespace(rank=1, bcast=lambda *_, **__: sent))

    same, nothing = (
        Start(own_program(), 0, "experiment", None),
        Start("0.0.9 abc node", 2, None, None),
    )
    assert received(tuple(same)) == same
    assert received(tuple(nothing)) == nothing
    for other in [("0.0.9 abc node", 0, "experiment", None), (0, "experiment", None), None]:
        with pytest.raises(MixedJobError, match="rank 0 runs another program"):
            received(other)
