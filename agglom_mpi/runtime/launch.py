"""The MPI world, if there is one, its nodes, and who writes the campaign file."""

import os
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

import h5py

from agglom_mpi.errors import UserError
from agglom_mpi.formatting import pluralise
from agglom_mpi.launcher import launched_size, rank_variables, started_by_a_rank
from agglom_mpi.runtime.file_setup import OutputError

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class LaunchError(UserError, RuntimeError):
    """Launcher, MPI library and the programs of the ranks do not belong together.

    Attributes
    ----------
    every_rank : bool
        Whether each rank shows it, as it may be the only one; else the first rank does.
    """

    every_rank: ClassVar[bool] = False


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


def taken_input(count: int) -> str:
    """Return a line on bytes of standard input that the launcher has read."""
    return (
        f"the launcher has read {pluralise(count, 'byte')} of standard input, which no rank uses; "
        "a loop `while read` around it ends with this campaign: add </dev/null to the launcher's "
        "command"
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
