"""Rank 0 is not heard: one rank of each host reports it; all end if it lasts, and not before."""

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
    wait_until,
    write_campaign,
)
from mpi_injections import RANK
from processes import output_of, wait_until_gone

SHORT_TIMES = f"""{RANK}
import agglom_mpi.runtime.watches as watches
import agglom_mpi.runtime.silence as silence

watches.LOOKED_EVERY, watches.NAMED_AFTER = 0.05, 2.0
silence.BEAT_EVERY = 0.2
"""

ON_ANOTHER_HOST = """
import agglom_mpi.runtime.run as run

find_nodes, watches.CUT_OFF_AFTER = run.find_nodes, 4.0
run.find_nodes = lambda world: find_nodes(world)._replace(has_rank_zero=False)
"""

NOTES_WHAT_IS_SAID = """
from pathlib import Path

report = watches.CoordinatorWatch._report

def noting(self, text):
    if self._speaks:
        with open(Path(__file__).parent / "said", "a") as file:
            file.write(text + "\\n")
    report(self, text)

watches.CoordinatorWatch._report = noting
"""

NOTES_HEARTBEATS = """
import time
from pathlib import Path

import agglom_mpi.runtime.worker as worker

here, read = Path(__file__).parent, worker.Worker._read

def noting(self, tag):
    with open(here / f"heard-{rank}", "a") as file:
        file.write("x")
    read(self, tag)

worker.Worker._read = noting

def heard():
    return sum(path.stat().st_size for path in here.glob("heard-*"))

waited = 0

def until_heard(*arguments, **options):
    # Rank 0 goes on when the other one has heard it more often; it is there in the beginning.
    global waited
    before, waited = heard(), waited + 1
    while rank == "0" and heard() < before + 3 and waited < 3:
        time.sleep(0.01)
    (here / "waited").touch()
    return held_up(*arguments, **options)
"""

DECIDES_FOR_LONG = """
from agglom_mpi.search.inversion import Inversion

held_up, Inversion.complete_all = Inversion.complete_all, until_heard
"""

WRITES_FOR_LONG = """
import agglom_mpi.storage.writer as writer

held_up, writer.sync_descriptor = writer.sync_descriptor, until_heard
"""

GATHERED = "small.yaml", "--database", "gathered"
"""With parallel HDF5, which calls MPI itself, no thread sends heartbeats while rank 0 is busy."""


@pytest.fixture
def undisturbed(shared_campaign):
    need_mpirun()
    return decisions(shared_campaign("small") / "small.h5")


@pytest.fixture
def start(tmp_path):
    """Return what starts a run whose three ranks wait at a gate, with code injected."""
    write_campaign(tmp_path / "small.yaml", **SMALL)

    def start(text):
        gate = Gate(tmp_path / "gate", text=SHORT_TIMES + text)
        return gate, running(tmp_path, *GATHERED, ranks=3, inject=gate.folder)

    return start


def held(gate, process):
    """Return the processes of all ranks when they wait."""
    wait_until(lambda: all(gate.held(rank) for rank in range(3)), process)
    return [gate.held(rank) for rank in range(3)]


def test_a_silent_rank_0_is_reported_once_and_the_ranks_elsewhere_end(undisturbed, start, tmp_path):
    gate, run = start(ON_ANOTHER_HOST)
    with run as process:
        pids = held(gate, process)
        os.kill(pids[0], signal.SIGSTOP)
        _, errors = output_of(process)  # the launcher ends rank 0
        wait_until_gone(pids)
    assert process.returncode not in (0, 2, 75)
    assert errors.count("rank 0 has not been heard of for 2 s; in 2 s the ranks of this host") == 1
    assert errors.count("rank 0 has not been heard of for 4 s: the ranks of this host end") == 1
    assert "Traceback" not in errors
    assert_sound(tmp_path / "small.h5")
    finish(tmp_path, "small.yaml")
    assert_same(tmp_path / "small.h5", undisturbed)


@pytest.mark.ranks(guard="runtime/test_coordinator_watch.py")
def test_a_rank_0_that_is_heard_again_is_welcome(undisturbed, start, tmp_path):
    gate, run = start(NOTES_WHAT_IS_SAID)
    said = gate.folder / "said"
    with run as process:
        pids = held(gate, process)
        os.kill(pids[0], signal.SIGSTOP)
        wait_until(said.exists, process)
        os.kill(pids[0], signal.SIGCONT)
        wait_until(lambda: "is back" in said.read_text(), process)
        gate.open()
        _, errors = output_of(process)
    assert process.returncode == 0, errors
    assert said.read_text().count("\n") == 2, "one rank reports it"
    assert_same(tmp_path / "small.h5", undisturbed)


@pytest.mark.ranks(guard="runtime/test_heart.py")
@pytest.mark.parametrize("text", [DECIDES_FOR_LONG, WRITES_FOR_LONG])
def test_rank_0_is_heard_while_it_decides_or_writes(undisturbed, tmp_path, text):
    write_campaign(tmp_path / "small.yaml", **SMALL)
    code = inject(tmp_path / "inject", SHORT_TIMES + ON_ANOTHER_HOST + NOTES_HEARTBEATS + text)
    done = finish(tmp_path, *GATHERED, ranks=2, inject=code)
    assert (code / "waited").exists()
    assert "not been heard" not in done.stderr
    assert_same(tmp_path / "small.h5", undisturbed)
