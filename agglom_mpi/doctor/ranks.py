"""MPI: the library, the launcher, and whether the two belong together."""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from typing import Final

from agglom_mpi.doctor.finding import Finding
from agglom_mpi.farm.launch import promised_size

TRIED_FOR: Final = 60.0
"""Seconds for two ranks to find each other; a busy cluster may take some."""
GET_MPI: Final = (
    "pip install 'agglom_mpi[mpi]' (brings its own mpirun), or load the cluster's MPI module"
)
ASK: Final = """
import mpi4py
mpi4py.rc.thread_level = "funneled"
from mpi4py import MPI
world = MPI.COMM_WORLD
levels = ("single", "funneled", "serialized", "multiple")
if world.rank == 0:
    version = " ".join(MPI.Get_library_version().split()[:3]).rstrip(",")
    print(f"{world.size};{levels[MPI.Query_thread()]};{version}", flush=True)
"""
"""What each rank runs: size of the world, thread level, library."""
LAUNCHERS: Final = ("OMPI_", "PMI_", "PMIX_", "MPI_", "MV2_", "HYDI_", "PRTE_")
"""How variables begin that tell a process that it is a rank."""


def look(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Start MPI in other processes and see what happens; in a rank, tell what it was promised."""
    promised = promised_size(environment)
    if promised is not None:
        yield Finding("launched as", f"{promised} ranks", "run it without mpirun to see more")
        return
    alone = _run([sys.executable, "-c", ASK], environment)
    if not _is_answer(alone):
        yield Finding("MPI library", f"cannot be loaded: {_last(alone)}", GET_MPI, broken=True)
        return
    _, level, version = alone.split(";")
    yield Finding("MPI library", f"{version}, thread level {level}")
    launcher = _launcher(environment)
    if launcher is None:
        yield Finding("mpirun", "not found", GET_MPI, broken=True)
        return
    yield _two_ranks(launcher, version, environment)


def _launcher(environment: Mapping[str, str]) -> str | None:
    """Find mpirun; that of a virtual environment, which may not be activated, comes last."""
    folders = environment.get("PATH", os.defpath), sysconfig.get_path("scripts")
    return shutil.which("mpirun", path=os.pathsep.join(folders))


def _two_ranks(launcher: str, version: str, environment: Mapping[str, str]) -> Finding:
    said = _run([launcher, "-n", "2", sys.executable, "-c", ASK], environment)
    if not _is_answer(said):
        return Finding("mpirun", f"{launcher} fails: {_last(said)}", _way_out(said), broken=True)
    size, _, started = said.splitlines()[-1].split(";")
    if size != "2":
        advice = f"put the mpirun of {version} first on PATH; {GET_MPI}"
        found = f"{launcher} starts 2 processes that do not find each other"
        return Finding("mpirun", found, advice, broken=True)
    return Finding("mpirun", f"{launcher}: 2 ranks find each other ({started})")


def _run(words: list[str], environment: Mapping[str, str]) -> str:
    clean = {k: v for k, v in environment.items() if not k.startswith(LAUNCHERS)}
    kept = {k: v for k, v in environment.items() if k.startswith(("OMPI_MCA_", "OMPI_ALLOW"))}
    kept |= {k: v for k, v in environment.items() if k.startswith("PRTE_MCA_")}
    try:
        done = subprocess.run(
            words,
            env=clean | kept,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TRIED_FOR,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no answer in {TRIED_FOR:.0f} s"
    except OSError as error:
        return str(error)
    return (done.stdout if done.returncode == 0 else done.stderr or done.stdout).strip()


def _is_answer(said: str) -> bool:
    return bool(said) and said.splitlines()[-1].count(";") == 2


def _last(said: str) -> str:
    """Return the line that tells most: the last of a traceback, or the first of a complaint."""
    lines = [line.strip() for line in said.splitlines() if line.strip(" -*=")]
    if not lines:
        return "no answer"
    return lines[-1] if lines[0].startswith("Traceback") else lines[0]


def _way_out(said: str) -> str:
    if "as root" in said:
        return "as root: export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1"
    if "slots" in said:
        return "more ranks than it counts cores: export OMPI_MCA_rmaps_base_oversubscribe=1"
    return GET_MPI
