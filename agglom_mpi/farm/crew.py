"""All ranks as rank 0 sees them: its own simulator thread and, under MPI, the workers."""

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.messages import (
    FAILED_SAMPLE,
    FAILURE,
    MOST_TASKS,
    RESULT,
    RESULTS,
    STOP,
    TASKS,
)
from agglom_mpi.farm.simulator import Simulator, SimulatorThread

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class Delivery(NamedTuple):
    """What a rank sent: results of one batch (possibly none) and failures."""

    rank: int
    results: NDArray[np.void]
    failures: NDArray[np.void]


class Crew:
    """Send tasks to ranks and collect what they return.

    Parameters
    ----------
    simulator
        Of this rank.
    world
        The MPI world; None for a plain run.
    """

    def __init__(self, simulator: Simulator, world: "Intracomm | None") -> None:
        self.size = 1 if world is None else world.size
        self._world = world
        self._thread = SimulatorThread(simulator)
        self._sends: list[tuple[Any, NDArray[np.void]]] = []
        self._results = np.zeros(MOST_TASKS, RESULT)
        self._failure = np.zeros(1, FAILED_SAMPLE)

    def send(self, rank: int, tasks: NDArray[np.void]) -> None:
        """Give a rank a batch; never waits."""
        if rank == 0 or self._world is None:
            self._thread.put(tasks)
            return
        from mpi4py import MPI

        request = self._world.Isend([tasks, MPI.BYTE], dest=rank, tag=TASKS)
        self._sends = [(sent, kept) for sent, kept in self._sends if not sent.Test()]
        self._sends.append((request, tasks))

    def deliveries(self, timeout: float) -> Iterator[Delivery]:
        """Everything that has arrived; waits at most `timeout` in s for own results."""
        yield from self._mail()
        finished = self._thread.take(timeout)
        while finished is not None:
            results, failures = finished
            yield Delivery(0, results, np.concatenate([np.zeros(0, FAILED_SAMPLE), *failures]))
            finished = self._thread.take(0.0)

    def dismiss(self, code: int) -> None:
        """Stop every rank, which then exit with `code`; samples under way are abandoned."""
        if self._world is None:
            self._thread.stop()
            return
        message = np.array([code], np.int32)
        requests = [sent for sent, _ in self._sends]
        for rank in range(1, self.size):
            requests.append(self._world.Isend(message, dest=rank, tag=STOP))
        self._thread.stop()
        self._see_off()
        for request in requests:
            request.Wait()

    def _see_off(self) -> None:
        """Drop what workers still send, for they may wait in it, until each says it stopped."""
        from mpi4py import MPI

        assert self._world is not None
        status = MPI.Status()
        working = self.size - 1
        while working:
            if not self._world.Iprobe(source=MPI.ANY_SOURCE, tag=MPI.ANY_TAG, status=status):
                time.sleep(0.001)
                continue
            rank, tag = status.Get_source(), status.Get_tag()
            self._world.Recv([self._results, MPI.BYTE], source=rank, tag=tag)
            working -= tag == STOP

    def _mail(self) -> Iterator[Delivery]:
        if self.size == 1 or self._world is None:
            return
        from mpi4py import MPI

        status = MPI.Status()
        while self._world.Iprobe(source=MPI.ANY_SOURCE, tag=MPI.ANY_TAG, status=status):
            rank, tag = status.Get_source(), status.Get_tag()
            if tag == FAILURE:
                self._world.Recv([self._failure, MPI.BYTE], source=rank, tag=tag)
                yield Delivery(rank, np.zeros(0, RESULT), self._failure.copy())
            else:
                self._world.Recv([self._results, MPI.BYTE], source=rank, tag=RESULTS, status=status)
                count = status.Get_count(MPI.BYTE) // RESULT.itemsize
                yield Delivery(rank, self._results[:count].copy(), np.zeros(0, FAILED_SAMPLE))
