"""Check that all ranks of a job run the same program, by the first messages of all ranks."""

import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.launch import LaunchError
from agglom_mpi.runtime.messages import PROGRAM
from agglom_mpi.runtime.provenance import sources_digest
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

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
