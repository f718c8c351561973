"""A rank notices that its launcher is gone, and nothing else."""

import os
import threading

import pytest
from processes import HANG

from agglom_mpi.launcher import launching_process
from agglom_mpi.runtime import watches
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.watches import LauncherWatch


@pytest.fixture
def proc(tmp_path, monkeypatch):
    """Return a folder of processes; this one is 50, below 40, 30 and 1."""
    monkeypatch.setattr(os, "getpid", lambda: 50)
    monkeypatch.setattr(os, "getppid", lambda: parents(tmp_path)[0])
    put(tmp_path, 50, 40, "python")
    put(tmp_path, 40, 30, "bash (a) b")
    put(tmp_path, 30, 1, "hydra_pmi_proxy")
    return tmp_path


def put(proc, pid, parent, name):
    """Add a process, or change it."""
    (proc / str(pid)).mkdir(exist_ok=True)
    (proc / str(pid) / "stat").write_text(f"{pid} ({name}) S {parent} 0 0\n")
    (proc / str(pid) / "comm").write_text(f"{name}\n")


def parents(proc, pid=50):
    text = (proc / str(pid) / "stat").read_text()
    return [int(text.rpartition(")")[2].split()[1])]


@pytest.fixture
def watch(proc, monkeypatch):
    monkeypatch.setattr(watches, "CHECKED_EVERY", 1e6)
    watch = LauncherWatch(lambda: None, proc)
    yield watch
    watch._ended.set()


def is_gone(watch):
    watch.look()
    return watch.gone


def test_the_launcher_is_found_above_a_shell(proc):
    assert launching_process(proc) == 30
    put(proc, 30, 1, "sshd")
    assert launching_process(proc) == 40, "the parent, if no launcher is known"


def test_nothing_is_gone_while_all_are_there(watch):
    assert not is_gone(watch)


def test_a_launcher_is_missed_though_the_shell_below_it_is_there(watch, proc):
    put(proc, 40, 1, "bash")
    assert is_gone(watch)


def test_a_launcher_is_missed_if_there_is_another_one_above(watch, proc):
    put(proc, 20, 1, "slurmstepd")
    put(proc, 40, 20, "bash")
    assert is_gone(watch)


def test_a_shell_is_not_missed_where_the_launcher_takes_its_children(watch, proc):
    put(proc, 50, 30, "python")
    assert not is_gone(watch)


def test_an_unknown_launcher_is_missed_if_it_is_the_parent(proc, monkeypatch):
    monkeypatch.setattr(watches, "CHECKED_EVERY", 1e6)
    put(proc, 30, 1, "other")
    watch = LauncherWatch(lambda: None, proc)
    assert not is_gone(watch)
    put(proc, 50, 1, "python")
    assert is_gone(watch)


def test_a_system_that_does_not_show_processes_shows_the_parent(tmp_path, monkeypatch):
    monkeypatch.setattr(watches, "CHECKED_EVERY", 1e6)
    watch = LauncherWatch(lambda: None, tmp_path / "none")
    assert not is_gone(watch)
    monkeypatch.setattr(os, "getppid", lambda: 1)
    assert is_gone(watch)


def test_a_process_that_ends_meanwhile_decides_nothing(watch, proc):
    (proc / "40" / "stat").unlink()
    assert not is_gone(watch)


def test_who_is_without_a_launcher_stops_and_then_is_ended(proc, monkeypatch):
    ended, codes = threading.Event(), []
    monkeypatch.setattr(watches, "CHECKED_EVERY", 1e-3)
    monkeypatch.setattr(watches, "TIME_TO_STOP", 1e-3)
    monkeypatch.setattr(watches, "leave", lambda code: (codes.append(code), ended.set()))
    stop = StopRequest()
    LauncherWatch(lambda: stop.request("the launcher is gone"), proc)
    put(proc, 40, 1, "bash")
    assert ended.wait(HANG)
    assert stop.reason == "the launcher is gone"
    assert codes == [1]


def test_an_end_without_a_launcher_is_one_without_mpi(watch, proc, monkeypatch):
    codes = []
    monkeypatch.setattr(watches, "leave", codes.append)
    watch.end(0)
    assert codes == []
    put(proc, 40, 1, "bash")
    watch.end(75)
    assert codes == [75]
