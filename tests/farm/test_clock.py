import os
import signal
import time

import pytest

from agglom_mpi.farm import clock
from agglom_mpi.farm.clock import StopRequest, ignore_signals

ALL = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)


@pytest.fixture(autouse=True)
def handlers():
    """Put the signal handlers of the test runner back."""
    kept = {number: signal.getsignal(number) for number in ALL}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


def test_nobody_asked_to_stop():
    assert StopRequest().reason == ""


def test_the_deadline_is_a_reason_once_it_is_reached(monkeypatch):
    now = time.monotonic()
    stop = StopRequest(3600.0)
    assert stop.reason == ""
    monkeypatch.setattr(clock.time, "monotonic", lambda: now + 3601.0)
    assert stop.reason == "the walltime limit is reached"


@pytest.mark.parametrize("number", ALL)
def test_a_signal_is_a_reason_and_kills_nobody(number):
    stop = StopRequest(3600.0)
    stop.listen()
    os.kill(os.getpid(), number)
    assert stop.reason == f"received {number.name}"


def test_the_reason_stays_after_a_deadline_passed_too(monkeypatch):
    stop = StopRequest(3600.0)
    stop.listen()
    os.kill(os.getpid(), signal.SIGUSR1)
    later = time.monotonic() + 7200.0
    monkeypatch.setattr(clock.time, "monotonic", lambda: later)
    assert stop.reason == "received SIGUSR1"


def test_workers_ignore_what_the_first_rank_listens_to():
    ignore_signals()
    for number in ALL:
        os.kill(os.getpid(), number)
    assert [signal.getsignal(number) for number in ALL] == [signal.SIG_IGN] * 3
