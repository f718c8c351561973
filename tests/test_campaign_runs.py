"""A campaign that Python runs: it decides as the command does, and leaves the process as it was."""

import os
import signal
import sys
import threading

import pytest
from campaign_runs import (
    SMALL,
    Gate,
    assert_same,
    assert_sound,
    decisions,
    environment,
    need_mpirun,
    state,
    wait_until,
    write_campaign,
)
from processes import program, wait_until_gone

import agglom_mpi
from agglom_mpi.campaign_file import CampaignFile
from agglom_mpi.campaign_runs import RANKS_PER_CORE
from agglom_mpi.runtime import invert as python_runs
from agglom_mpi.runtime.coordinator import IDLE_LEGS
from agglom_mpi.runtime.invert import RunFailedError
from agglom_mpi.runtime.stop_request import stop_signals
from agglom_mpi.storage.lock import CampaignLock

RUNS_SMALL = """
import agglom_mpi
agglom_mpi.load_campaign("small.yaml").run(ranks=2, progress=False)
"""


@pytest.fixture
def campaign(tmp_path):
    return agglom_mpi.load_campaign(write_campaign(tmp_path / "small.yaml", **SMALL))


@pytest.fixture
def expected(shared_campaign):
    return decisions(shared_campaign("small") / "small.h5")


def test_a_run_decides_as_the_command_does(campaign, expected, tmp_path, capfd):
    before = {number: signal.getsignal(number) for number in stop_signals()}
    file = campaign.run(tmp_path / "own.h5", progress=False)
    assert isinstance(file, CampaignFile)
    assert file.path == tmp_path / "own.h5"
    assert file.status().state == "finished"
    assert_same(file.path, expected)
    assert_sound(file.path)
    assert capfd.readouterr() == ("", "")
    assert {number: signal.getsignal(number) for number in stop_signals()} == before
    assert campaign.run(file.path, progress=False).status() == file.status()


def test_a_run_that_is_stopped_goes_on(campaign, expected, tmp_path):
    path = tmp_path / "own.h5"
    assert campaign.run(path, progress=False, max_walltime=1e-9).status().state == "stopped"
    assert campaign.run(path, progress=False).status().state == "finished"
    assert_same(path, expected)


def test_ranks_decide_as_one_process_does(campaign, expected, tmp_path, capfd):
    need_mpirun()
    file = campaign.run(tmp_path / "own.h5", ranks=2, progress=False)
    assert_same(file.path, expected)
    assert_sound(file.path)
    assert capfd.readouterr() == ("", "")


def test_a_thread_runs_a_campaign(campaign, expected, tmp_path):
    path, ended = tmp_path / "own.h5", []
    thread = threading.Thread(
        target=lambda: ended.append(campaign.run(path, progress=False).status().state)
    )
    thread.start()
    thread.join()
    assert ended == ["finished"]
    assert_same(path, expected)


@pytest.mark.parametrize(
    "ranks", [None, pytest.param(2, marks=pytest.mark.ranks(guard="test_campaign_runs.py"))]
)
def test_what_is_wrong_is_raised_and_nothing_is_left(campaign, tmp_path, ranks):
    if ranks:
        need_mpirun()
    with pytest.raises(ValueError, match="nowhere"):
        campaign.run(tmp_path / "nowhere" / "own.h5", ranks=ranks)
    (tmp_path / "note.h5").write_text("a note")
    with pytest.raises(RunFailedError, match=r"note\.h5"):
        campaign.run(tmp_path / "note.h5", ranks=ranks, progress=False)
    assert (tmp_path / "note.h5").read_text() == "a note"
    with CampaignLock(tmp_path / "used.h5"), pytest.raises(RunFailedError, match="in use"):
        campaign.run(tmp_path / "used.h5", ranks=ranks, progress=False)
    assert not (tmp_path / "used.h5").exists()


@pytest.mark.parametrize("ranks", [0, -1, 1.5, "2", True])
def test_a_wrong_number_of_ranks_is_named(campaign, ranks):
    with pytest.raises(ValueError, match="ranks: is "):
        campaign.run(ranks=ranks)


@pytest.mark.parametrize("ranks", [10**9, 1 + RANKS_PER_CORE * len(os.sched_getaffinity(0))])
def test_more_ranks_than_the_cores_allow_are_refused(campaign, ranks):
    with pytest.raises(ValueError, match=f"ranks: is {ranks}; must be at most"):
        campaign.run(ranks=ranks)


def test_more_ranks_start_if_that_is_asked_for(campaign, tmp_path, monkeypatch):
    begun = []
    monkeypatch.setattr(python_runs, "find_launcher", lambda *_, **__: "mpirun")
    monkeypatch.setattr(python_runs, "follow", lambda words: begun.append(words) or (1, ["x"]))
    with pytest.raises(RunFailedError, match="x"):
        campaign.run(tmp_path / "own.h5", ranks=4000, oversubscribe=True)
    assert begun[0][:3] == ["mpirun", "-n", "4000"]


def test_runs_that_never_finish_a_sample_fail_in_the_end(campaign, expected, tmp_path):
    path = tmp_path / "own.h5"
    for _ in range(IDLE_LEGS):
        assert campaign.run(path, progress=False, max_walltime=1e-9).status().state == "stopped"
    with pytest.raises(RunFailedError, match="without a finished sample"):
        campaign.run(path, progress=False, max_walltime=1e-9)
    assert campaign.run(path, progress=False).status().state == "finished"
    assert_same(path, expected)


@pytest.mark.ranks(guard="runtime/test_launcher_watch.py")
def test_ranks_stop_when_the_process_that_started_them_is_killed(tmp_path):
    need_mpirun()
    write_campaign(tmp_path / "small.yaml", **SMALL)
    gate = Gate(tmp_path / "gate")
    words = [sys.executable, "-c", RUNS_SMALL]
    with program(words, cwd=tmp_path, env=environment(gate.folder)) as process:
        wait_until(lambda: gate.held(0) and gate.held(1), process)
        ranks = [gate.held(0), gate.held(1)]
        process.kill()
        wait_until_gone(ranks)
    assert state(tmp_path / "small.h5")[0] == "stopped"
    assert_sound(tmp_path / "small.h5")


def test_a_scene_alone_cannot_be_run(tmp_path):
    path = write_campaign(tmp_path / "small.yaml", **SMALL)
    text = path.read_text()
    scene = text[: text.index("objective:")]
    fixed = [
        line.partition("[")[0] + line.partition("[")[2].partition(",")[0]
        if ": [" in line and line.startswith("  ")
        else line
        for line in scene.splitlines()
    ]
    path.write_text("\n".join(fixed) + "\n")
    alone = agglom_mpi.load_campaign(path)
    with pytest.raises(Exception, match=os.fspath(path)):
        alone.run(tmp_path / "own.h5")
    assert not (tmp_path / "own.h5").exists()
