"""Signals that come again, or too early or too late: exit code 75, and a whole file."""

import os
import signal
import subprocess
import sys
import time

import pytest
from campaign_runs import (
    Gate,
    assert_same,
    assert_sound,
    environment,
    finish,
    inject,
    need_mpirun,
    running,
    state,
    wait_until,
)
from processes import output_of

VOLLEY = (signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP, signal.SIGINT)
DEAF = """
import time
from pathlib import Path
import agglom_mpi.runtime.task_runner as simulator

def never(*arguments):
    Path(__file__).with_name("begun").touch()
    time.sleep(1e6)

simulator.simulate_scene, simulator.MAX_AT_ONCE = never, 1
"""
"""A sample that neither ends nor notices that it is to end."""


@pytest.mark.parametrize(
    "first", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_signals_that_come_again_until_the_end_do_not_change_it(folder, wanted, first):
    gate = Gate(folder / "gate")
    with running(folder, "small.yaml", inject=gate.folder) as process:
        wait_until(gate.held_any, process)
        os.kill(process.pid, first)
        others = 0
        while process.poll() is None:  # also while Python takes itself to pieces
            os.kill(process.pid, VOLLEY[others % len(VOLLEY)])
            others += 1
            time.sleep(2e-4)
        _, errors = output_of(process)
    assert process.returncode == 75, errors
    assert others > 4
    assert "stopped: received SIG" in errors  # the first or the second, if they arrive as one
    assert state(folder / "small.h5")[0] == "stopped"
    finish(folder, "small.yaml")
    assert_same(folder / "small.h5", wanted)


@pytest.mark.slow(guard="runtime/test_stop_request.py")
def test_an_interrupt_after_a_second_ends_a_stop_that_takes_long(folder):
    with running(folder, "small.yaml", inject=inject(folder / "deaf", DEAF)) as process:
        wait_until((folder / "deaf" / "begun").exists, process)
        os.kill(process.pid, signal.SIGTERM)
        time.sleep(1.2)
        assert process.poll() is None
        os.kill(process.pid, signal.SIGINT)
        _, errors = output_of(process)
    assert process.returncode == 75, errors
    assert "interrupted; run the same command again to continue" in errors
    assert "Traceback" not in errors
    assert state(folder / "small.h5") == ("stopped", "ended by SIGINT before it had stopped")
    assert_sound(folder / "small.h5")


COMPILES = """
import time
from pathlib import Path
import agglom_mpi.runtime.task_runner as simulator

def compile_for_ever(*arguments):
    Path(__file__).with_name("begun").touch()
    time.sleep(1e6)

simulator.compile_kernels = compile_for_ever
"""


@pytest.mark.parametrize(
    "ranks", [None, pytest.param(2, marks=pytest.mark.ranks(guard="crash/test_crash_signals.py"))]
)
def test_a_stop_does_not_wait_for_compilation(folder, ranks):
    if ranks:
        need_mpirun()
    with running(
        folder, "small.yaml", ranks=ranks, inject=inject(folder / "slow", COMPILES)
    ) as process:
        wait_until((folder / "slow" / "begun").exists, process)
        os.kill(process.pid, signal.SIGUSR1)
        _, errors = output_of(process)
    assert process.returncode == 75, errors
    assert state(folder / "small.h5") == ("stopped", "received SIGUSR1")
    assert_sound(folder / "small.h5")


@pytest.mark.slow(guard="crash/test_crash_signals.py::test_a_stop_does_not_wait_for_compilation")
def test_the_walltime_ends_compilation(folder):
    options = ("--max-walltime", "0.5")
    slow = inject(folder / "slow", COMPILES)
    with running(folder, "small.yaml", *options, inject=slow) as process:
        _, errors = output_of(process)
    assert process.returncode == 75, errors
    assert state(folder / "small.h5") == ("stopped", "the walltime limit is reached")


@pytest.mark.slow
def test_a_stop_does_not_wait_for_ever_for_what_does_not_end(folder):
    with running(folder, "small.yaml", inject=inject(folder / "deaf", DEAF)) as process:
        wait_until((folder / "deaf" / "begun").exists, process)
        os.kill(process.pid, signal.SIGTERM)
        _, errors = output_of(process)
    assert process.returncode == 75, errors
    assert state(folder / "small.h5") == ("stopped", "received SIGTERM")


RAISES = """
import os, signal, sys
import click
from agglom_mpi.cli.common import launch

@click.command()
def command():
    RAISE

launch(command, simulates=SIMULATES)
"""
REAL = "os.kill(os.getpid(), signal.SIGINT)"


@pytest.mark.parametrize(
    ("fault", "simulates", "code"),
    [
        (REAL, True, 75),
        pytest.param(REAL, False, 130, marks=pytest.mark.slow),
        ("raise EOFError('Ran out of input')", False, 1),
    ],
)
def test_only_a_real_interrupt_is_one(fault, simulates, code):
    text = RAISES.replace("RAISE", fault).replace("SIMULATES", str(simulates))
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert ("interrupted" in done.stderr) == (code == 75)
    assert ("EOFError" in done.stderr) == (code == 1)


EARLY = """
import os, signal, sys
from agglom_mpi.cli import invert

class Finder:
    def find_spec(self, name, *rest):
        if name == "agglom_mpi.runtime.run":
            os.kill(os.getpid(), int(os.environ["NUMBER"]))

sys.meta_path.insert(0, Finder())
sys.argv[:] = ["agglom-invert", "small.yaml"]
invert()
"""


def test_a_signal_before_there_is_a_file_is_an_interrupt(folder):
    done = subprocess.run(
        [sys.executable, "-c", EARLY],
        cwd=folder,
        env=environment(NUMBER=str(int(signal.SIGTERM))),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 75, done.stderr
    assert "Traceback" not in done.stderr
