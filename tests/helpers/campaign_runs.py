"""Small campaigns, the commands that run them, and what must not differ between runs."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from pydoc import locate

import h5py
import numpy as np
import pytest
from agglom_here import run_here
from perturbed_streams import perturbed_path
from processes import (
    HANG,
    end_group,
    output_of,
    program,
    start_group,
    wait_for,
)

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli.invert import invert_command
from agglom_mpi.storage.reader import read_campaign

QUICKSTART = Path(__file__).parents[2] / "jobs" / "quickstart.yaml"
SMALL = {"generations": 3, "max_samples": 30}
SLOW = SMALL
"""What is interrupted: it lasts as long as `SLOWLY` or a `Gate` makes it."""
SLOWLY = """
import time
import agglom_mpi.runtime.task_runner as simulator

at_once = simulator.simulate_scene

def slowly(*arguments):
    time.sleep(0.02)
    return at_once(*arguments)

simulator.simulate_scene, simulator.MAX_AT_ONCE = slowly, 1
"""
"""What makes a campaign last on any machine, so that it can be caught in the act."""
HELD = """
import os
import time
from pathlib import Path

import agglom_mpi.runtime.task_runner as simulator

folder = Path(__file__).parent
number = os.environ.get("PMI_RANK", os.environ.get("OMPI_COMM_WORLD_RANK", "0"))
let_through, begun = simulator.simulate_scene, 0

def held(scene, random, abort, frames=None):
    global begun
    begun += not abort[0]
    if begun > AFTER:
        (folder / f"pid-{number}").write_text(str(os.getpid()))
        (folder / f"pid-{number}").replace(folder / f"held-{number}")
    while begun > AFTER and not (abort[0] or (folder / "open").exists()):
        time.sleep(0.01)
    return let_through(scene, random, abort, frames)

simulator.simulate_scene, simulator.MAX_AT_ONCE = held, 1
"""
STOPS = """
import os
import signal
import time

import agglom_mpi.runtime.task_runner as simulator

let_through, begun = simulator.simulate_scene, 0

def stopping(scene, random, abort, frames=None):
    global begun
    begun += not abort[0]
    if begun == AFTER + 1:
        os.kill(os.getpid(), NUMBER)
    while begun > AFTER and not abort[0]:
        time.sleep(1e-3)
    return let_through(scene, random, abort, frames)

simulator.simulate_scene, simulator.MAX_AT_ONCE = stopping, 1
"""
"""A run gets a signal when it has done so many samples, and does no more."""
HANGS = """
import time
from types import SimpleNamespace

import agglom_mpi.runtime.abort_flag as abort_flag
import agglom_mpi.runtime.task_runner as simulator

simulate, now = simulator.SampleTask._simulate, 0.0

def hang(self, sample, seconds):
    global now
    if (self._string, sample) in PAIRS:
        now += 1e9
        while self._abort_flag.max_seconds is not None and not self._abort_flag.abort[0]:
            time.sleep(0.01)
    return simulate(self, sample, seconds)

simulator.SampleTask._simulate, simulator.MAX_AT_ONCE = hang, 1
abort_flag.time = SimpleNamespace(monotonic=lambda: now)
"""
"""The samples (string, sample) in PAIRS take too long, on any machine no others do."""
HANGS_REPLACES = [
    "agglom_mpi.runtime.task_runner.SampleTask._simulate",
    "agglom_mpi.runtime.abort_flag.time",
]
FINAL = "{strings: 6, samples: 12}"
TINY = {"generations": 1, "max_samples": 5, "population": 4, "parents": 2}
SHARED = {"tiny": TINY, "small": SMALL, "estimated": SMALL | {"final": FINAL}, "slow": SLOW}
"""Campaigns whose files several tests read: the fixture `shared_campaign` gives them."""

_BIN = Path(sys.executable).parent
_LAUNCHERS = ("OMPI_", "PMI_", "PMIX_", "MPI_", "MV2_", "SLURM_", "HYDI_", "PRTE_")


def write_campaign(path, max_failures=None, steps=None, final="none", **numbers):
    """Write the quickstart campaign with other numbers, or with `steps` equal time steps.

    All variants of the same engine share compiled kernels. Most tests need no fresh samples:
    `final` asks for some.
    """
    text = QUICKSTART.read_text()
    if steps is not None:
        text = re.sub(r"\n  engine: .*", "", text)
        engine = f"  engine: {{law: fixed, steps: {steps}}}"
        text, count = re.subn(r"\n(  end_time: .*)", rf"\n\1\n{engine}", text)
        assert count == 1
    for name, value in numbers.items():
        text, count = re.subn(rf"\b{name}: [^\s,}}]+", f"{name}: {value}", text)
        assert count == 1, name
    if max_failures is not None:
        text = f"{text.rstrip()}\n  max_failures: {max_failures}\n"
    remark, _, rest = text.partition("\n")
    assert remark.startswith("#")
    path.write_text(f"final: {final}\n{rest}")
    return path


HARD = {"hardness": 1e30}
"""Grains so hard that nothing bonds, and collisions never end."""


def write_endless(path):
    """Write the quickstart campaign with samples of a billion events, if grains are `HARD`."""
    write_campaign(path, **SMALL)
    endless = "end_time: 1e9 s\n  engine: {law: event, budget: 1000000000}"
    path.write_text(path.read_text().replace("end_time: characteristic", endless))
    return path


def environment(inject=None, **variables):
    """Return that of a fresh login, without launchers; the folder with a sitecustomize first."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(_LAUNCHERS)}
    folders = [str(inject)] if inject else []
    folders += [clean["PYTHONPATH"]] if clean.get("PYTHONPATH") else []
    if folders:
        clean["PYTHONPATH"] = os.pathsep.join(folders)
    clean["PATH"] = os.pathsep.join([str(_BIN), clean.get("PATH", os.defpath)])
    clean |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    clean |= {"OMPI_MCA_rmaps_base_oversubscribe": "1"}
    clean |= {"OMPI_MCA_hwloc_base_binding_policy": "none"}
    clean |= {"PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    # Two mpirun of Open MPI 4 that start at once may both make their session folder: one fails.
    sessions = Path(tempfile.gettempdir(), f"ompi.{os.environ.get('PYTEST_XDIST_WORKER', 'main')}")
    sessions.mkdir(exist_ok=True)
    clean |= {"OMPI_MCA_orte_tmpdir_base": str(sessions)}
    clean |= variables
    return clean | {"PYTHONPATH": perturbed_path(str(clean.get("PYTHONPATH", "")))}


def need_mpirun():
    """Skip where there is no mpirun; the continuous integration must have one."""
    if shutil.which("mpirun", path=environment()["PATH"]) is None:
        if os.environ.get("CI"):
            pytest.fail("no mpirun; the tests of parallel runs must not be skipped here")
        pytest.skip("no mpirun is installed (pip install 'agglom_mpi[mpi]')")


def need_parallel_hdf5():
    """Skip where HDF5 cannot write in parallel; the continuous integration has a build that can."""
    need_mpirun()
    if not h5py.get_config().mpi:
        assert "CI" not in os.environ, "this build of h5py is serial"
        pytest.skip("this build of h5py is serial")


def mpirun_is_hydra():
    """Whether the launcher is MPICH's."""
    said = subprocess.run(
        ["mpirun", "--version"],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    return "HYDRA" in said.stdout


def _command(arguments, ranks, folder=_BIN):
    words = [str(folder / "agglom-invert"), *map(str, arguments)]
    launcher = folder / "mpirun" if (folder / "mpirun").exists() else "mpirun"
    return words if ranks is None else [str(launcher), "-n", str(ranks), *words]


def _folder_of(folder, inject):
    """Return where the sitecustomize is: that of `SLOWLY` is made here."""
    if inject is not SLOWLY:
        return inject
    slow = folder / "slowly"
    slow.mkdir(exist_ok=True)
    (slow / "sitecustomize.py").write_text(SLOWLY)
    return slow


def start(folder, *arguments, ranks=None, inject=SLOWLY, build=_BIN, **variables):
    """Start a run in the background, as its own group; `SLOWLY` unless `inject` is given."""
    env = environment(_folder_of(folder, inject), **variables)
    return start_group(_command(arguments, ranks, build), cwd=folder, env=env)


def invert(folder, *arguments, ranks=None, inject=None, alone=False, **variables):
    """Run to the end; a plain run without any changes in this process, unless `alone`."""
    if not (alone or ranks or inject or variables):
        return run_here(invert_command, "agglom-invert", folder, arguments)
    env = environment(_folder_of(folder, inject), **variables)
    with program(_command(arguments, ranks), cwd=folder, env=env) as process:
        said, errors = output_of(process)
    return subprocess.CompletedProcess(process.args, process.returncode, said, errors)


def finish(folder, *arguments, **options):
    """Run to the end, which must be a good one; the result."""
    done = invert(folder, *arguments, **options)
    assert done.returncode == 0, done.stderr
    return done


def inject(folder, text):
    """Make a folder whose code every Python process of a run executes first."""
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(text)
    return folder


@contextmanager
def injected(text, *replaced):
    """Execute code in this process for a block; what it replaces, by dotted names, is put back.

    The number of samples of one compiled call is, too, which much of such code sets to 1.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name in (*replaced, "agglom_mpi.runtime.task_runner.MAX_AT_ONCE"):
            patch.setattr(name, locate(name))
        exec(text, {})
        yield


def wait_until(condition, process):
    """Wait until the condition holds; the process must not end before."""
    return wait_for(condition, "what was waited for", process)


class Gate:
    """Every rank waits before its next sample when it has done `after`, unless the run stops.

    Parameters
    ----------
    folder
        To be made, and to be injected; what else is injected is `text`.
    after
        Samples of each rank that are let through.
    """

    def __init__(self, folder, after=10, text=""):
        self.folder = inject(folder, text + HELD.replace("AFTER", str(after)))

    def held(self, rank=0):
        """Return the process of a rank that waits, None if it does not yet."""
        path = self.folder / f"held-{rank}"
        return int(path.read_text()) if path.exists() else None

    def held_any(self):
        """Whether any rank waits: the campaign does not end before the gate is opened."""
        return any(self.folder.glob("held-*"))

    def open(self):
        """Let all samples through from now on."""
        (self.folder / "open").touch()


@contextmanager
def running(folder, *arguments, **options):
    """Start a run that does not outlive the block, nor do its ranks."""
    process = start(folder, *arguments, **options)
    try:
        yield process
    finally:
        end_group(process)


def stop(folder, name, *arguments, number=signal.SIGUSR1, until=None, inject=None, **options):
    """Send a run of `name`.yaml a signal; its exit code and what it said on standard error.

    It is sent when ranks wait at a gate, or when `until` holds if that is given. A run with code
    of its own gets it when it has written 20 more samples.
    """
    path = folder / f"{name}.h5"
    enough = samples_in(path) + 20
    if until is None and inject is None:
        gate = Gate(folder / f"gate-{len(list(folder.glob('gate-*')))}")
        until, inject = gate.held_any, gate.folder
    with running(folder, f"{name}.yaml", *arguments, inject=inject or SLOWLY, **options) as process:
        wait_until(until or (lambda: samples_in(path) >= enough), process)
        os.kill(process.pid, number)
        _, errors = output_of(process)
    return process.returncode, errors


def stop_here(folder, name, *arguments, number=signal.SIGUSR1, after=10, text="", replaced=()):
    """Run `name`.yaml in this process until it stops by a signal after some samples; the result.

    What else is injected is `text`; it replaces `replaced`, as in `injected`.
    """
    text += STOPS.replace("AFTER", str(after)).replace("NUMBER", str(int(number)))
    with injected(text, *replaced, "agglom_mpi.runtime.task_runner.simulate_scene"):
        done = invert(folder, f"{name}.yaml", *arguments)
    assert done.returncode == 75, done.stderr
    return done


def assert_sound(path):
    """Check a file, which must be sound; what `agglom check` says."""
    said, code = check_file(str(path))
    assert code == 0, said
    return said


def samples_in(path):
    """Count the samples in a file that may not be there yet."""
    return len(read_campaign(path).all_sample_rows()) if path.exists() else 0


def decisions(path):
    """Everything that must not depend on how a campaign was run, bit for bit."""
    file = read_campaign(path)
    results, samples, strings = file.result_rows(), file.all_sample_rows(), file.string_rows()
    used = np.zeros(int(samples["string"].max()) + 1, np.int64)
    used[results["string"]] = results["samples_used"]
    begun = strings["generation"] <= file.generation_rows()["generation"].max()
    judged = samples[samples["sample"] < used[samples["string"]]]
    kept = {
        "samples": (judged, {"seconds", "cpu_seconds", "finished", "rank"}),
        "strings": (strings[begun], set()),  # those of coming generations ran ahead
        "results": (results, set()),
        "generations": (file.generation_rows(), {"seconds", "samples_simulated"}),
    }
    return {
        f"{table}.{name}": rows[name].tobytes()
        for table, (rows, free) in kept.items()
        for name in rows.dtype.names
        if name not in free | {"crc"} or (name == "crc" and not free)
    }


def assert_same(path, wanted):
    """Compare the decisions in a file, and say which columns differ."""
    found = decisions(path)
    assert found.keys() == wanted.keys()
    assert [name for name in wanted if found[name] != wanted[name]] == []


def assert_killed(path):
    """Check that a file shows that its run was killed: it says so itself, if one lock is enough."""
    file = read_campaign(path)
    assert file.status().state == "running"
    gathered = file.legs()[-1]["database"] == b"gathered"
    assert state(path)[0] == ("stopped" if gathered else "running")


def state(path):
    """State and reason as stored."""
    status = open_campaign(path).status()
    return status.state, status.reason
