import pytest

from agglom_mpi.runtime import wakeup as waiting
from agglom_mpi.runtime.wakeup import LONGEST, QUIET, SHORTEST, PollBackoff


class Clock:
    """Time that passes only while somebody waits."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    fake = Clock()
    monkeypatch.setattr(waiting, "time", fake)
    return fake


def looks(clock, wait, between, times):
    """Look for mail that comes at regular times; how often until each came, at the end."""
    counts, due = [], clock.now
    for _ in range(times):
        due += between
        count = 0
        while clock.now < due:
            clock.now += wait.seconds
            count += 1
            wait.polled(clock.now >= due)
        counts.append(count)
    return counts[-10:]


def test_without_mail_the_longest_wait_is_reached_within_a_dozen_looks(clock):
    wait = PollBackoff()
    for _ in range(12):
        wait.polled(False)
    assert wait.seconds == LONGEST


def test_regular_mail_is_looked_for_a_few_times_and_found_soon(clock):
    assert max(looks(clock, PollBackoff(), 5e-3, 200)) <= 6
    assert max(looks(clock, PollBackoff(), SHORTEST, 200)) == 1


def test_mail_that_comes_fast_again_is_found_fast_again(clock):
    wait = PollBackoff()
    looks(clock, wait, 0.1, 50)
    assert wait.seconds == LONGEST
    for _ in range(100):  # there is mail whenever it looks
        clock.now += wait.seconds
        wait.polled(True)
    assert wait.seconds == SHORTEST


def test_two_that_answer_each_other_at_once_wait_ever_shorter(clock):
    one, other = PollBackoff(), PollBackoff()
    for each in (one, other):
        looks(clock, each, 0.05, 50)
    for _ in range(100):
        for each in (one, other):
            clock.now += each.seconds
            each.polled(True)
    assert one.seconds == other.seconds == SHORTEST


def test_where_all_who_send_also_ring_it_waits_for_the_bell(clock):
    wait = PollBackoff()
    for found in (False, True, False, True, True):
        wait.polled(found, rung=found)
        assert wait.timeout(woken=True) == QUIET
        assert wait.timeout(woken=False) == wait.seconds <= LONGEST


def test_after_a_bell_without_mail_it_looks_again_soon(clock):
    wait = PollBackoff()
    wait.polled(False, rung=True)
    assert wait.timeout(woken=True) == LONGEST
    wait.polled(False, rung=False)
    assert wait.timeout(woken=True) == QUIET
