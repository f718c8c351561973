"""What the environment tells of an MPI launcher: number of ranks, rank, rank within the node."""

import fcntl
import os
import shutil
import stat
import sys
import sysconfig
import termios
from collections.abc import Iterator, Mapping
from itertools import takewhile
from pathlib import Path
from typing import Final

_SIZES: Final = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE", "MPI_LOCALNRANKS")


_RANKS: Final = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "MV2_COMM_WORLD_RANK", "PMIX_RANK")

LAUNCHING: Final = {
    *("mpirun", "mpiexec", "mpiexec.hydra", "hydra_pmi_proxy"),
    *("orterun", "orted", "prterun", "prted", "prun", "slurmstepd"),
}
"""Names of processes that start ranks; Linux cuts names to 15 characters."""

PROC: Final = Path("/proc")

_RANK_PREFIXES: Final = ("OMPI_", "PMI_", "PMIX_", "MPI_", "MV2_", "HYDI_", "PRTE_")
"""Prefixes of environment variables by which a process knows that it is a rank."""
_SETTING_PREFIXES: Final = ("OMPI_MCA_", "OMPI_ALLOW", "PRTE_MCA_")
"""Prefixes of those among them that users set."""

_LOCAL_RANKS: Final = (
    "OMPI_COMM_WORLD_LOCAL_RANK",
    "MPI_LOCALRANKID",
    "MV2_COMM_WORLD_LOCAL_RANK",
    "SLURM_LOCALID",
)


def _first(names: tuple[str, ...], environment: Mapping[str, str]) -> int | None:
    for name in names:
        if environment.get(name, "").isdigit():
            return int(environment[name])
    return None


def _tasks_of_srun(environment: Mapping[str, str]) -> int | None:
    """Return the number of tasks of the Slurm step; None outside and in steps of one task.

    An interactive step of `salloc` has one task, but its SLURM_NTASKS is that of the allocation.
    """
    if "SLURM_STEP_ID" not in environment:
        return None
    tasks = _first(("SLURM_STEP_NUM_TASKS", "SLURM_NTASKS"), environment)
    return None if tasks == 1 else tasks


def python_command(program: str) -> list[str]:
    """Return the words that start this Python with a program: how all children are started.

    The current folder comes last where Python looks for modules, and only if the package itself is
    found there: a folder with files of a stranger has modules of any name.
    """
    # `-I` would leave out PYTHONPATH and the packages of the user, where MPI may be installed.
    found = f"import sys; sys.path.append({str(Path(__file__).parents[1])!r})\n"
    return [sys.executable, "-P", "-c", found + program]


def launched_size(environment: Mapping[str, str] = os.environ) -> int | None:
    """Return the number of ranks that were launched; None without a launcher."""
    size = _first(_SIZES, environment)
    return _tasks_of_srun(environment) if size is None else size


def rank_variables(environment: Mapping[str, str] = os.environ) -> list[str]:
    """Return the names of the variables that make this process a rank."""
    names = dict.fromkeys((*_SIZES, *_RANKS, "SLURM_STEP_ID"))
    return [name for name in names if name in environment]


def without_rank_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment in which a process is no rank; settings of the user stay."""
    return {
        name: value
        for name, value in environment.items()
        if name.startswith(_SETTING_PREFIXES) or not name.startswith(_RANK_PREFIXES)
    }


def find_launcher(environment: Mapping[str, str], *, own_first: bool = False) -> str | None:
    """Return the path of mpirun, None if there is none.

    Parameters
    ----------
    environment
        Its PATH is searched, and the folder of programs of this Python.
    own_first
        Whether that folder comes first, as where the ranks are to run this Python.
    """
    folders = [environment.get("PATH", os.defpath), sysconfig.get_path("scripts")]
    return shutil.which("mpirun", path=os.pathsep.join(folders[::-1] if own_first else folders))


def started_by_a_rank(environment: Mapping[str, str] = os.environ, proc: Path = PROC) -> bool:
    """Return whether a rank has started this process, which has inherited its variables.

    Its connection to the launcher is closed then, or belongs to a process above this one that has
    loaded an MPI library. A shell between launcher and rank has loaded none.
    """
    connection = environment.get("PMI_FD", "")
    if connection.isdigit():
        try:
            os.fstat(int(connection))
        except OSError:
            return True
    try:
        # The processes above this one, up to the launcher that has started it.
        parents = takewhile(lambda pid: not _launches(pid, proc), _above(os.getpid(), proc))
        return any(_is_mpi_program(proc / str(pid)) for pid in parents)
    except (OSError, ValueError):  # of another user, or just gone
        return False


def launching_process(proc: Path = PROC) -> int:
    """Return the launcher's process that this one descends from; the parent if none is known.

    Raises
    ------
    OSError
        If the system does not show the processes above, or one of them has just ended.
    """
    above = (pid for pid in _above(os.getpid(), proc) if _launches(pid, proc))
    return next(above, os.getppid())


def _above(pid: int, proc: Path) -> Iterator[int]:
    while True:
        # The name, in brackets, may hold brackets and spaces itself.
        pid = int((proc / str(pid) / "stat").read_text().rpartition(")")[2].split()[1])
        if pid <= 1:
            return
        yield pid


def _launches(pid: int, proc: Path) -> bool:
    return (proc / str(pid) / "comm").read_text().strip() in LAUNCHING


def _is_mpi_program(process: Path) -> bool:
    """Return whether a process has an MPI library and the variables of a rank."""
    entries = (process / "environ").read_bytes().split(b"\0")
    names = {entry.partition(b"=")[0].decode(errors="replace") for entry in entries}
    return not names.isdisjoint(_RANKS) and b"/libmpi" in (process / "maps").read_bytes()


def is_first_rank(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether this process is rank 0, the one that prints, by the environment."""
    rank = _first(_RANKS, environment)
    if rank is None and _tasks_of_srun(environment) is not None:
        rank = int(environment.get("SLURM_PROCID", "0"))
    return rank in (None, 0)


def unread_input(descriptor: int = 0) -> int:
    """Return the number of bytes that wait on standard input, where it is a pipe or a socket.

    A launcher reads its own standard input, and hands it to rank 0.
    """
    try:
        mode = os.fstat(descriptor).st_mode
        if not (stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)):
            return 0
        waiting = fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4))
    except OSError:
        return 0
    return int.from_bytes(waiting, sys.byteorder)


def compiles_for_node(rank: int, environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether this rank compiles the kernels for its node while the others wait."""
    local = _first(_LOCAL_RANKS, environment)
    return (rank if local is None else local) == 0
