"""Rank 0 sends heartbeats to ranks that hear nothing else, and not to those that take none in."""

import threading
from types import SimpleNamespace

import pytest
from processes import HANG

from agglom_mpi.runtime import silence as module
from agglom_mpi.runtime.messages import ALIVE
from agglom_mpi.runtime.silence import BEAT_EVERY, LOOKS_PER_BEAT, Heart

pytest.importorskip("mpi4py.MPI", exc_type=ImportError)


class World:
    """Three ranks that take in what they are sent, except those that are `lost`."""

    size = 3

    def __init__(self):
        self.sent, self.lost = [], set()
        self.arrived = threading.Event()

    def Isend(self, buffer, dest, tag):  # noqa: N802
        assert tag == ALIVE
        assert buffer[0]["wakeup"][0] == b""
        self.sent.append(dest)
        self.arrived.set()
        return SimpleNamespace(Test=lambda: dest not in self.lost)


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock.now))
    return clock


def test_ranks_that_have_got_nothing_for_long_get_a_heartbeat(clock):
    world = World()
    heart = Heart(world, threading.RLock(), threaded=False)
    heart.beat()
    assert world.sent == []
    clock.now += BEAT_EVERY
    heart.sent(1)
    heart.beat()
    assert world.sent == [2]
    clock.now += BEAT_EVERY
    heart.beat()
    assert world.sent == [2, 1, 2]


def test_a_rank_that_takes_none_in_gets_no_other(clock):
    world = World()
    heart = Heart(world, threading.RLock(), threaded=False)
    world.lost.add(1)
    for _ in range(3):
        clock.now += BEAT_EVERY
        heart.beat()
    assert world.sent == [1, 2, 2, 2]
    world.lost.clear()
    clock.now += BEAT_EVERY
    heart.beat()
    assert world.sent[4:] == [1, 2]


def test_a_rank_that_may_have_ended_gets_none(clock):
    world = World()
    heart = Heart(world, threading.RLock(), threaded=False, remote={1, 2})
    heart.gone.add([1])
    clock.now += BEAT_EVERY
    heart.beat()
    assert world.sent == [2]


def test_without_a_thread_whoever_serves_messages_sends_them(clock):
    world = World()
    heart = Heart(world, threading.RLock(), threaded=False)
    heart.beat_if_due()
    clock.now += 2.0 * BEAT_EVERY
    heart.beat_if_due()
    heart.beat_if_due()
    assert world.sent == [1, 2]
    heart.stop()


def test_a_thread_sends_them_while_nobody_else_calls_mpi(monkeypatch):
    monkeypatch.setattr(module, "BEAT_EVERY", 1e-3 * LOOKS_PER_BEAT)
    monkeypatch.setattr(module, "may_call_in_turn", lambda: True)
    world, lock = World(), threading.RLock()
    with lock:
        heart = Heart(world, lock, threaded=True)
        assert not world.arrived.wait(0.05)
    assert world.arrived.wait(HANG)
    heart.stop()
    before = len(world.sent)
    heart.beat_if_due()
    assert len(world.sent) == before
