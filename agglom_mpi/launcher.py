"""What the environment tells of an MPI launcher: number of ranks, rank, rank within the node."""

import os
from collections.abc import Mapping
from typing import Final

_SIZES: Final = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE", "MPI_LOCALNRANKS")


_RANKS: Final = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "MV2_COMM_WORLD_RANK", "PMIX_RANK")

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


def launched_size(environment: Mapping[str, str] = os.environ) -> int | None:
    """Return the number of ranks that were launched; None without a launcher."""
    size = _first(_SIZES, environment)
    return _tasks_of_srun(environment) if size is None else size


def is_first_rank(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether this process is rank 0, the one that prints, by the environment."""
    rank = _first(_RANKS, environment)
    if rank is None and _tasks_of_srun(environment) is not None:
        rank = int(environment.get("SLURM_PROCID", "0"))
    return rank in (None, 0)


def compiles_for_node(rank: int, environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether this rank compiles the kernels for its node while the others wait."""
    local = _first(_LOCAL_RANKS, environment)
    return (rank if local is None else local) == 0
