"""All ranks as rank 0 sees them: its own simulator thread and, under MPI, the workers."""

import time
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.database.bulk import final_particles_layout, frames_layout
from agglom_mpi.database.table import joined
from agglom_mpi.farm.messages import (
    ALIVE,
    FAILED_SAMPLE,
    FAILURE,
    FAREWELL,
    FINALS,
    FRAMES,
    HOST,
    RESULT,
    RESULTS,
    STOP,
    SYNC,
    TASKS,
    UNWRITTEN,
    WRITTEN,
)
from agglom_mpi.farm.simulator import Batch, Simulator
from agglom_mpi.farm.thread import SimulatorThread
from agglom_mpi.farm.waiting import LONGEST, Waiting

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


STOPS_WITHIN: Final = 20.0
"""Seconds without a word of any rank after which those that should stop are not waited for."""

ALONE: Final = 0.05
"""Seconds between looks at the clock where there is no mail: own results wake rank 0 at once."""

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
        joined(batch.results, RESULT),
        joined(batch.failures, FAILED_SAMPLE),
        joined(batch.finals, batch.finals[0].dtype) if batch.finals else None,
        joined(batch.frames, batch.frames[0].dtype) if batch.frames else None,
    )


class Crew:
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

    def __init__(self, simulator: Simulator, world: "Intracomm | None") -> None:
        self.size = 1 if world is None else world.size
        self.hosts: dict[int, str] = {}
        self.database_seconds = 0.0
        self.missing: set[int] = set()
        self._dismissed = False
        self._waiting = Waiting()
        self._world = world
        self._thread = SimulatorThread(simulator)
        self._sends: list[tuple[Any, NDArray[np.void]]] = []
        self._dtypes: dict[int, np.dtype] = {
            RESULTS: RESULT,
            FAILURE: FAILED_SAMPLE,
            UNWRITTEN: FAILED_SAMPLE,
            WRITTEN: np.dtype(np.int64),
            ALIVE: HOST,
            STOP: FAREWELL,
            FINALS: final_particles_layout(simulator.grains).dtype,
            FRAMES: frames_layout(simulator.grains).dtype,
        }

    def send(self, rank: int, tasks: NDArray[np.void]) -> None:
        """Give a rank a batch; never waits."""
        if rank == 0 or self._world is None:
            self._thread.put(tasks)
            return
        self._post(tasks, rank, TASKS)

    def deliveries(self) -> Iterator[Delivery]:
        """Everything that has arrived; waits a moment for own results if nothing has."""
        found = False
        for delivery in self._mail():
            found = True
            yield delivery
        patience = ALONE if self.size == 1 else self._waiting.seconds
        finished = self._thread.take(0.0 if found else patience)
        self._waiting.looked(found or finished is not None)
        while finished is not None:
            yield _own(finished)
            finished = self._thread.take(0.0)

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
        while (own := self._thread.take(0.0)) is not None:
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
        from mpi4py import MPI

        assert self._world is not None
        request = self._world.Isend([message, MPI.BYTE], dest=rank, tag=tag)
        self._sends = [(sent, kept) for sent, kept in self._sends if not sent.Test()]
        self._sends.append((request, message))

    def _mail(self) -> Iterator[Delivery]:
        if self.size == 1 or self._world is None:
            return
        from mpi4py import MPI

        status = MPI.Status()
        while self._world.Iprobe(source=MPI.ANY_SOURCE, tag=MPI.ANY_TAG, status=status):
            rank, tag = status.Get_source(), status.Get_tag()
            dtype = self._dtypes[tag]
            content = np.empty(status.Get_count(MPI.BYTE) // dtype.itemsize, dtype)
            self._world.Recv([content, MPI.BYTE], source=rank, tag=tag)
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
            self.hosts[rank] = content["host"][0].decode()
            return Delivery(rank)
        if tag == UNWRITTEN:
            host, text = (content[name][0].decode() for name in ("host", "text"))
            raise OSError(f"rank {rank} on {host}: {text}")
        self.database_seconds += float(content["database_seconds"][0])
        return Delivery(rank, stopped=True)
