import signal
from types import SimpleNamespace

import pytest

from agglom_mpi.runtime import stop_request as clock
from agglom_mpi.runtime.stop_request import StopRequest, ignore_signals

ALL = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)


@pytest.fixture(autouse=True)
def handlers():
    """Put the signal handlers of the test runner back."""
    kept = {number: signal.getsignal(number) for number in ALL}
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the test runner may be one under nohup
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.fixture
def now(monkeypatch):
    """Replace the time by one that a test sets: `now.seconds`."""
    now = SimpleNamespace(seconds=100.0)
    monkeypatch.setattr(clock, "time", SimpleNamespace(monotonic=lambda: now.seconds))
    return now


def test_nobody_asked_to_stop():
    assert StopRequest().reason == ""


def test_the_deadline_is_a_reason_once_it_is_reached(now):
    stop = StopRequest(3600.0)
    now.seconds += 3599.0
    assert stop.reason == ""
    now.seconds += 1.0
    assert stop.reason == "the walltime limit is reached"


@pytest.mark.parametrize("number", ALL)
def test_a_signal_is_a_reason_and_kills_nobody(number):
    stop = StopRequest(3600.0)
    stop.listen()
    signal.raise_signal(number)
    assert stop.reason == f"received {number.name}"


def test_under_nohup_a_hangup_stops_nothing():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    stop = StopRequest(3600.0)
    stop.listen()
    signal.raise_signal(signal.SIGHUP)
    assert stop.reason == ""


def test_the_reason_stays_after_a_deadline_passed_too(now):
    stop = StopRequest(3600.0)
    stop.listen()
    signal.raise_signal(signal.SIGUSR1)
    now.seconds += 7200.0
    assert stop.reason == "received SIGUSR1"


@pytest.mark.parametrize("again", ALL)
@pytest.mark.parametrize("number", ALL)
def test_a_second_signal_within_a_second_is_ignored(now, number, again):
    stop = StopRequest()
    stop.listen()
    signal.raise_signal(number)
    now.seconds += 0.9
    signal.raise_signal(again)
    assert stop.reason == f"received {number.name}"


@pytest.mark.parametrize("again", ALL[1:])
def test_later_only_an_interrupt_is_another_request(now, again):
    stop = StopRequest()
    stop.listen()
    signal.raise_signal(signal.SIGTERM)
    now.seconds += 1.1
    signal.raise_signal(again)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert stop.reason == "received SIGTERM"
    assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL  # the third one waits for nothing


def test_the_first_interrupt_after_the_walltime_ends_nothing(now):
    stop = StopRequest(10.0)
    stop.listen()
    now.seconds += 10.0
    assert stop.reason == "the walltime limit is reached"
    now.seconds += 5.0
    signal.raise_signal(signal.SIGINT)
    assert stop.reason == "the walltime limit is reached"


def test_workers_ignore_what_the_first_rank_listens_to():
    ignore_signals()
    for number in ALL:
        signal.raise_signal(number)
    assert [signal.getsignal(number) for number in ALL] == [signal.SIG_IGN] * len(ALL)
