"""Ranks that are stopped, delayed or slow to wake: they are named, and nothing waits for them."""

import os
import signal
import time

import pytest
from farm_runs import (
    SLOW,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    need_mpirun,
    running,
    samples_in,
    state,
    wait_until,
    write_campaign,
)
from mpi_injections import RANK

from agglom_mpi.database.reader import open_campaign

LONG = SLOW | {"steps": 20_000}

IMPATIENT = f"""{RANK}
import agglom_mpi.farm.messages as messages

messages.ALIVE_EVERY, messages.SILENT_AFTER = 0.2, 1.5

import agglom_mpi.farm.crew as crew

crew.STOPS_WITHIN = 2.0
open("rank-" + rank, "w").write(str(os.getpid()))
"""

SLOW_TO_ANSWER = f"""{RANK}
import random
import time
import agglom_mpi.farm.worker as worker

serve, chance = worker.Worker.serve, random.Random(rank)

def late(self):
    time.sleep(chance.choice([0.0, 0.0, 0.05, 0.3]))
    serve(self)

worker.Worker.serve = late
"""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Decisions of a plain run."""
    need_mpirun()
    folder = tmp_path_factory.mktemp("undisturbed")
    write_campaign(folder / "slow.yaml", **LONG)
    finish(folder, "slow.yaml")
    return decisions(folder / "slow.h5")


@pytest.fixture
def started(tmp_path):
    """Start the campaign on three impatient ranks; it is under way."""
    write_campaign(tmp_path / "slow.yaml", **LONG)
    folder = inject(tmp_path / "inject", IMPATIENT)
    with running(tmp_path, "slow.yaml", ranks=3, inject=folder) as process:
        wait_until(lambda: samples_in(tmp_path / "slow.h5") > 20, process)
        yield tmp_path, process
        for path in tmp_path.glob("rank-*"):
            try:
                os.kill(int(path.read_text()), signal.SIGKILL)
            except ProcessLookupError:
                continue


def send(folder, rank, number):
    os.kill(int((folder / f"rank-{rank}").read_text()), number)


def pause(folder, rank):
    """Stop a rank for longer than the others have patience."""
    send(folder, rank, signal.SIGSTOP)
    time.sleep(2.5)
    send(folder, rank, signal.SIGCONT)


def test_a_stopped_rank_is_named_and_the_campaign_finishes_without_it(started, undisturbed):
    folder, process = started
    send(folder, 1, signal.SIGSTOP)
    said, errors = process.communicate(timeout=60)
    assert "rank 1 on " in errors
    assert "has not been heard of for 1.5 s; others do its work" in errors
    assert "no answer from rank 1: the job is ended without; slow.h5 is whole" in errors
    assert "finished: all 3 generations are done" in said
    assert process.returncode == 0
    assert state(folder / "slow.h5") == ("finished", "all 3 generations are done")
    assert_same(folder / "slow.h5", undisturbed)
    assert_sound(folder / "slow.h5")


def test_a_rank_that_comes_back_is_welcome_and_counts_once(started, undisturbed):
    folder, process = started
    pause(folder, 1)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert "has not been heard of" in errors
    assert " is back" in errors
    assert "no answer" not in errors
    assert_same(folder / "slow.h5", undisturbed)
    assert_sound(folder / "slow.h5")
    [samples] = open_campaign(folder / "slow.h5").legs()["samples"].tolist()
    assert samples == samples_in(folder / "slow.h5")


def test_a_stop_is_not_held_up_by_a_stopped_rank(started, undisturbed):
    folder, process = started
    send(folder, 2, signal.SIGSTOP)
    begin = time.monotonic()
    send(folder, 0, signal.SIGUSR1)
    _, errors = process.communicate(timeout=60)
    assert time.monotonic() - begin < 15.0
    assert process.returncode == 75, errors
    assert "no answer from rank 2" in errors
    assert state(folder / "slow.h5")[0] == "stopped"
    assert_sound(folder / "slow.h5")
    finish(folder, "slow.yaml", ranks=2)
    assert_same(folder / "slow.h5", undisturbed)
    assert_sound(folder / "slow.h5")


def test_rank_0_may_be_stopped_and_continued(started, undisturbed):
    folder, process = started
    pause(folder, 0)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert_same(folder / "slow.h5", undisturbed)
    assert_sound(folder / "slow.h5")


def test_a_killed_rank_ends_the_job_promptly(started, undisturbed):
    folder, process = started
    send(folder, 1, signal.SIGKILL)
    begin = time.monotonic()
    process.communicate(timeout=60)
    assert time.monotonic() - begin < 15.0
    assert process.returncode not in (0, 2, 75)
    finish(folder, "slow.yaml", ranks=2)
    assert_same(folder / "slow.h5", undisturbed)
    assert_sound(folder / "slow.h5")


def test_ranks_that_answer_late_change_nothing(tmp_path, undisturbed):
    write_campaign(tmp_path / "slow.yaml", **LONG)
    folder = inject(tmp_path / "inject", SLOW_TO_ANSWER)
    finish(tmp_path, "slow.yaml", ranks=3, inject=folder)
    assert_same(tmp_path / "slow.h5", undisturbed)
    assert_sound(tmp_path / "slow.h5")
