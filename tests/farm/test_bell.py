"""A bell wakes whoever waits for it, at once, from any thread or process."""

import subprocess
import sys
import threading
import time

import pytest

from agglom_mpi.farm import bell as module
from agglom_mpi.farm.bell import Bell

SOON = 5.0
"""Seconds that nothing here takes, unless it waits for the end of a wait of a minute."""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="bells have names on Linux only")


def test_without_a_ring_it_waits_as_long_as_it_was_told():
    bell = Bell()
    for seconds in (0.0, 3e-4, 0.05):
        begun = time.monotonic()
        assert not bell.wait(seconds)
        assert time.monotonic() - begun >= seconds


def test_a_ring_before_the_wait_is_heard_once():
    bell = Bell()
    bell.ring()
    begun = time.monotonic()
    assert bell.wait(60.0)
    assert time.monotonic() - begun < SOON
    assert not bell.wait(0.0)


def test_many_rings_are_heard_as_one_and_nobody_who_rings_waits():
    bell, other = Bell(), Bell()
    for _ in range(10_000):
        bell.ring()
        assert other.ring_at(bell.name)
    assert bell.wait(0.0)
    assert not bell.wait(0.0)


@pytest.mark.parametrize("by_name", [False, True])
def test_a_ring_of_another_thread_ends_the_wait(by_name):
    bell, other = Bell(), Bell()
    ring = (lambda: other.ring_at(bell.name)) if by_name else bell.ring
    begun = time.monotonic()
    threading.Timer(0.1, ring).start()
    assert bell.wait(60.0)
    assert 0.1 <= time.monotonic() - begun < SOON


def test_no_ring_is_lost_between_a_look_and_a_wait():
    """Whoever rings has put down what he rings for; it is found after the wait."""
    bell, found, put = Bell(), 0, []

    def work():
        for number in range(20_000):
            put.append(number)
            bell.ring()

    thread = threading.Thread(target=work)
    thread.start()
    while found < 20_000:
        begun = time.monotonic()
        bell.wait(60.0)
        assert time.monotonic() - begun < SOON
        found = len(put)
    thread.join()


def test_another_process_rings_and_its_own_bell_is_gone_with_it():
    bell = Bell()
    code = (
        "import sys; from agglom_mpi.farm.bell import Bell; bell = Bell();"
        f"print(bell.ring_at({bell.name!r}), bell.name)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    heard, name = done.stdout.split()
    assert heard == "True"
    assert bell.wait(0.0)
    assert not bell.ring_at(eval(name))


@pytest.mark.parametrize("name", [b"", b"\0agglom-nobody", b"/no/such/file", b"x" * 500])
def test_a_bell_that_is_not_on_this_machine_is_not_rung(name):
    assert not Bell().ring_at(name)


def test_names_differ():
    assert len({Bell().name for _ in range(100)}) == 100


def test_where_bells_have_no_names_a_process_rings_its_own(monkeypatch):
    monkeypatch.setattr(module.sys, "platform", "elsewhere")
    bell = Bell()
    assert bell.name == b""
    bell.ring()
    assert bell.wait(60.0)
    assert not bell.wait(0.0)
