"""All ranks as rank 0 sees them: its own simulator thread and, under MPI, the workers."""

import time
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.messages import (
    ALIVE,
    FAILED_SAMPLE,
    FAILURE,
    FINALS,
    FRAMES,
    GOODBYE,
    HEARTBEAT,
    RESULT,
    RESULTS,
    STOP,
    SYNC,
    TASKS,
    UNWRITTEN,
    WITHDRAWN,
    WRITTEN,
    heartbeat,
)
from agglom_mpi.runtime.sample_runner import Batch, SampleRunner
from agglom_mpi.runtime.simulation_thread import SimulationThread
from agglom_mpi.runtime.wakeup import LONGEST, PollBackoff, Wakeup, there_is_mail
from agglom_mpi.scheduling.estimators import ROUND_TRIP_SECONDS, WOKEN_ROUND_TRIP_SECONDS
from agglom_mpi.storage.schema import final_particles_schema, frames_schema
from agglom_mpi.storage.table import concatenated

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


STOPS_WITHIN: Final = 20.0
"""Seconds without a word of any rank after which those that should stop are not waited for."""

NO_RESULTS: Final = np.zeros(0, RESULT)
NO_FAILURES: Final = np.zeros(0, FAILED_SAMPLE)


class Delivery(NamedTuple):
    """What a rank sent: results of one batch and what goes with them, or other news.

    `written` is the number of samples that it has written meanwhile. A delivery of nothing is a
    sign of life.
    """

    rank: int
    results: NDArray[np.void] = NO_RESULTS
    failures: NDArray[np.void] = NO_FAILURES
    finals: NDArray[np.void] | None = None
    frames: NDArray[np.void] | None = None
    written: int = 0
    stopped: bool = False


def _own(batch: Batch) -> Delivery:
    """Make a delivery of what the thread of rank 0 has done."""
    return Delivery(
        0,
        concatenated(batch.results, RESULT),
        concatenated(batch.failures, FAILED_SAMPLE),
        concatenated(batch.finals, batch.finals[0].dtype) if batch.finals else None,
        concatenated(batch.frames, batch.frames[0].dtype) if batch.frames else None,
    )


class WorkerPool:
    """Send tasks to ranks and collect what they return.

    Parameters
    ----------
    simulator
        Of this rank.
    world
        The MPI world; None for a plain run.

    Attributes
    ----------
    size
        Number of ranks.
    hosts
        Machines of the ranks, as far as they have said.
    database_seconds
        Time that ranks which have stopped spent on the campaign file, s.
    missing
        Ranks that did not stop when they were told to.
    """

    def __init__(self, simulator: SampleRunner, world: "Intracomm | None") -> None:
        self.size = 1 if world is None else world.size
        self.hosts: dict[int, str] = {}
        self.database_seconds = 0.0
        self.missing: set[int] = set()
        self._dismissed = False
        self._waiting = PollBackoff()
        self._wakeup = Wakeup()
        self._wakeups: dict[int, bytes] = {}  # of ranks on this machine
        self._world = world
        self._thread = SimulationThread(simulator, self._wakeup)
        self._sends: list[tuple[Any, NDArray[np.void]]] = []
        if world is not None:
            from mpi4py import MPI

            self._any_rank, self._byte, self._status = MPI.ANY_SOURCE, MPI.BYTE, MPI.Status()
        self._dtypes: dict[int, np.dtype] = {
            RESULTS: RESULT,
            FAILURE: FAILED_SAMPLE,
            UNWRITTEN: FAILED_SAMPLE,
            WRITTEN: np.dtype(np.int64),
            ALIVE: HEARTBEAT,
            STOP: GOODBYE,
            FINALS: final_particles_schema(simulator.grains).dtype,
            FRAMES: frames_schema(simulator.grains).dtype,
        }

    def send(self, rank: int, tasks: NDArray[np.void]) -> None:
        """Give a rank a batch; never waits."""
        if rank == 0 or self._world is None:
            self._thread.put(tasks)
            return
        self._post(tasks, rank, TASKS)

    def withdraw(self, rank: int, strings: NDArray[np.int64]) -> None:
        """Let a rank leave out what it holds of some strings; never waits."""
        if rank == 0 or self._world is None:
            self._thread.withdraw(strings.tolist())
            return
        self._post(strings, rank, WITHDRAWN)

    def deliveries(self) -> Iterator[Delivery]:
        """Wait a moment, and yield everything that has arrived."""
        rung, found = self._wakeup.wait(self._patience()), False
        for delivery in self._arrived():
            found = True
            yield delivery
        self._waiting.looked(found, rung)

    @property
    def turnround(self) -> float:
        """Time that a rank without work waits for more, s."""
        return WOKEN_ROUND_TRIP_SECONDS if self._all_ring else ROUND_TRIP_SECONDS

    @property
    def _all_ring(self) -> bool:
        return len(self._wakeups) == self.size - 1

    def _arrived(self) -> Iterator[Delivery]:
        yield from self._mail()
        while (finished := self._thread.take()) is not None:
            yield _own(finished)

    def _patience(self) -> float:
        """How long to wait, s; large messages need somebody who looks after them."""
        self._forget_sent()
        return self._waiting.at_most(self._all_ring and not self._sends)

    def sync(self) -> None:
        """Ask all other ranks to put on the disc what they have written; never waits.

        Ranks that were told to stop do so without being asked.
        """
        for rank in range(1, 0 if self._dismissed else self.size):
            self._post(np.zeros(1, np.int32), rank, SYNC)

    def dismiss(self, code: int, silent: Collection[int] = ()) -> Iterator[Delivery]:
        """Stop every rank, which then exit with `code`, and yield what they still send.

        Samples under way are abandoned. Ranks that are `silent`, or say nothing for a while, are
        not waited for; they are `missing` then. `database_seconds` is complete when this ends.
        """
        self._dismissed = True
        self._thread.stop()
        while (own := self._thread.take()) is not None:
            yield _own(own)
        if self._world is None:
            return
        for rank in range(1, self.size):
            self._post(np.array([code], np.int32), rank, STOP)
        working = set(range(1, self.size))
        heard = time.monotonic()
        while working.difference(silent) and time.monotonic() - heard < STOPS_WITHIN:
            for delivery in self._mail():
                yield delivery
                heard = time.monotonic()
                if delivery.stopped:
                    working.discard(delivery.rank)
            time.sleep(LONGEST)
        self.missing = working
        if not working:
            for request, _ in self._sends:
                request.Wait()

    def _post(self, message: NDArray[Any], rank: int, tag: int) -> None:
        assert self._world is not None
        self._forget_sent()
        self._sends.append((self._world.Isend([message, self._byte], dest=rank, tag=tag), message))
        if rank in self._wakeups and not self._wakeup.ring_at(self._wakeups[rank]):
            del self._wakeups[rank]

    def _forget_sent(self) -> None:
        if self._sends:
            self._sends = [(sent, kept) for sent, kept in self._sends if not sent.Test()]

    def _mail(self) -> Iterator[Delivery]:
        if self.size == 1 or self._world is None:
            return
        status = self._status
        while there_is_mail(self._world, self._any_rank, status):
            rank, tag = status.Get_source(), status.Get_tag()
            dtype = self._dtypes[tag]
            content = np.empty(status.Get_count(self._byte) // dtype.itemsize, dtype)
            self._world.Recv([content, self._byte], source=rank, tag=tag)
            yield self._read(rank, tag, content)

    def _read(self, rank: int, tag: int, content: NDArray[Any]) -> Delivery:
        if tag == RESULTS:
            return Delivery(rank, results=content)
        if tag == FAILURE:
            return Delivery(rank, failures=content)
        if tag == FINALS:
            return Delivery(rank, finals=content)
        if tag == FRAMES:
            return Delivery(rank, frames=content)
        if tag == WRITTEN:
            return Delivery(rank, written=int(content[0]))
        if tag == ALIVE:
            self._meet(rank, content)
            return Delivery(rank)
        if tag == UNWRITTEN:
            host, text = (content[name][0].decode() for name in ("host", "text"))
            raise OSError(f"rank {rank} on {host}: {text}")
        self.database_seconds += float(content["database_seconds"][0])
        return Delivery(rank, stopped=True)

    def _meet(self, rank: int, present: NDArray[Any]) -> None:
        """Take note of where a rank is, and of its wakeup if that is in reach."""
        self.hosts[rank] = present["host"][0].decode()
        wakeup = bytes(present["wakeup"][0])
        if rank not in self._wakeups and self._wakeup.ring_at(wakeup):
            self._wakeups[rank] = wakeup
            self._post(heartbeat(self._wakeup.name), rank, ALIVE)
