"""Ranks that are stopped, delayed or slow to wake: they are named, and nothing waits for them."""

import os
import signal

import pytest
from campaign_runs import (
    SMALL,
    Gate,
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
from processes import output_of, wait_until_gone

from agglom_mpi.runtime.messages import ALIVE, STOP
from agglom_mpi.runtime.silence import NAMED_AFTER
from agglom_mpi.runtime.worker_pool import STOP_TIMEOUT
from agglom_mpi.storage.reader import read_campaign

TOLD_THE_TIME = f"""{RANK}
import time
from pathlib import Path
from types import SimpleNamespace

import agglom_mpi.runtime.abort_flag as abort_flag
import agglom_mpi.runtime.silence as silence
import agglom_mpi.runtime.worker_pool as pool
from agglom_mpi.display.run_display import Display

here = Path(__file__).parent

def note(name, text):
    with open(here / name, "a") as file:
        file.write(text + "\\n")

def told():
    return float((here / "clock").read_text())

silence.ALIVE_EVERY, abort_flag.LONGEST_STEP = 0.05, 5.0
decoded, error = pool.decoded, Display.error

def decoding(rank, tag, records, *result):
    note(f"words-{{rank}}", str(tag))
    return decoded(rank, tag, records, *result)

def telling(self, text):
    note("said", text)
    error(self, text)

pool.decoded, Display.error = decoding, telling
if rank == "0":
    pool.time = abort_flag.time = SimpleNamespace(monotonic=told, sleep=time.sleep)
"""
"""Rank 0 goes by a clock that the test sets, and notes whom it hears and what it says."""

SLOW_TO_ANSWER = f"""{RANK}
import random
import time
import agglom_mpi.runtime.worker as worker

serve, chance = worker.Worker.serve, random.Random(rank)

def late(self):
    time.sleep(chance.choice([0.0, 0.0, 0.05, 0.3]))
    serve(self)

worker.Worker.serve = late
"""


@pytest.fixture
def undisturbed(shared_campaign):
    """Decisions of a plain run."""
    need_mpirun()
    return decisions(shared_campaign("small") / "small.h5")


class HeldRun:
    """Ranks of which each has a sample under way that waits at a gate."""

    def __init__(self, folder, ranks):
        self.ranks = range(ranks)
        self.folder, self.path = folder, folder / "small.h5"
        self.gate = Gate(folder / "gate", text=TOLD_THE_TIME)
        self.set_clock(0.0)
        write_campaign(folder / "small.yaml", **SMALL)

    def set_clock(self, seconds):
        new = self.gate.folder / "new"
        new.write_text(str(seconds))
        new.replace(self.gate.folder / "clock")

    def wait_for_all(self):
        """Wait until all ranks are held and rank 0 knows where they are."""
        self.wait(lambda: all(self.gate.held(rank) for rank in self.ranks))
        self.wait(lambda: all(self.heard(rank, ALIVE) for rank in self.ranks[1:]))
        self.pids = [self.gate.held(rank) for rank in self.ranks]

    def heard(self, rank, tag):
        return str(tag) in self.read(f"words-{rank}").split()

    def wait(self, condition):
        wait_until(condition, self.process)

    def send(self, rank, number):
        os.kill(self.pids[rank], number)

    def read(self, name):
        path = self.gate.folder / name
        return path.read_text() if path.exists() else ""

    def hear(self, rank):
        """Wait until rank 0 has heard a rank at the time it is now."""
        before = self.read(f"words-{rank}").count("\n")
        self.wait(lambda: self.read(f"words-{rank}").count("\n") > before + 1)

    def lose(self, rank, other):
        """Stop a rank until rank 0, which hears the other one, has lost patience with it."""
        self.send(rank, signal.SIGSTOP)
        for quarter in (1, 2, 3, 4):
            self.hear(other)
            self.set_clock(1.01 * NAMED_AFTER * quarter / 4)
        self.wait(lambda: f"rank {rank} on " in self.read("said"))

    def end(self):
        """Open the gate and wait for the end; what it said on either stream."""
        self.gate.open()
        return output_of(self.process)


@pytest.fixture
def ranks():
    """Return their number unless a test asks for fewer."""
    return 3


@pytest.fixture
def run(tmp_path, ranks):
    """Start the campaign; all ranks have something to do, and wait."""
    run = HeldRun(tmp_path, ranks)
    with running(tmp_path, "small.yaml", ranks=ranks, inject=run.gate.folder) as run.process:
        run.wait_for_all()
        yield run
        for pid in run.pids:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue


def test_a_stopped_rank_is_named_and_the_campaign_finishes_without_it(undisturbed, run):
    run.lose(1, other=2)
    said, errors = run.end()
    assert "rank 1 on " in errors
    assert f"has not been heard of for {NAMED_AFTER:g} s; others do its work" in errors
    assert "no answer from rank 1: the job is ended without; small.h5 is whole" in errors
    assert "finished: all 3 generations are done" in said
    assert run.process.returncode == 0
    assert state(run.path) == ("finished", "all 3 generations are done")
    assert_same(run.path, undisturbed)
    assert_sound(run.path)


@pytest.mark.ranks(guard="runtime/test_silence.py")
def test_a_rank_that_comes_back_is_welcome_and_counts_once(undisturbed, run):
    run.lose(1, other=2)
    run.send(1, signal.SIGCONT)
    run.wait(lambda: " is back" in run.read("said"))
    _, errors = run.end()
    assert run.process.returncode == 0, errors
    assert errors.count("has not been heard of") == 1
    assert "no answer" not in errors
    assert_same(run.path, undisturbed)
    assert_sound(run.path)
    [samples] = read_campaign(run.path).legs()["samples"].tolist()
    assert samples == samples_in(run.path)


@pytest.mark.ranks(guard="runtime/test_silence.py")
def test_a_stop_is_not_held_up_by_a_stopped_rank(undisturbed, run):
    run.send(2, signal.SIGSTOP)
    run.send(0, signal.SIGUSR1)
    run.wait(lambda: run.heard(1, STOP))
    run.set_clock(1.01 * STOP_TIMEOUT)
    _, errors = output_of(run.process)
    assert run.process.returncode == 75, errors
    assert "no answer from rank 2" in errors
    assert state(run.path)[0] == "stopped"
    assert_sound(run.path)
    finish(run.folder, "small.yaml")
    assert_same(run.path, undisturbed)
    assert_sound(run.path)


@pytest.mark.ranks(guard="runtime/test_silence.py")
@pytest.mark.parametrize("ranks", [2])
def test_rank_0_may_be_stopped_and_continued(undisturbed, run):
    run.send(0, signal.SIGSTOP)
    run.set_clock(10 * NAMED_AFTER)
    run.send(0, signal.SIGCONT)
    _, errors = run.end()
    assert run.process.returncode == 0, errors
    assert "has not been heard of" not in errors
    assert_same(run.path, undisturbed)
    assert_sound(run.path)


@pytest.mark.ranks(guard="runtime/test_silence.py")
@pytest.mark.parametrize("ranks", [2])
def test_a_job_may_be_suspended_and_continued(undisturbed, run):
    for rank in run.ranks:
        run.send(rank, signal.SIGSTOP)
    run.set_clock(10 * NAMED_AFTER)
    for rank in run.ranks:
        run.send(rank, signal.SIGCONT)
    _, errors = run.end()
    assert run.process.returncode == 0, errors
    assert "no answer" not in errors
    assert_same(run.path, undisturbed)
    assert_sound(run.path)


@pytest.mark.ranks(
    guard="mpi/test_mpi_errors.py::test_an_uncaught_exception_on_a_worker_ends_the_job"
)
@pytest.mark.parametrize("ranks", [2])
def test_a_killed_rank_ends_the_job(undisturbed, run):
    run.send(1, signal.SIGKILL)
    output_of(run.process)  # the gate is never opened
    assert run.process.returncode not in (0, 2, 75)
    wait_until_gone(run.pids)  # Open MPI's launcher does not
    finish(run.folder, "small.yaml")
    assert_same(run.path, undisturbed)
    assert_sound(run.path)


@pytest.mark.slow
def test_ranks_that_answer_late_change_nothing(undisturbed, tmp_path):
    write_campaign(tmp_path / "small.yaml", **SMALL)
    folder = inject(tmp_path / "inject", SLOW_TO_ANSWER)
    finish(tmp_path, "small.yaml", ranks=3, inject=folder)
    assert_same(tmp_path / "small.h5", undisturbed)
    assert_sound(tmp_path / "small.h5")
