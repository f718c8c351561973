"""The MPI world, if there is one, the programs and nodes of its ranks, and who writes the file."""

import os
import socket
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import h5py
import numpy as np

from agglom_mpi.errors import UserError
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.launcher import launched_size, rank_variables, started_by_a_rank
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.file_setup import OutputError
from agglom_mpi.runtime.messages import PROGRAM
from agglom_mpi.runtime.provenance import sources_digest
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class LaunchError(UserError, RuntimeError):
    """Launcher, MPI library and the programs of the ranks do not belong together."""

    every_rank: ClassVar[bool] = False
    """Whether each rank shows it, as it may be the only one; else the first rank does."""


class InheritedRankError(LaunchError):
    """A rank of a job has started this process, which the launcher does not know."""

    every_rank: ClassVar[bool] = True


def connect(environment: Mapping[str, str] = os.environ) -> "Intracomm | None":
    """Start MPI if the launcher asks for it, and return the world; None for a plain run.

    Raises
    ------
    LaunchError
        If no MPI library loads, or launcher and library are of different MPIs: the library cannot
        start, or the world has another size than the launch, and every process would run the
        campaign for itself.
    InheritedRankError
        If a rank has started this process: to connect would end in errors of MPI, or never.
    """
    launched = launched_size(environment)
    if launched is None:
        return None
    if started_by_a_rank(environment):
        without = " ".join(f"-u {name}" for name in rank_variables(environment))
        raise InheritedRankError(
            "started by a rank of an MPI job, whose variables it has inherited, and not by the "
            f"launcher; as a plain program: env {without} agglom-invert …"
        )
    import mpi4py

    # The library is asked before it starts, and started below.
    mpi4py.rc.initialize, mpi4py.rc.finalize = False, True
    # It warns on every rank; the error below is shown once.
    warnings.filterwarnings("ignore", "suspicious MPI execution", RuntimeWarning)
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        raise LaunchError(
            f"launched as {launched} MPI rank(s), but no MPI library can be loaded ({error}); "
            "install one, for example: pip install 'agglom_mpi[mpi]'"
        ) from None
    vendor, about = MPI.get_vendor()[0], MPI.Get_library_version().lower()
    only_pmix = "PMIX_NAMESPACE" in environment and not {"PMI_FD", "PMI_PORT"} & environment.keys()
    if only_pmix and vendor == "MPICH" and "pmix" not in about:  # it would abort
        raise LaunchError(
            f"the launcher speaks PMIx, as Open MPI's does, which {vendor} does not{NOT_TOGETHER}"
        )
    if not MPI.Is_initialized():  # as h5py starts it that was built for MPI
        MPI.Init_thread(MPI.THREAD_SERIALIZED)  # rank 0 has a thread for heartbeats
    world = MPI.COMM_WORLD
    if launched != world.size:
        seen = f"the launcher started {launched} processes, but {vendor} sees {world.size}"
        raise LaunchError(f"{seen}{NOT_TOGETHER}")
    return world


NOT_TOGETHER: Final = (
    ": launcher and MPI library do not belong together; use the mpirun of this library, or one "
    "that it speaks: srun --mpi=pmi2 for MPICH, pmix for Open MPI"
)


GATHERED: Final = "gathered"
PARALLEL: Final = "parallel"


def choose_database(asked: str | None, world: "Intracomm | None") -> str:
    """Return what is asked for, or `parallel` if HDF5 can and there are several ranks.

    Raises
    ------
    OutputError
        If `parallel` is asked for and cannot be had.
    """
    able = bool(h5py.get_config().mpi)
    if asked == PARALLEL:
        if not able:
            raise OutputError(
                f"--database parallel: h5py {h5py.__version__} was built without MPI here; allowed "
                "is gathered, or an h5py that was built with HDF5_MPI=ON"
            )
        if world is None:
            raise OutputError("--database parallel: needs ranks; start the program with mpirun")
    if asked is not None:
        return asked
    return PARALLEL if able and world is not None and world.size > 1 else GATHERED


class Nodes(NamedTuple):
    """Nodes that the ranks are on."""

    number: int
    syncs: bool
    """Whether this rank has to put on the disc what ranks of its node have written: one of each
    node does, except on that of rank 0, which does so itself."""
    has_rank_zero: bool = True
    """Whether rank 0 is on the node of this rank."""
    speaks: bool = False
    """Whether this rank is the first one of its node, not counting rank 0."""
    neighbours: tuple[int, ...] = ()
    """Ranks on the node of this rank."""


def find_nodes(world: "Intracomm | None") -> Nodes:
    """Count the nodes; collective."""
    if world is None:
        return Nodes(1, False)
    from mpi4py import MPI

    node = world.Split_type(MPI.COMM_TYPE_SHARED, key=world.rank)
    first = node.rank == 0
    neighbours = tuple(node.allgather(world.rank))
    has_rank_zero = neighbours[0] == 0
    speaks = node.rank == int(has_rank_zero)
    node.Free()
    number = world.allreduce(int(first))
    return Nodes(number, first and world.rank > 0, has_rank_zero, speaks, neighbours)


RECORD: Final = "S256"
"""Version, digest of the sources and host of a rank."""

NOTED_AFTER: Final = 60.0
"""Time, s, after which a missing first message of a rank is reported."""

GIVEN_UP_AFTER: Final = 900.0
"""Time, s, after which a missing first message ends the job. Programs may take minutes to load from
a disc that thousands of ranks share, but a silent one would hold up the job for ever."""

POLLED_EVERY: Final = 0.002
"""Time between two polls for first messages, s."""


class MixedJobError(LaunchError):
    """The ranks run different programs; collective calls are impossible."""


def own_program() -> str:
    """Return `VERSION DIGEST HOST` of this rank."""
    return " ".join([__version__, sources_digest(), socket.gethostname()])


def check_programs(
    world: "Intracomm | None", show: Callable[[str], None] = lambda line: None
) -> None:
    """Send the program of each rank to rank 0, before anything else is sent.

    On rank 0, `show` is called with a line on ranks that are waited for.

    Raises
    ------
    LaunchError
        On rank 0, if a rank runs another version, or other sources that decide results.
    MixedJobError
        On rank 0, if ranks do not send their program, as versions older than this message.
    """
    if world is None:
        return
    own = np.array([own_program().encode()], RECORD)
    if world.rank > 0:
        world.Send(own.view("u1"), dest=0, tag=PROGRAM)
        return
    programs = np.repeat(own, world.size)
    receive_programs(world, programs, show)
    refuse_others([program.decode(errors="replace") for program in programs.tolist()])


def receive_programs(world: "Intracomm", programs: Any, show: Callable[[str], None]) -> None:
    """Receive the programs of the other ranks, (ranks,); raise a MixedJobError if some send none.

    Each sends to rank 0 itself: in a collective call, a silent rank would hide others.
    """
    waited = {
        rank: world.Irecv(programs[rank : rank + 1].view("u1"), source=rank, tag=PROGRAM)
        for rank in range(1, world.size)
    }
    begun, noted = time.monotonic(), False
    while waited := {rank: each for rank, each in waited.items() if not each.Test()}:
        seconds = time.monotonic() - begun
        if seconds > GIVEN_UP_AFTER:
            raise MixedJobError(
                f"no first message from {name_ranks(list(waited))} in "
                f"{format_duration(GIVEN_UP_AFTER)}: another program runs there, or an agglom_mpi "
                "that is too old to say which it is; all ranks of a job need the same"
            )
        if seconds > NOTED_AFTER and not noted:
            show(f"waiting for the first message from {name_ranks(list(waited))}")
            noted = True
        time.sleep(POLLED_EVERY)


class Start(NamedTuple):
    """Broadcast of rank 0 with which the other ranks begin."""

    program: str
    """Program of rank 0."""
    code: int
    """Exit code if there is nothing to run."""
    experiment: Experiment | None
    """Work to run; None if there is none."""
    path: Path | None
    """The campaign file, if ranks write their samples there themselves."""
    more: bool = False
    """Whether another such broadcast follows once this work is finished."""


def receive_start(world: "Intracomm") -> Start:
    """Return the broadcast of rank 0 with which this rank begins.

    Raises
    ------
    MixedJobError
        If rank 0 runs another program, which does not check those of the others.
    """
    try:
        start = Start(*world.bcast(None, root=0))
        its = start.program
        if start.experiment is None or same_program(its, own_program()):
            return start
    except MemoryError:
        raise
    except Exception as error:  # whatever reading a pickle of other sources raises
        its = f"{type(error).__name__}: {error}"
    raise MixedJobError(
        f"rank 0 runs another program ({its}) than rank {world.rank}, {own_program()}; "
        "all ranks of a job need the same"
    )


def same_program(one: str, other: str) -> bool:
    """Return whether two programs have the same version and sources, on whatever host."""
    return one.split(" ")[:2] == other.split(" ")[:2]


def name_ranks(ranks: list[int]) -> str:
    """Return up to five ranks by their numbers, with the number of the others."""
    more = f" and {pluralise(len(ranks) - 5, 'more rank')}" if ranks[5:] else ""
    return f"rank {', '.join(map(str, ranks[:5]))}{more}"


def refuse_others(programs: list[str]) -> None:
    """Raise a LaunchError unless all ranks run the program of rank 0: `VERSION DIGEST HOST`."""
    others = [i for i, each in enumerate(programs) if not same_program(each, programs[0])]
    if others:
        version, digest, _ = programs[0].split(" ", 2)
        their, sources, host = programs[others[0]].split(" ", 2)
        more = f", and {pluralise(len(others) - 1, 'more rank')}" if others[1:] else ""
        raise LaunchError(
            f"rank {others[0]} on {host}{more} runs another agglom_mpi, {their} with the sources "
            f"{sources[:12]}, than rank 0, {version} with the sources {digest[:12]}; all ranks of "
            "a job need the same"
        )
