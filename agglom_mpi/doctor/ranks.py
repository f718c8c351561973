"""Checks of MPI: whether two ranks find each other, and for how many there is shared memory."""

import os
import re
import shutil
import signal
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from agglom_mpi.doctor.machine import Finding, answer_of
from agglom_mpi.formatting import pluralise
from agglom_mpi.launcher import (
    find_launcher,
    launched_size,
    python_command,
    without_rank_variables,
)

MPI_TIMEOUT: Final = 60.0
"""Time limit for two ranks to connect, s; a busy cluster may take a while."""
INSTALL_MPI: Final = (
    "pip install 'agglom_mpi[mpi]' (brings its own mpirun), or load the cluster's MPI module"
)
MPI_PROBE: Final = """
import mpi4py
mpi4py.rc.thread_level = "serialized"
from mpi4py import MPI
world = MPI.COMM_WORLD
levels = ("single", "funneled", "serialized", "multiple")
if world.rank == 0:
    version = " ".join(MPI.Get_library_version().split()[:3]).rstrip(",")
    print(f"{world.size};{levels[MPI.Query_thread()]};{version}", flush=True)
"""
"""Code that each rank runs: prints size of the world, thread level and library."""


def check_mpi(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield whether MPI loads and two ranks connect; in a rank, only the launched size."""
    promised = launched_size(environment)
    if promised is not None:
        yield Finding("launched as", f"{promised} ranks", "run it without mpirun to see more")
        return
    probe, clean = python_command(MPI_PROBE), without_rank_variables(environment)
    loads, alone = answer_of(probe, clean, MPI_TIMEOUT)
    if not loads or alone.count(";") != 2:
        found = f"cannot be loaded: {_main_line(alone)}"
        yield Finding("MPI library", found, _advice_on(alone), broken=True)
        return
    _, level, version = alone.split(";")
    yield Finding("MPI library", f"{version}, thread level {level}")
    launcher = find_launcher(environment)
    if launcher is None:
        yield Finding("mpirun", "not found", INSTALL_MPI, broken=True)
        return
    works, output = answer_of([launcher, "-n", "2", *probe], clean, MPI_TIMEOUT)
    if not works or output.count(";") < 2:
        found = f"{launcher} fails: {_main_line(output)}"
        yield Finding("mpirun", found, _advice_on(output), broken=True)
        return
    size, _, started = output.splitlines()[-1].split(";")
    if size == "2":
        yield Finding("mpirun", f"{launcher}: 2 ranks find each other ({started})")
    else:
        advice = f"put the mpirun of {version} first on PATH; {INSTALL_MPI}"
        found = f"{launcher} starts 2 processes that do not find each other"
        yield Finding("mpirun", found, advice, broken=True)


_SIGNAL: Final = re.compile(r"\bsignal (\d+)")
"""How launchers name what ended a rank: `Bus error (signal 7)`, `on signal 7 (Bus error)`."""


def _main_line(output: str) -> str:
    """Return the most informative line: a signal, the last of a traceback, else the first."""
    if ended := _SIGNAL.search(output):
        number = int(ended[1])
        names = {each.value: each.name for each in signal.Signals}  # not those of real time
        return f"ended by {names.get(number, f'signal {number}')} ({signal.strsignal(number)})"
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


LARGER_SHARED_MEMORY: Final = (
    "ranks of one machine take some 5 MB each of /dev/shm, and without it a signal ends them: "
    "docker run --shm-size=1g, or mount -o remount,size=1g /dev/shm"
)
SHARED_MEMORY: Final = Path("/dev/shm")
"""Where the ranks of one machine share memory."""
SHARED_BY_RANK: Final = 11 * 2**19
"""Shared memory of a rank, bytes: MPICH takes 5.4 million, and some more at the start."""


def shared_ranks() -> int:
    """Return the number of ranks that the free shared memory suffices for; 0 without any."""
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
