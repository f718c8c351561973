"""Who writes samples into the campaign file: rank 0 for all, or every rank its own."""

from typing import TYPE_CHECKING, Final, NamedTuple

import h5py

from agglom_mpi.farm.store import StoreError

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

GATHERED: Final = "gathered"
PARALLEL: Final = "parallel"


def choose_database(asked: str | None, world: "Intracomm | None") -> str:
    """Choose what is asked, or `parallel` if HDF5 can and there are several ranks.

    Raises
    ------
    StoreError
        If `parallel` is asked for and cannot be had.
    """
    able = bool(h5py.get_config().mpi)
    if asked == PARALLEL:
        if not able:
            raise StoreError(
                f"--database parallel: h5py {h5py.__version__} was built without MPI here; allowed "
                "is gathered, or an h5py that was built with HDF5_MPI=ON"
            )
        if world is None:
            raise StoreError("--database parallel: needs ranks; start the program with mpirun")
    if asked is not None:
        return asked
    return PARALLEL if able and world is not None and world.size > 1 else GATHERED


class Nodes(NamedTuple):
    """Machines that the ranks are on.

    `syncs` says whether this rank has to put on the disc what ranks of its node have written:
    one of each node does, but rank 0 for its own.
    """

    number: int
    syncs: bool


def find_nodes(world: "Intracomm | None") -> Nodes:
    """Count the machines; all ranks call this together."""
    if world is None:
        return Nodes(1, False)
    from mpi4py import MPI

    node = world.Split_type(MPI.COMM_TYPE_SHARED, key=world.rank)
    first = node.rank == 0
    node.Free()
    return Nodes(world.allreduce(int(first)), first and world.rank > 0)
