"""Who is silent is named once, by its host; whoever could not be heard is not."""

import math
from types import SimpleNamespace

import pytest

from agglom_mpi.runtime import abort_flag
from agglom_mpi.runtime.messages import RankMessage
from agglom_mpi.runtime.silence import (
    ALIVE_EVERY,
    BEAT_EVERY,
    NAMED_AFTER,
    RANKS_AT_THIS_PACE,
    REASSIGNED_AFTER,
    STALLED_AFTER,
    GoneRanks,
    RankWatch,
    pace,
)

HOSTS = {0: "a", 1: "a", 2: "a", 3: "b", 4: "b"}


class Ranks:
    """A watch whose time a test sets, the ranks that it hears, and what it shows."""

    def __init__(self, monkeypatch, hosts=HOSTS):
        self.time, self.shown, self.marks = 100.0, [], []
        self.in_flight = self
        monkeypatch.setattr(abort_flag, "time", SimpleNamespace(monotonic=lambda: self.time))
        self.gone = GoneRanks({3, 4} if hosts is HOSTS else (), beat_every=BEAT_EVERY)
        self.watch = RankWatch(len(hosts), hosts, self.shown.append, self.gone)
        self.present = set(hosts)

    def heartbeat(self, rank, now):
        self.present.add(rank)
        return False

    def mark_silent(self, now, timeout):
        self.marks.append(timeout)
        return []

    def hear(self, *ranks, **what):
        self.watch.hear(self, [RankMessage(rank, **what) for rank in ranks], self.watch.now())

    def wait(self, seconds, *heard):
        """Let time pass while some ranks are heard; the ranks that are named at the end."""
        for _ in range(round(2 * seconds)):
            self.time += 0.5
            self.hear(*heard)
            found = self.watch.check(self, self.watch.now())
        return found


@pytest.fixture
def ranks(monkeypatch):
    return Ranks(monkeypatch)


def test_a_silent_rank_is_named_once_with_its_host(ranks):
    assert ranks.wait(NAMED_AFTER - 0.5, 2, 3, 4) == []
    assert ranks.wait(0.5, 2, 3, 4) == [1]
    assert ranks.wait(2 * NAMED_AFTER, 2, 3, 4) == []
    assert ranks.shown == ["rank 1 on a has not been heard of for 15 s; others do its work"]
    assert ranks.watch.silent == {1}


def test_its_work_is_given_to_others_before_it_is_named(ranks):
    ranks.wait(1.0, 1, 2, 3, 4)
    assert set(ranks.marks) == {REASSIGNED_AFTER} == {NAMED_AFTER / 3}


def test_a_rank_that_is_heard_again_is_welcome(ranks):
    ranks.wait(NAMED_AFTER, 2, 3, 4)
    ranks.hear(1)
    assert ranks.shown[1:] == ["rank 1 on a is back"]
    assert not ranks.watch.silent


def test_a_lost_host_is_named_in_one_line_though_its_ranks_were_heard_at_other_times(ranks):
    ranks.wait(ALIVE_EVERY, 1, 2, 4)
    assert ranks.wait(NAMED_AFTER - ALIVE_EVERY, 1, 2) == [3, 4]
    text = "host b (rank 3, 4) has not been heard of for 15 s; others do its work"
    assert ranks.shown == [text]


def test_several_ranks_of_a_host_that_is_not_lost_are_one_line(ranks):
    assert ranks.wait(NAMED_AFTER, 3, 4) == [1, 2]
    text = "rank 1, 2 on a have not been heard of for 15 s; others do their work"
    assert ranks.shown == [text]


def test_a_rank_that_was_never_heard_is_named_without_a_host(monkeypatch):
    ranks = Ranks(monkeypatch)
    ranks.watch = RankWatch(3, {0: "a"}, ranks.shown.append, GoneRanks())
    assert ranks.wait(NAMED_AFTER, 1) == [2]
    assert ranks.shown == ["rank 2 has not been heard of for 15 s; others do its work"]


def test_a_rank_elsewhere_that_was_silent_for_long_gets_no_work_again(ranks):
    ranks.wait(ranks.gone.after - 0.5, 2, 4)
    assert not ranks.gone.include(3)
    ranks.wait(0.5, 2, 4)
    assert [ranks.gone.include(rank) for rank in (1, 3, 4)] == [False, True, False]
    ranks.present.clear()
    ranks.hear(1, 3)
    assert ranks.present == {1}
    assert ranks.watch.silent == {3}
    assert ranks.shown[-1] == "rank 1 on a is back"


def test_nobody_is_silent_while_rank_0_does_not_listen(ranks):
    ranks.wait(1.0, 1, 2, 3, 4)
    for _ in range(5):
        ranks.time += 100 * NAMED_AFTER
        assert ranks.watch.check(ranks, ranks.watch.now()) == []
        ranks.hear(1, 2, 3, 4)
    assert ranks.shown == []


def test_a_rank_that_writes_may_be_silent_for_long_and_keeps_its_work(ranks):
    ranks.hear(1, writes=True)
    ranks.present.clear()
    assert ranks.wait(STALLED_AFTER - 0.5, 2, 3, 4) == []
    assert 1 in ranks.present
    assert ranks.wait(0.5, 2, 3, 4) == [1]
    assert ranks.shown == ["rank 1 on a has not been heard of for 600 s; others do its work"]


def test_a_rank_that_has_written_may_not(ranks):
    ranks.hear(1, writes=True)
    ranks.hear(1)
    assert ranks.wait(NAMED_AFTER, 2, 3, 4) == [1]


def test_many_ranks_send_fewer_heartbeats_and_have_more_time():
    assert (pace(RANKS_AT_THIS_PACE), pace(3 * RANKS_AT_THIS_PACE)) == (1.0, 3.0)


def test_the_intervals_fit_each_other():
    assert 3 * ALIVE_EVERY < REASSIGNED_AFTER < NAMED_AFTER < STALLED_AFTER < math.inf
