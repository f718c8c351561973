"""Small campaigns, the commands that run them, and what must not differ between runs."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.database.reader import open_campaign
from agglom_mpi.farm.check import check_file

QUICKSTART = Path(__file__).parents[2] / "jobs" / "quickstart.yaml"
SMALL = {"generations": 3, "max_samples": 30}
SLOW = {"generations": 3, "max_samples": 30, "steps": 6000}
"""The same scene for longer, to be interrupted; some three seconds of work."""
SLOWLY = """
import time
import agglom_mpi.farm.simulator as simulator

at_once = simulator.simulate_scene

def slowly(*arguments):
    time.sleep(0.02)
    return at_once(*arguments)

simulator.simulate_scene = slowly
"""
"""What makes a campaign last on any machine, so that it can be caught in the act."""
TINY = {"generations": 1, "max_samples": 5, "population": 4, "parents": 2}
TIMEOUT = 120.0

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
    return clean | variables


def need_mpirun():
    """Skip where there is no mpirun; the continuous integration must have one."""
    if shutil.which("mpirun", path=environment()["PATH"]) is None:
        if os.environ.get("CI"):
            pytest.fail("no mpirun; the tests of the parallel farm must not be skipped here")
        pytest.skip("no mpirun is installed (pip install 'agglom_mpi[mpi]')")


def mpirun_is_hydra():
    """Whether the launcher is MPICH's."""
    said = subprocess.run(
        ["mpirun", "--version"],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=30,
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
    return subprocess.Popen(
        _command(arguments, ranks, build),
        cwd=folder,
        env=environment(_folder_of(folder, inject), **variables),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def invert(folder, *arguments, ranks=None, inject=None, **variables):
    """Run to the end."""
    return subprocess.run(
        _command(arguments, ranks),
        cwd=folder,
        env=environment(_folder_of(folder, inject), **variables),
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )


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


def wait_until(condition, process, seconds=TIMEOUT):
    """Wait until the condition holds; the process must not end before."""
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.communicate(timeout=5)[1]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


@contextmanager
def running(folder, *arguments, **options):
    """Start a run that does not outlive the block."""
    process = start(folder, *arguments, **options)
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate(timeout=60)


def stop(folder, name, *arguments, number=signal.SIGUSR1, until=None, **options):
    """Send a run of `name`.yaml a signal when it has written 20 more samples, or `until` holds.

    Return its exit code and what it said on standard error.
    """
    path = folder / f"{name}.h5"
    enough = samples_in(path) + 20
    with running(folder, f"{name}.yaml", *arguments, **options) as process:
        wait_until(until or (lambda: samples_in(path) >= enough), process)
        os.kill(process.pid, number)
        _, errors = process.communicate(timeout=30)
    return process.returncode, errors


def assert_sound(path):
    """Check a file, which must be sound; what `agglom check` says."""
    said, code = check_file(str(path))
    assert code == 0, said
    return said


def samples_in(path):
    """Count the samples in a file that may not be there yet."""
    return len(open_campaign(path).all_sample_rows()) if path.exists() else 0


def decisions(path):
    """Everything that must not depend on how a campaign was run, bit for bit."""
    file = open_campaign(path)
    results, samples, strings = file.result_rows(), file.all_sample_rows(), file.string_rows()
    used = np.zeros(int(samples["string"].max()) + 1, np.int64)
    used[results["string"]] = results["samples_used"]
    begun = strings["generation"] <= file.generation_rows()["generation"].max()
    judged = samples[samples["sample"] < used[samples["string"]]]
    kept = {
        "samples": (judged, {"seconds", "finished", "rank"}),
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


def state(path):
    """State and reason as stored."""
    status = open_campaign(path).status()
    return status.state, status.reason
