"""An error that nobody expects ends a run with its traceback, and the file says that it failed."""

import pytest
from campaign_runs import TINY, assert_sound, finish, invert, state, write_campaign

from agglom_mpi.runtime.coordinator import Coordinator
from agglom_mpi.runtime.task_runner import SampleTask

ENDS = {
    SystemExit: ("failed", "RuntimeError: the simulating thread ended with SystemExit"),
    KeyboardInterrupt: ("failed", "RuntimeError: the simulating thread ended with Keyb"),
    ZeroDivisionError: ("failed", "ZeroDivisionError: unexpected"),
}


@pytest.mark.parametrize("error", ENDS)
def test_whatever_ends_the_simulating_thread_ends_the_run_as_failed(tmp_path, monkeypatch, error):
    write_campaign(tmp_path / "tiny.yaml", **TINY)

    def collect(self):
        raise error("unexpected")

    with monkeypatch.context() as patch:
        patch.setattr(SampleTask, "collect", collect)
        with pytest.raises((RuntimeError, ZeroDivisionError)):
            invert(tmp_path, "tiny.yaml")
    said, reason = state(tmp_path / "tiny.h5")
    assert (said, reason[: len(ENDS[error][1])]) == ENDS[error]
    finish(tmp_path, "tiny.yaml")
    assert_sound(tmp_path / "tiny.h5")


def test_an_interrupt_of_the_main_thread_leaves_a_stopped_run(tmp_path, monkeypatch):
    write_campaign(tmp_path / "tiny.yaml", **TINY)

    def run(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Coordinator, "run", run)
        invert(tmp_path, "tiny.yaml")
    assert state(tmp_path / "tiny.h5")[0] == "stopped"
    finish(tmp_path, "tiny.yaml")
