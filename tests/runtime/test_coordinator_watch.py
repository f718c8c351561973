"""A rank knows when it heard rank 0 last, and leaves when that is too long ago."""

from types import SimpleNamespace

import pytest

from agglom_mpi.runtime import abort_flag, watches
from agglom_mpi.runtime.silence import BEAT_EVERY
from agglom_mpi.runtime.watches import (
    CUT_OFF_AFTER,
    ENDS_AFTER,
    NAMED_AFTER,
    CoordinatorWatch,
    patience,
)

ELSEWHERE = patience(same_host=False, beats=True)


class Rank:
    """A rank whose time a test sets, what it reports, and whether it has left."""

    def __init__(self, monkeypatch, patience=ELSEWHERE, speaks=True):
        self.time, self.shown, self.left = 100.0, [], []
        clock = SimpleNamespace(monotonic=lambda: self.time)
        monkeypatch.setattr(abort_flag, "time", clock)
        monkeypatch.setattr(watches, "LOOKED_EVERY", 1e6)
        monkeypatch.setattr(watches, "leave", self.left.append)
        monkeypatch.setattr(watches, "own_host", lambda: b"b")
        write = SimpleNamespace(write=lambda _, text: self.shown.append(text.decode()))
        monkeypatch.setattr(watches, "os", write)
        self.watch = CoordinatorWatch(3, patience, speaks=speaks)
        self.watch.hear()

    def wait(self, seconds):
        """Let time pass until the rank leaves."""
        for _ in range(round(2 * seconds)):
            self.time += 0.5
            if not self.left:
                self.watch.look()


@pytest.fixture
def rank(monkeypatch):
    rank = Rank(monkeypatch)
    yield rank
    rank.watch.stop()


def test_a_silent_rank_0_is_reported_once_and_then_the_rank_leaves(rank):
    rank.wait(NAMED_AFTER - 0.5)
    assert rank.shown == []
    rank.wait(CUT_OFF_AFTER - NAMED_AFTER)
    assert not rank.left
    rank.wait(0.5)
    assert rank.left == [1]
    assert rank.shown == [
        "rank 3 on b: rank 0 has not been heard of for 15 s; in 35 s the ranks of this host end\n",
        "rank 3 on b: rank 0 has not been heard of for 50 s: the ranks of this host end; run the "
        "same command again to go on\n",
    ]


def test_others_of_its_host_leave_without_a_word_and_not_before_it(monkeypatch):
    rank = Rank(monkeypatch, speaks=False)
    rank.wait(CUT_OFF_AFTER + 0.5)
    assert not rank.left
    rank.wait(1.0)
    assert rank.left == [1]
    assert rank.shown == []


def test_rank_0_may_come_back(rank):
    rank.wait(NAMED_AFTER)
    rank.watch.hear()
    rank.wait(CUT_OFF_AFTER - 1.0)
    assert rank.shown[1] == "rank 3 on b: rank 0 is back\n"
    assert not rank.left


def test_a_rank_that_was_stopped_itself_has_missed_nothing(rank):
    for _ in range(5):
        rank.time += 1e6
        rank.watch.look()
    assert rank.shown == []


def test_a_rank_that_writes_to_the_file_does_not_listen(rank):
    rank.watch.listen(False)
    rank.wait(2 * ENDS_AFTER)
    assert rank.shown == []
    rank.watch.listen(True)
    rank.wait(NAMED_AFTER)
    assert len(rank.shown) == 1


def test_before_its_first_message_rank_0_may_take_long(monkeypatch):
    rank = Rank(monkeypatch)
    rank.watch._met = False
    rank.wait(ENDS_AFTER - 1.0)
    assert (rank.shown, rank.left) == ([], [])
    rank.wait(1.0)
    assert rank.left == [1]


def test_ranks_on_the_host_of_rank_0_and_where_it_sends_no_heartbeats_have_longer():
    assert ELSEWHERE == (NAMED_AFTER, CUT_OFF_AFTER)
    assert patience(same_host=True, beats=True) == (NAMED_AFTER, ENDS_AFTER)
    for same_host in (True, False):
        assert patience(same_host=same_host, beats=False) == (ENDS_AFTER / 2, ENDS_AFTER)


def test_all_have_left_within_a_minute_after_a_connection_was_lost():
    assert 2 * BEAT_EVERY < NAMED_AFTER
    assert CUT_OFF_AFTER + 2.0 < 60.0
