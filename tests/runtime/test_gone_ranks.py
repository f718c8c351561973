"""Rank 0 sends nothing to ranks on other hosts that may have ended as they did not hear it."""

import math
from types import SimpleNamespace

import pytest

from agglom_mpi.runtime import silence as module
from agglom_mpi.runtime.silence import (
    ALIVE_EVERY,
    BEAT_EVERY,
    LOOKS_PER_BEAT,
    NAMED_AFTER,
    GoneRanks,
)
from agglom_mpi.runtime.watches import CUT_OFF_AFTER, ENDS_AFTER


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock.now))
    return clock


@pytest.fixture
def gone(clock):
    return GoneRanks({2, 3}, beat_every=BEAT_EVERY)


def test_rank_0_stops_sending_before_a_rank_may_have_ended(gone):
    """Its last heartbeat may be so old, and it may look so much later, when the link is cut."""
    latest = gone.after + BEAT_EVERY + BEAT_EVERY / LOOKS_PER_BEAT
    assert NAMED_AFTER + ALIVE_EVERY < gone.after < latest < CUT_OFF_AFTER
    without_beats = GoneRanks({2}, beats=False, beat_every=BEAT_EVERY)
    assert CUT_OFF_AFTER < without_beats.after < ENDS_AFTER - BEAT_EVERY
    assert GoneRanks().after == math.inf


def test_only_silent_ranks_on_other_hosts_are_gone(gone):
    assert gone.add([1, 2]) == [2]
    assert gone.add([1, 2]) == []
    assert [gone.include(rank) for rank in (1, 2, 3)] == [False, True, False]
    assert not gone.suspended


def test_all_ranks_on_other_hosts_are_gone_when_rank_0_was_suspended(clock, gone):
    clock.now += gone.after - 1.0
    assert not gone.include(2)
    clock.now += gone.after
    assert [gone.include(rank) for rank in (1, 2, 3)] == [False, True, True]
    assert gone.suspended


def test_nobody_is_gone_on_one_host(clock):
    gone = GoneRanks()
    clock.now += 1e9
    assert not gone.include(1)
    assert not gone.suspended
