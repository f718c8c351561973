"""Several runs of one job, each by one rank alone: rank r has every n-th of them.

Nothing is sent while they run, but a request to stop, from rank 0 to all.
"""

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import (
    BAD_INPUT,
    FINISHED,
    STOPPED,
    UserError,
    error_text,
)
from agglom_mpi.runtime.launch import MixedJobError, check_programs
from agglom_mpi.runtime.leg import RunRequest, wait
from agglom_mpi.runtime.run import end_job, end_job_by
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.watches import LauncherWatch

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

T = TypeVar("T")

STOP_WORD: Final = 1
CODE: Final = 2
"""Message tags of a communicator of their own."""
POLLED_EVERY: Final = 0.05
"""Time between two looks whether other ranks have finished, s."""


class SharedStop(StopRequest):
    """A request to stop that rank 0 passes on to the other ranks.

    Parameters
    ----------
    max_walltime
        As for `StopRequest`.
    world
        The ranks; None: there is one only.
    """

    def __init__(self, max_walltime: float | None, world: "Intracomm | None") -> None:
        super().__init__(max_walltime)
        self._world = world
        self._word = np.zeros(1, np.uint8)
        self._sent: list[Any] = []
        self._received: Any = None
        if world is not None and world.rank > 0:
            self._received = world.Irecv(self._word, source=0, tag=STOP_WORD)

    @property
    def reason(self) -> str:
        """The reason to stop, as text, whoever has it; empty while there is none."""
        if self._received is not None and self._received.Test():
            self._received = None
            if self._word[0]:
                self.request("rank 0 stops")
        if (found := super().reason) and self._world is not None and self._world.rank == 0:
            self.tell(stops=True)
        return found

    def tell(self, stops: bool) -> None:
        """On rank 0, send all others once whether they are to stop."""
        if self._world is not None and not self._sent:
            self._word[0] = stops
            for rank in range(1, self._world.size):
                self._sent.append(self._world.Isend(self._word, dest=rank, tag=STOP_WORD))

    def finish(self) -> None:
        """Wait until the word of rank 0 has arrived."""
        for request in [*self._sent, *filter(None, [self._received])]:
            wait(request)


def shared(
    read: Callable[[], T], display: Display, world: "Intracomm | None"
) -> tuple[int, T | None]:
    """Return what rank 0 reads, on all ranks; where it cannot be read, None and the exit code.

    Parameters
    ----------
    read
        Called on rank 0 only, may raise the user's mistakes.
    display
        Shows these.
    world
        The MPI world; None for a plain run.
    """
    if world is not None and world.rank > 0:
        check_programs(world)
        code, found = world.bcast(None, root=0)
        return code, found
    code, found = FINISHED, None
    try:
        check_programs(world, display.message)
        found = read()
    except (UserError, OSError) as error:
        display.error(error_text(error))
        code = error.exit_code if isinstance(error, UserError) else BAD_INPUT
        if isinstance(error, MixedJobError) and world is not None:
            end_job(world, code)
    except BaseException as error:
        if world is not None:
            end_job_by(error, world)
        raise
    if world is not None:
        world.bcast((code, found), root=0)
    return code, found


def run_separately(
    requests: Sequence[RunRequest],
    run: Callable[[RunRequest, StopRequest], int],
    world: "Intracomm | None",
    max_walltime: float | None = None,
) -> int:
    """Run every n-th of the requests on this rank, and wait for the n ranks; all ranks call this.

    Parameters
    ----------
    requests
        The same on all ranks.
    run
        Runs one of them, without other ranks, and returns its exit code. It looks whether there is
        a reason to stop.
    world
        The MPI world; None for a plain run.
    max_walltime
        Time in s after which to stop cleanly.

    Returns
    -------
    int
        The exit code, the same on all ranks: 0 if all runs have finished, 75 if some were stopped,
        else that of a run that failed.
    """
    if world is None:
        return _run_own(requests, run, StopRequest(max_walltime))
    own = world.Dup()
    stop = SharedStop(max_walltime, own)
    watch = LauncherWatch(lambda: stop.request("the launcher is gone"))
    try:
        code = _run_own(requests[own.rank :: own.size], run, stop)
        code = _worst_of_all(code, stop, own)
    except BaseException as error:
        end_job_by(error, world)
        raise
    watch.end(code)
    own.Free()
    return code


def _run_own(
    requests: Sequence[RunRequest],
    run: Callable[[RunRequest, StopRequest], int],
    stop: StopRequest,
) -> int:
    """Run requests one after the other until one does not finish; return the exit code."""
    stop.listen()
    for request in requests:
        code = STOPPED if stop.reason else run(request, stop)
        if code != FINISHED:
            return code
    return FINISHED


def _worst_of_all(code: int, stop: SharedStop, world: "Intracomm") -> int:
    """Return the exit code of all ranks together; while rank 0 waits, it passes a stop on."""
    codes = np.full(world.size, code, np.int32)
    if world.rank == 0:
        pending = [
            world.Irecv(codes[rank : rank + 1], source=rank, tag=CODE)
            for rank in range(1, world.size)
        ]
        while not all(request.Test() for request in pending):
            _ = stop.reason
            time.sleep(POLLED_EVERY)
        stop.tell(stops=False)
    else:
        wait(world.Isend(codes[:1], dest=0, tag=CODE))
    stop.finish()
    failed = sorted({int(each) for each in codes} - {FINISHED, STOPPED})
    worst = failed[0] if failed else int(codes.max())
    found = np.array([worst], np.int32)
    wait(world.Ibcast(found, root=0))
    return int(found[0])
