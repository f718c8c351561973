"""Ranks of one job that do not run the same program."""

import sys

import pytest
from campaign_runs import environment, inject, invert, need_mpirun, write_campaign
from mpi_injections import RANK
from processes import output_of, program

from agglom_mpi.errors import BAD_INPUT
from agglom_mpi.version import __version__

OLD_VERSION = f"""{RANK}
import agglom_mpi.version

if rank == "1":
    agglom_mpi.version.__version__ = "0.0.9"
"""

OTHER_SOURCES = f"""{RANK}
import agglom_mpi.runtime.provenance as provenance

if rank == "1":
    provenance.sources_digest = lambda: 64 * "f"
"""

IMPATIENT = """
import time
from pathlib import Path
import agglom_mpi.runtime.launch as programs

programs.NOTED_AFTER, programs.GIVEN_UP_AFTER = 0.1, 0.5
check, receive = programs.check_programs, programs.receive_programs

def check_and_note(world, *arguments):
    check(world, *arguments)
    if world is not None and world.rank > 0:
        Path("told").touch()

def receive_once_told(*arguments):
    while not Path("told").exists():
        time.sleep(0.01)
    receive(*arguments)

programs.check_programs, programs.receive_programs = check_and_note, receive_once_told
"""
"""Rank 0 waits for one that speaks however long that takes, and then is impatient."""

SAYS_NOTHING = "from mpi4py import MPI; MPI.COMM_WORLD.bcast(None, root=0)"
"""As ranks of versions that did not say what they are: they wait for what to do."""

SENDS_AN_OLD_START = """
from time import sleep
from mpi4py import MPI

MPI.COMM_WORLD.bcast((0, ["an experiment"], None), root=0)
sleep(600.0)
"""
"""As rank 0 of such versions."""


@pytest.mark.ranks(guard="runtime/test_launch_programs.py")
@pytest.mark.parametrize(
    ("program", "named"),
    [
        pytest.param(OLD_VERSION, ["rank 1 on ", "0.0.9", __version__], id="version"),
        pytest.param(
            OTHER_SOURCES,
            ["rank 1 on ", "sources ffffffffffff"],
            id="sources",
        ),
    ],
)
def test_a_rank_of_another_program_is_refused_before_anything_is_written(tmp_path, program, named):
    need_mpirun()
    write_campaign(tmp_path / "small.yaml")
    done = invert(tmp_path, "small.yaml", ranks=2, inject=inject(tmp_path / "inject", program))
    assert done.returncode == BAD_INPUT
    said = done.stderr.partition("-----")[0]  # Open MPI's launcher adds words of its own
    assert said.count("\n") == 1
    assert all(word in said for word in named)
    assert not (tmp_path / "small.h5").exists()


def mixed_job(folder, *programs):
    """Exit code and standard error of a job whose ranks run these programs."""
    need_mpirun()
    write_campaign(folder / "small.yaml")
    words = [word for each in programs for word in (":", "-n", "1", *each)]
    env = environment(inject(folder / "inject", IMPATIENT))
    with program(["mpirun", *words[1:]], cwd=folder, env=env) as process:
        _, errors = output_of(process)
    assert "Traceback" not in errors
    assert not (folder / "small.h5").exists()
    return process.returncode, errors


INVERT = "agglom-invert", "small.yaml"


@pytest.mark.ranks(guard="runtime/test_launch_programs.py")
def test_ranks_that_do_not_say_what_they_are_end_the_job(tmp_path):
    silent = sys.executable, "-c", SAYS_NOTHING
    code, errors = mixed_job(tmp_path, INVERT, silent, INVERT, silent)
    assert code == BAD_INPUT
    noted, ended = errors.splitlines()[:2]
    assert noted == "waiting for the first message from rank 1, 3"
    assert ended.startswith("no first message from rank 1, 3 in 500 ms: another program")


@pytest.mark.slow
def test_a_rank_zero_that_does_not_ask_is_refused_by_the_others(tmp_path):
    code, errors = mixed_job(tmp_path, (sys.executable, "-c", SENDS_AN_OLD_START), INVERT)
    assert code == BAD_INPUT
    assert errors.startswith("rank 0 runs another program (TypeError: ")
