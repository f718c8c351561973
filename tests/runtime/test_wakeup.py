"""A wakeup wakes the thread or process that waits, at once, from any other."""

import sys
import threading

import pytest
from processes import output_of, program

from agglom_mpi.runtime import wakeup as module
from agglom_mpi.runtime.wakeup import Wakeup

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="wakeups have names on Linux only")


class Poll:
    """Waits as the poll of a wakeup, and records how long, in ms, and whether a ring ended it."""

    def __init__(self, wakeup, before=lambda: None):
        self._poll, wakeup._poll = wakeup._poll, self
        self._before = before
        self.waits, self.rung = [], []

    def poll(self, milliseconds):
        self._before()
        self.waits.append(milliseconds)
        self.rung.append(bool(self._poll.poll(milliseconds)))


def test_without_a_ring_it_waits_as_long_as_it_was_told(monkeypatch):
    slept = []
    monkeypatch.setattr(module.time, "sleep", slept.append)
    wakeup = Wakeup()
    poll = Poll(wakeup)
    for seconds in (0.0, 3e-4, 0.001, 0.05):
        assert not wakeup.wait(seconds)
    assert (slept, poll.waits, poll.rung) == ([0.0, 3e-4], [1, 50], [False, False])


def test_a_ring_before_the_wait_is_heard_once():
    wakeup = Wakeup()
    poll = Poll(wakeup)
    wakeup.ring()
    assert wakeup.wait(60.0)
    assert poll.rung == [True]
    assert not wakeup.wait(0.0)


def test_many_rings_are_heard_as_one_and_nobody_who_rings_waits():
    wakeup, other = Wakeup(), Wakeup()
    for _ in range(10_000):
        wakeup.ring()
        assert other.ring_at(wakeup.name)
    assert wakeup.wait(0.0)
    assert not wakeup.wait(0.0)


@pytest.mark.parametrize("by_name", [False, True])
def test_a_ring_of_another_thread_ends_the_wait(by_name):
    wakeup, other = Wakeup(), Wakeup()
    ring = (lambda: other.ring_at(wakeup.name)) if by_name else wakeup.ring
    thread = threading.Thread(target=ring)
    poll = Poll(wakeup, before=thread.start)
    assert wakeup.wait(60.0)
    assert poll.rung == [True]
    thread.join()


def test_no_ring_is_lost_between_a_look_and_a_wait():
    """Whoever rings has put down what he rings for; it is found after the wait."""
    wakeup, found, put = Wakeup(), 0, []
    poll = Poll(wakeup)

    def work():
        for number in range(20_000):
            put.append(number)
            wakeup.ring()

    thread = threading.Thread(target=work)
    thread.start()
    while found < 20_000:
        wakeup.wait(60.0)
        assert poll.rung[-1]
        found = len(put)
    thread.join()


def test_another_process_rings_and_its_own_bell_is_gone_with_it():
    wakeup = Wakeup()
    code = (
        "import sys; from agglom_mpi.runtime.wakeup import Wakeup; wakeup = Wakeup();"
        f"print(wakeup.ring_at({wakeup.name!r}), wakeup.name)"
    )
    with program([sys.executable, "-c", code]) as process:
        heard, name = output_of(process)[0].split()
    assert heard == "True"
    assert wakeup.wait(0.0)
    assert not wakeup.ring_at(eval(name))


@pytest.mark.parametrize("name", [b"", b"\0agglom-nobody", b"/no/such/file", b"x" * 500])
def test_a_bell_that_is_not_on_this_machine_is_not_rung(name):
    assert not Wakeup().ring_at(name)


def test_names_differ():
    assert len({Wakeup().name for _ in range(100)}) == 100


def test_where_bells_have_no_names_a_process_rings_its_own(monkeypatch):
    monkeypatch.setattr(module.sys, "platform", "elsewhere")
    wakeup = Wakeup()
    assert wakeup.name == b""
    wakeup.ring()
    assert wakeup.wait(60.0)
    assert not wakeup.wait(0.0)
