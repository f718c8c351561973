"""Checks of what is installed, of processors, batch system, nodes and file systems."""

import errno
import fcntl
import os
import platform
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Final, NamedTuple

from agglom_mpi.compilation.kernels import cache_folder
from agglom_mpi.launcher import find_launcher, launched_size
from agglom_mpi.runtime.provenance import processor
from agglom_mpi.version import __version__

ANSWER_TIMEOUT: Final = 20.0
"""Time limit for an answer of a launcher or of Slurm, s."""


def answer_of(
    words: Sequence[str], environment: Mapping[str, str], seconds: float = ANSWER_TIMEOUT
) -> tuple[bool, str]:
    """Return whether a command succeeds, and what it prints; of one that does not, why."""
    try:
        done = subprocess.run(
            words,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False, f"no answer in {seconds:.0f} s"
    except OSError as error:
        return False, str(error)
    if done.returncode < 0:
        return False, f"ended by signal {-done.returncode}"
    printed = [done.stdout, done.stderr][:: 1 if done.returncode == 0 else -1]
    return done.returncode == 0, next(filter(None, printed), "").strip()


class Finding(NamedTuple):
    """Result of one check: its subject, a word or two, and what was found, one line."""

    topic: str
    found: str
    advice: str = ""
    """Advised change; empty if there is none."""
    broken: bool = False
    """Whether campaigns cannot run, or not on several ranks, unless this is changed."""


NEEDED_FOR: Final = {
    "report": "tables, figures, pages and posteriors",
    "search": "the search cmaes",
}
"""Purpose of each extra that users install; `check_mpi` looks for the extra `mpi`."""

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
    import h5py

    parallel = bool(h5py.get_config().mpi)
    writers = "every rank can write" if parallel else "built without MPI: rank 0 writes for all"
    hdf5 = f"{h5py.__version__}, HDF5 {h5py.version.hdf5_version}, {writers}"
    yield Finding("h5py", hdf5)
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
"""Environment variables with the number of threads of a library."""


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
        advice = "set them to 1: the ranks run in parallel, and more threads only slow them down"
        yield Finding("threads", ", ".join(many), advice)


def check_batch_system(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield what MPI interfaces Slurm offers, and the resources of the current job."""
    job = environment.get("SLURM_JOB_ID")
    if job is not None:
        tasks, nodes = environment.get("SLURM_NTASKS", "1"), environment.get("SLURM_NNODES", "1")
        yield Finding("Slurm job", f"{job}: {tasks} tasks on {nodes} nodes")
    if shutil.which("srun", path=environment.get("PATH")) is None:
        return
    works, answer = answer_of(["srun", "--mpi=list"], environment)
    if not works:
        yield Finding("Slurm", f"srun is installed, but does not find a Slurm: {answer}")
        return
    kinds = [kind for kind in ("pmix", "pmi2", "cray_shasta") if kind in answer.split()]
    found = f"srun --mpi={' or '.join(kinds)}" if kinds else "srun offers no MPI interface"
    yield Finding("Slurm", found, "" if kinds else "start ranks with mpirun in a batch script")


LOCAL_NETWORKS: Final = re.compile(r"docker|virbr|lxcbr|lxdbr|podman|cni|br-")
"""Beginnings of the names of networks within a machine; several machines use the same addresses."""
NETWORK_DEVICES: Final = Path("/sys/class/net")
"""Folder with an entry for each network device (Linux)."""
OPEN_MPI_NETWORK: Final = (
    "Open MPI may wait for ever for a rank on another node; export OMPI_MCA_btl_tcp_if_include and "
    "OMPI_MCA_oob_tcp_if_include with the network of the nodes, for example 10.0.0.0/24"
)
"""Advice where Open MPI may choose a network within the machine."""


def check_nodes(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield networks that Open MPI must not use, and when Slurm gives up a node that is lost."""
    _, version = answer_of([find_launcher(environment) or "mpirun", "--version"], environment)
    if "Open MPI" in version or "OpenRTE" in version:
        found = ", ".join(local_networks())
        if found and "OMPI_MCA_btl_tcp_if_include" not in environment:
            yield Finding("networks", f"{found} in this machine alone", OPEN_MPI_NETWORK)
    _, configuration = answer_of(["scontrol", "show", "config"], environment)
    limit = re.search(r"SlurmdTimeout\s*= (\d+ sec)", configuration)
    if limit:
        found = f"srun ends the job {limit[1]} or more after a node is lost (SlurmdTimeout)"
        yield Finding("lost node", found)


def local_networks(devices: Path = NETWORK_DEVICES) -> list[str]:
    """Return the names of networks within this machine, as containers have them."""
    try:
        return sorted(path.name for path in devices.iterdir() if LOCAL_NETWORKS.match(path.name))
    except OSError:
        return []


INCOHERENT_FILE_SYSTEMS: Final = {"nfs", "nfs4", "cifs", "smb3", "9p"}
"""Shared file systems on which concurrent writes of two machines can mix."""
SHARED_FILE_SYSTEMS: Final = INCOHERENT_FILE_SYSTEMS | {"lustre", "gpfs", "beegfs", "panfs", "ceph"}
"""File systems shared by several machines."""
SLOW_FSYNC: Final = 0.5
"""Minimum time of an fsync, s, that slows down campaigns of short generations."""
LITTLE_SPACE: Final = 2**30
"""Free space, bytes, below which a warning is given."""


def check_storage(folder: Path) -> Iterator[Finding]:
    """Yield the state of the folders of campaign files and of compiled kernels."""
    yield _campaign_folder(folder)
    kernels = cache_folder()
    kind = file_system(kernels)
    advice = ""
    if kind in SHARED_FILE_SYSTEMS:
        advice = "slow where many ranks load it: export NUMBA_CACHE_DIR=$(mktemp -d)"
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
