"""Checks of `agglom doctor`: libraries, MPI, processors, storage, batch system."""

import errno
import fcntl
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Group, RenderableType

from agglom_mpi.compilation.kernels import cache_folder
from agglom_mpi.display.fitted_table import LabelledTexts
from agglom_mpi.formatting import pluralise
from agglom_mpi.launcher import launched_size
from agglom_mpi.runtime.file_setup import processor
from agglom_mpi.version import __version__


class Finding(NamedTuple):
    """Result of one check.

    Attributes
    ----------
    topic : str
        What was checked, a word or two.
    found : str
        What was found, one line.
    advice : str
        What to change, and how; empty if nothing.
    broken : bool
        Whether campaigns cannot run, or not on several ranks, unless this is changed.
    """

    topic: str
    found: str
    advice: str = ""
    broken: bool = False


def check_batch_system(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield what MPI interfaces Slurm offers, and the resources of the current job."""
    job = environment.get("SLURM_JOB_ID")
    if job is not None:
        tasks, nodes = environment.get("SLURM_NTASKS", "1"), environment.get("SLURM_NNODES", "1")
        yield Finding("Slurm job", f"{job}: {tasks} tasks on {nodes} nodes")
    if shutil.which("srun", path=environment.get("PATH")) is None:
        return
    try:
        done = subprocess.run(
            ["srun", "--mpi=list"],
            env=dict(environment),
            capture_output=True,
            text=True,
            timeout=20.0,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        yield Finding("Slurm", f"srun gives no answer: {error}")
        return
    if done.returncode != 0:
        yield Finding("Slurm", "srun is installed, but does not find a Slurm")
        return
    words = (done.stdout + done.stderr).split()
    kinds = [kind for kind in ("pmix", "pmi2", "cray_shasta") if kind in words]
    found = f"srun --mpi={' or '.join(kinds)}" if kinds else "srun offers no MPI interface"
    yield Finding("Slurm", found, "" if kinds else "start ranks with mpirun in a batch script")


NEEDED_FOR: Final = {
    "report": "tables, figures, pages and posteriors",
    "search": "the searches surrogate and cmaes",
}
"""What each extra that users install is needed for; `check_mpi` looks for the extra `mpi`."""

_REQUIREMENT: Final = re.compile(r"([\w.-]+)[^;]*(?:;.*\bextra == ['\"]([\w.-]+)['\"])?")


def libraries_of(extra: str) -> tuple[str, ...]:
    """Return the libraries of an extra, as the metadata of the installed package lists them."""
    try:
        lines = requires("agglom_mpi") or []
    except PackageNotFoundError:  # run from its sources, without being installed
        return ()
    found = (_REQUIREMENT.match(line) for line in lines)
    return tuple(match[1] for match in found if match is not None and match[2] == extra)


def check_libraries() -> Iterator[Finding]:
    """Yield the versions of libraries, and the extras that are not installed."""
    core = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "mpi4py"))
    yield Finding("agglom_mpi", f"{__version__}, Python {platform.python_version()}, {core}")
    yield _hdf5()
    for extra, purpose in NEEDED_FOR.items():
        names = libraries_of(extra)
        missing = [name for name in names if not is_installed(name)]
        if not names:
            yield Finding(f"extra {extra}", "not known: agglom_mpi is not installed by pip")
        elif missing:
            advice = f"for {purpose}: pip install 'agglom_mpi[{extra}]'"
            yield Finding(f"extra {extra}", f"without {', '.join(missing)}", advice)
        else:
            found = ", ".join(f"{name} {version(name)}" for name in names)
            yield Finding(f"extra {extra}", found)


def _hdf5() -> Finding:
    import h5py

    parallel = bool(h5py.get_config().mpi)
    writers = "every rank can write" if parallel else "built without MPI: rank 0 writes for all"
    return Finding("h5py", f"{h5py.__version__}, HDF5 {h5py.version.hdf5_version}, {writers}")


def is_installed(name: str) -> bool:
    """Return whether a distribution is installed."""
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


THREAD_VARIABLES: Final = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def check_processors(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield the number of processors, compared with ranks and threads."""
    there, usable = os.cpu_count() or 1, len(os.sched_getaffinity(0))
    found = f"{there} of {processor()}" + (f", {usable} usable here" if usable < there else "")
    ranks = launched_size(environment)
    advice = ""
    if ranks is not None and ranks > there and environment.get("SLURM_NNODES", "1") == "1":
        advice = f"{ranks} ranks on them: no more than {there} are of use"
    elif ranks is not None and usable < 2:
        advice = (
            "ranks are bound to one core each: right where each has its own; "
            "if not, OMPI_MCA_hwloc_base_binding_policy=none"
        )
    yield Finding("processors", found, advice)
    many = [
        f"{n}={environment[n]}" for n in THREAD_VARIABLES if environment.get(n, "") not in ("", "1")
    ]
    if many:
        advice = "the parallelism is in the ranks: set them to 1, they only cost"
        yield Finding("threads", ", ".join(many), advice)


MPI_TIMEOUT: Final = 60.0
"""Time limit for two ranks to connect, s; a busy cluster may take a while."""
INSTALL_MPI: Final = (
    "pip install 'agglom_mpi[mpi]' (brings its own mpirun), or load the cluster's MPI module"
)
MPI_PROBE: Final = """
import mpi4py
mpi4py.rc.thread_level = "funneled"
from mpi4py import MPI
world = MPI.COMM_WORLD
levels = ("single", "funneled", "serialized", "multiple")
if world.rank == 0:
    version = " ".join(MPI.Get_library_version().split()[:3]).rstrip(",")
    print(f"{world.size};{levels[MPI.Query_thread()]};{version}", flush=True)
"""
"""Code that each rank runs: prints size of the world, thread level and library."""
RANK_PREFIXES: Final = ("OMPI_", "PMI_", "PMIX_", "MPI_", "MV2_", "HYDI_", "PRTE_")
"""Prefixes of environment variables that tell a process that it is a rank."""


def check_mpi(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield whether MPI loads and two ranks connect; in a rank, only the launched size."""
    promised = launched_size(environment)
    if promised is not None:
        yield Finding("launched as", f"{promised} ranks", "run it without mpirun to see more")
        return
    alone = _output_of([sys.executable, "-c", MPI_PROBE], environment)
    if not _is_probe_output(alone):
        found = f"cannot be loaded: {_main_line(alone)}"
        yield Finding("MPI library", found, _advice_on(alone), broken=True)
        return
    _, level, version = alone.split(";")
    yield Finding("MPI library", f"{version}, thread level {level}")
    launcher = _launcher(environment)
    if launcher is None:
        yield Finding("mpirun", "not found", INSTALL_MPI, broken=True)
        return
    yield _two_ranks(launcher, version, environment)


def _launcher(environment: Mapping[str, str]) -> str | None:
    """Return the path of mpirun; that of this virtual environment comes last."""
    folders = environment.get("PATH", os.defpath), sysconfig.get_path("scripts")
    return shutil.which("mpirun", path=os.pathsep.join(folders))


def _two_ranks(launcher: str, version: str, environment: Mapping[str, str]) -> Finding:
    output = _output_of([launcher, "-n", "2", sys.executable, "-c", MPI_PROBE], environment)
    if not _is_probe_output(output):
        return Finding(
            "mpirun", f"{launcher} fails: {_main_line(output)}", _advice_on(output), broken=True
        )
    size, _, started = output.splitlines()[-1].split(";")
    if size != "2":
        advice = f"put the mpirun of {version} first on PATH; {INSTALL_MPI}"
        found = f"{launcher} starts 2 processes that do not find each other"
        return Finding("mpirun", found, advice, broken=True)
    return Finding("mpirun", f"{launcher}: 2 ranks find each other ({started})")


def _output_of(words: list[str], environment: Mapping[str, str]) -> str:
    clean = {k: v for k, v in environment.items() if not k.startswith(RANK_PREFIXES)}
    kept = {k: v for k, v in environment.items() if k.startswith(("OMPI_MCA_", "OMPI_ALLOW"))}
    kept |= {k: v for k, v in environment.items() if k.startswith("PRTE_MCA_")}
    try:
        done = subprocess.run(
            words,
            env=clean | kept,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=MPI_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no answer in {MPI_TIMEOUT:.0f} s"
    except OSError as error:
        return str(error)
    if done.returncode < 0:
        return f"ended by signal {-done.returncode}"
    return (done.stdout if done.returncode == 0 else done.stderr or done.stdout).strip()


_SIGNAL: Final = re.compile(r"\bsignal (\d+)")
"""How launchers name what ended a rank: `Bus error (signal 7)`, `on signal 7 (Bus error)`."""


def signal_name(number: int) -> str:
    """Return name and meaning of a signal: `SIGBUS (Bus error)`."""
    try:
        return f"{signal.Signals(number).name} ({signal.strsignal(number)})"
    except ValueError:
        return f"signal {number}"


def _is_probe_output(output: str) -> bool:
    return bool(output) and output.splitlines()[-1].count(";") == 2


def _main_line(output: str) -> str:
    """Return the most informative line: a signal, the last of a traceback, else the first."""
    if ended := _SIGNAL.search(output):
        return f"ended by {signal_name(int(ended[1]))}"
    lines = [line.strip() for line in output.splitlines() if line.strip(" -*=")]
    if not lines:
        return "no answer"
    return lines[-1] if lines[0].startswith("Traceback") else lines[0]


def _advice_on(output: str) -> str:
    if _SIGNAL.search(output) and shared_ranks() < 2:
        return LARGER_SHARED_MEMORY
    if "as root" in output:
        return "as root: export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1"
    if "slots" in output:
        return "more ranks than it counts cores: export OMPI_MCA_rmaps_base_oversubscribe=1"
    return INSTALL_MPI


SHARED_FILE_SYSTEMS: Final = {
    "lustre",
    "gpfs",
    "beegfs",
    "nfs",
    "nfs4",
    "cifs",
    "smb3",
    "panfs",
    "ceph",
    "9p",
}
"""File systems shared by several machines."""
INCOHERENT_FILE_SYSTEMS: Final = {"nfs", "nfs4", "cifs", "smb3", "9p"}
"""Shared file systems on which concurrent writes of two machines can mix."""
SLOW_FSYNC: Final = 0.5
"""Time of an fsync, s, from which it slows down campaigns of short generations."""
LITTLE_SPACE: Final = 2**30
"""Free space, bytes, below which to warn."""


def check_storage(folder: Path) -> Iterator[Finding]:
    """Yield the state of the folders of campaign files and of compiled kernels."""
    yield _campaign_folder(folder)
    kernels = cache_folder()
    kind = file_system(kernels)
    advice = ""
    if kind in SHARED_FILE_SYSTEMS:
        advice = "slow where many ranks load it: export NUMBA_CACHE_DIR=/tmp/numba_$(id -u)"
    compiled = sum(1 for _ in kernels.rglob("*.nbi"))
    state = f"{compiled} compiled" if compiled else "none compiled yet: a first run compiles them"
    yield Finding("kernel cache", f"{kernels} ({kind}), {state}", advice)


def _campaign_folder(folder: Path) -> Finding:
    kind = file_system(folder)
    try:
        seconds, locks = measure_fsync(folder)
    except OSError as error:
        found = f"{folder} ({kind}): {error.strerror}"
        return Finding(
            "campaign files", found, "start runs in a folder that you can write to", broken=True
        )
    free = shutil.disk_usage(folder).free
    found = f"{folder} ({kind}), {free / 2**30:.1f} GiB free, fsync {seconds * 1e3:.1f} ms"
    advice = []
    if kind in INCOHERENT_FILE_SYSTEMS:
        advice.append("let rank 0 write all: --database gathered")
    if not locks:
        advice.append("it has no locks, so nothing keeps two runs from writing the same file")
    if seconds > SLOW_FSYNC:
        advice.append("slow: each generation waits for it")
    if free < LITTLE_SPACE:
        advice.append("little space: `agglom check CAMPAIGN` estimates the size of a file")
    return Finding("campaign files", found, "; ".join(advice))


def measure_fsync(folder: Path) -> tuple[float, bool]:
    """Write and lock a temporary file; return the time of its fsync, s, and whether locks work."""
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".agglom_doctor_") as file:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            locks = True
        except OSError as error:
            if error.errno == errno.EWOULDBLOCK:
                raise
            locks = False
        file.write(bytes(2**20))
        file.flush()
        begin = time.monotonic()
        os.fsync(file.fileno())
        return time.monotonic() - begin, locks


def file_system(folder: Path, mounts: Path = Path("/proc/mounts")) -> str:
    """Return the type of file system of a folder, as Linux names it, or `unknown`."""
    best, kind = "", "unknown"
    place = os.path.realpath(folder)
    try:
        lines = mounts.read_text().splitlines()
    except OSError:
        return kind
    for line in lines:
        _, point, name, *_ = line.split(" ")
        point = point.encode().decode("unicode_escape")  # a blank is \040
        inside = place == point or place.startswith(point.rstrip("/") + "/")
        if inside and len(point) >= len(best):
            best, kind = point, name
    return kind


LARGER_SHARED_MEMORY: Final = (
    "ranks of one machine take some 5 MB each of /dev/shm, and without it a signal ends them: "
    "docker run --shm-size=1g, or mount -o remount,size=1g /dev/shm"
)
SHARED_MEMORY: Final = Path("/dev/shm")
"""Where the ranks of one machine share memory."""
SHARED_BY_RANK: Final = 11 * 2**19
"""Space that each rank takes of it, bytes: 5.4 million with MPICH, and some more to begin with."""


def shared_ranks() -> int:
    """Return the number of ranks for which there is shared memory now; 0 without any."""
    try:
        return shutil.disk_usage(SHARED_MEMORY).free // SHARED_BY_RANK
    except OSError:
        return 0


def check_shared_memory(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield for how many ranks there is shared memory, compared with their number."""
    launched = launched_size(environment) if environment.get("SLURM_NNODES", "1") == "1" else None
    ranks, enough = launched or len(os.sched_getaffinity(0)), shared_ranks()
    advice = "" if enough >= max(ranks, 2) else LARGER_SHARED_MEMORY
    yield Finding(
        "shared memory", f"{SHARED_MEMORY} has room for {pluralise(enough, 'rank')}", advice
    )


def run_checks(folder: Path) -> Iterator[Finding]:
    """Yield the findings of all checks; `folder` is that of the campaign files."""
    yield from check_libraries()
    yield from check_mpi()
    yield from check_shared_memory()
    yield from check_processors()
    yield from check_storage(folder)
    yield from check_batch_system()


def as_table(findings: list[Finding]) -> RenderableType:
    """Return a table of findings with the advice below."""
    table = LabelledTexts()
    for finding in findings:
        mark = "✗" if finding.broken else "!" if finding.advice else " "
        table.add_row(f"{mark} {finding.topic}", finding.found)
    advice = [f"{finding.topic}: {finding.advice}" for finding in findings if finding.advice]
    return Group(table, "", *(advice or ["nothing to change"]))
