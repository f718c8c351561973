"""Asked to stop, a run ends with exit code 75, and the same command goes on."""

import signal

import pytest
from campaign_runs import (
    Gate,
    assert_same,
    finish,
    invert,
    mpirun_is_hydra,
    need_mpirun,
    samples_in,
    state,
    stop,
    stop_here,
)

from agglom_mpi.storage.reader import read_campaign


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_a_run_cleanly_and_the_next_goes_on(folder, wanted, number):
    errors = stop_here(folder, "small", number=number).stderr
    path = folder / "small.h5"
    assert f"stopped: received {number.name}; everything simulated so far is in small.h5" in errors
    assert state(path) == ("stopped", f"received {number.name}")
    leg = read_campaign(path).legs()[0]
    assert leg["exit_code"] == 75
    assert leg["samples"] == samples_in(path)
    finish(folder, "small.yaml")
    assert_same(path, wanted)
    assert state(path)[0] == "finished"


@pytest.mark.slow
def test_a_signal_to_mpirun_stops_all_ranks_cleanly(folder, wanted):
    need_mpirun()
    # Only MPICH's mpirun hands TERM on to the ranks and waits for them.
    number = signal.SIGTERM if mpirun_is_hydra() else signal.SIGUSR1
    code, errors = stop(folder, "small", number=number, ranks=2)
    assert code == 75, errors
    assert errors.count(f"stopped: received {number.name}") == 1
    assert state(folder / "small.h5")[0] == "stopped"
    finish(folder, "small.yaml", ranks=2)
    assert_same(folder / "small.h5", wanted)


@pytest.mark.parametrize("ranks", [None, pytest.param(2, marks=pytest.mark.slow)])
def test_the_walltime_stops_a_run_cleanly_and_the_next_goes_on(folder, wanted, ranks):
    if ranks is None:
        done = stop_here(folder, "small", "--max-walltime", "1s", number=0)
    else:
        need_mpirun()
        held = Gate(folder / "gate").folder
        done = invert(folder, "small.yaml", "--max-walltime", "1s", ranks=ranks, inject=held)
    assert done.returncode == 75
    assert "stopped: the walltime limit is reached" in done.stderr
    assert done.stdout == ""
    assert state(folder / "small.h5") == ("stopped", "the walltime limit is reached")
    finish(folder, "small.yaml", "--max-walltime", "1-0", ranks=ranks)  # which is not reached
    assert_same(folder / "small.h5", wanted)
