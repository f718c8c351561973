"""What goes wrong on a rank reaches the user once, and the job ends as it should."""

import pytest
from campaign_runs import (
    SLOWLY,
    SMALL,
    Gate,
    assert_sound,
    finish,
    inject,
    injected,
    invert,
    need_mpirun,
    samples_in,
    state,
    stop,
    write_campaign,
)
from mpi_injections import RANK, SENDS_WAIT_TO_BE_RECEIVED, slow

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.outcome import FAILED, FailureReason
from agglom_mpi.storage.reader import read_campaign

ONE_SAMPLE_RAISES = f"""{RANK}
import agglom_mpi.runtime.task_runner as simulator

simulate_scene, count = simulator.simulate_scene, 0

def once(scene, random, abort, frames=None):
    global count
    count += not abort[0]
    if rank == "1" and count == 5:
        raise ArithmeticError("injected")
    return simulate_scene(scene, random, abort, frames)

simulator.simulate_scene, simulator.MAX_AT_ONCE = once, 1
"""

EVERY_SAMPLE_RAISES = f"""{RANK}
import agglom_mpi.runtime.task_runner as simulator

simulate_scene = simulator.simulate_scene

def never(scene, random, abort, frames=None):
    if not abort[0]:
        raise ArithmeticError("injected")
    return simulate_scene(scene, random, abort, frames)

simulator.simulate_scene, simulator.MAX_AT_ONCE = never, 1
"""

SIMULATOR_BREAKS = f"""{RANK}
import agglom_mpi.runtime.task_runner as simulator

def broken(self, task):
    raise SystemError("injected")

if rank == "1":
    simulator.SampleRunner.begin = broken
"""

WORKER_BREAKS = f"""{RANK}
import agglom_mpi.runtime.worker as worker

class Broken(worker.SimulationThread):
    def put(self, tasks):
        raise SystemError("injected")

if rank == "1":
    worker.SimulationThread = Broken
"""


@pytest.fixture(autouse=True)
def mpirun():
    need_mpirun()


@pytest.mark.ranks(guard="runtime/test_unexpected_errors.py")
def test_bad_input_is_one_message_and_no_file(tmp_path):
    write_campaign(tmp_path / "bad.yaml", population=0)
    done = invert(tmp_path, "bad.yaml", ranks=2)
    assert done.returncode == 2
    assert done.stdout == ""
    said = done.stderr.partition("-----")[0]  # Open MPI's launcher adds words of its own
    assert said.count("\n") == 1
    assert said.startswith("bad.yaml:")
    assert "search.population: is 0" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["bad.yaml"]


@pytest.mark.ranks(guard="cli/test_cli_options.py")
def test_wrong_options_are_one_message(small):
    done = invert(small, "--walltime", "1", ranks=2)
    assert done.returncode == 2
    assert done.stderr.count("Error: ") == 1


def test_an_exception_on_a_worker_is_shown_and_stored_and_the_run_goes_on(small, tmp_path):
    folder = inject(tmp_path / "inject", ONE_SAMPLE_RAISES)
    done = finish(small, "small.yaml", "-o", tmp_path / "x.h5", ranks=2, inject=folder)
    file = read_campaign(tmp_path / "x.h5")
    rows = file.all_sample_rows()
    [row] = rows[rows["state"] == FAILED]
    [failure] = file.failures()
    assert (row["reason"], row["rank"]) == (FailureReason.EXCEPTION, 1)
    for name in ("string", "sample", "rank"):
        assert failure[name] == row[name]
    assert failure["text"].decode().endswith("ArithmeticError: injected\n")
    assert "rank 1 on " in done.stderr
    assert f"string {row['string']} sample {row['sample']} raised" in done.stderr
    assert done.stderr.count("ArithmeticError: injected") == 1
    assert "1 sample failed" in done.stdout
    assert state(file.path)[0] == "finished"


@pytest.mark.parametrize("break_it", [SIMULATOR_BREAKS, slow(WORKER_BREAKS)])
def test_an_uncaught_exception_on_a_worker_ends_the_job(tmp_path, break_it):
    write_campaign(tmp_path / "small.yaml", **SMALL)
    gate = Gate(tmp_path / "gate", after=0, text=break_it)  # it does not end otherwise
    done = invert(tmp_path, "small.yaml", ranks=2, inject=gate.folder)
    assert done.returncode not in (0, 2, 75)
    assert "rank 1:\nTraceback" in done.stderr
    assert "SystemError: injected" in done.stderr
    assert open_campaign(tmp_path / "small.h5").damaged == 0


BY_ONE = "mpi/test_mpi_errors.py::test_too_many_failures_are_an_error_that_quiet_does_not_hide"


@pytest.mark.ranks(guard=BY_ONE)
def test_too_many_failures_end_the_campaign_cleanly(tmp_path):
    write_campaign(tmp_path / "small.yaml", **SMALL, max_failures=5)
    folder = inject(tmp_path / "inject", EVERY_SAMPLE_RAISES)
    done = invert(tmp_path, "small.yaml", ranks=2, inject=folder)
    assert done.returncode == 1
    assert "samples failed with errors; everything simulated so far is in small.h5" in done.stderr
    assert "rank " not in done.stderr.partition("stopped:")[2]
    file = read_campaign(tmp_path / "small.h5")
    failed = len(file.all_sample_rows())
    assert failed >= 5
    assert len(file.failures()) == failed
    # Also those that were under way when it was enough.
    assert state(file.path) == ("failed", f"{failed} samples failed with errors")
    assert file.legs()["exit_code"].tolist() == [1]
    assert file.legs()["samples"].tolist() == [failed]


def test_too_many_failures_are_an_error_that_quiet_does_not_hide(tmp_path):
    write_campaign(tmp_path / "small.yaml", **SMALL, max_failures=5)
    with injected(EVERY_SAMPLE_RAISES, "agglom_mpi.runtime.task_runner.simulate_scene"):
        done = invert(tmp_path, "small.yaml", "--quiet")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("stopped: ")
    assert "ArithmeticError: injected" in done.stderr
    assert "Quickstart" not in done.stderr
    assert done.stdout == ""
    failed = len(read_campaign(tmp_path / "small.h5").failures())
    assert failed >= 5
    assert state(tmp_path / "small.h5") == ("failed", f"{failed} samples failed with errors")


def test_processes_of_another_mpi_are_refused(small):
    done = invert(small, "small.yaml", OMPI_COMM_WORLD_SIZE="2")
    assert done.returncode == 2
    assert "the launcher started 2 processes" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow(guard="mpi/test_mpi_errors.py::test_processes_of_another_mpi_are_refused")
def test_only_the_first_process_of_another_mpi_says_so(small):
    done = invert(small, "small.yaml", OMPI_COMM_WORLD_SIZE="2", OMPI_COMM_WORLD_RANK="1")
    assert (done.returncode, done.stderr) == (2, "")


@pytest.mark.ranks(guard="runtime/test_pending_sends.py")
def test_a_worker_in_the_middle_of_sending_does_not_hold_up_the_end(tmp_path):
    """A library may keep a sender waiting until its message is received; none must be left."""
    write_campaign(tmp_path / "small.yaml", **SMALL)
    folder = inject(tmp_path / "inject", SLOWLY + SENDS_WAIT_TO_BE_RECEIVED)
    code, said = stop(tmp_path, "small", ranks=3, inject=folder)
    assert code == 75, said
    path = tmp_path / "small.h5"
    assert state(path)[0] == "stopped"
    # What was on its way was neither lost nor left unjudged.
    assert_sound(path)
    assert read_campaign(path).legs()["samples"].tolist() == [samples_in(path)]
