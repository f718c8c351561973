"""All ranks as rank 0 sees them: its own simulating thread and, under MPI, the workers."""

import threading
import time
from collections import deque
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.abort_flag import SampleClock
from agglom_mpi.runtime.messages import (
    ALIVE,
    CANCEL,
    STOP,
    SYNC,
    TASKS,
    PendingSends,
    RankMessage,
    decoded,
    heartbeat,
    own_host,
    record_types,
)
from agglom_mpi.runtime.silence import ALIVE_EVERY, GoneRanks, Heart, pace
from agglom_mpi.runtime.simulation_thread import SimulationThread
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.wakeup import LONGEST, PollBackoff, Wakeup, message_waits
from agglom_mpi.scheduling.estimators import ROUND_TRIP_SECONDS, WOKEN_ROUND_TRIP_SECONDS

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


STOP_TIMEOUT: Final = 20.0
"""Time without a message of any rank, s, after which a shutdown waits no longer."""


class WorkerPool:
    """Send tasks to ranks and collect what they report.

    Parameters
    ----------
    runner
        Of this rank.
    world
        The MPI world; None for a plain run.
    heart_thread
        Whether a thread sends heartbeats; not where HDF5 calls MPI, too.
    remote
        Ranks on other hosts.

    Attributes
    ----------
    size
        Number of ranks.
    gone
        Ranks that may have ended: they are sent nothing any more.
    hosts
        Hosts of the ranks, as far as they have reported.
    database_seconds
        Time that ranks which have stopped spent on the campaign file, in s.
    missing
        Ranks that did not stop when they were asked to, or that the launcher has lost.
    deserted
        Ranks on other hosts whose launcher is gone.
    """

    def __init__(
        self,
        runner: SampleRunner,
        world: "Intracomm | None",
        *,
        heart_thread: bool = True,
        remote: Collection[int] = (),
    ) -> None:
        self.size = 1 if world is None else world.size
        self.hosts: dict[int, str] = {0: own_host().decode()}
        self.database_seconds = 0.0
        self.missing: set[int] = set()
        self.deserted: set[int] = set()
        self._shutting_down = False
        self._backoff = PollBackoff()
        self._wakeup = Wakeup()
        self._wakeups: dict[int, bytes] = {}  # of ranks on this host
        self._world = world
        self._thread = SimulationThread(runner, self._wakeup)
        self._alive_every = pace(self.size) * ALIVE_EVERY
        self._sample_clock = SampleClock(runner.abort_flag)
        self._own_heartbeat = time.monotonic()
        self._sends = PendingSends()
        self._arriving: dict[int, deque[tuple[Any, int, NDArray[Any]]]] = {}  # by rank
        self._mpi = threading.RLock()  # held by whoever calls MPI
        self._heart: Heart | None = None
        if world is not None:
            self._heart = Heart(world, self._mpi, threaded=heart_thread, remote=remote)
            from mpi4py import MPI

            self._any_rank, self._byte, self._status = MPI.ANY_SOURCE, MPI.BYTE, MPI.Status()
        self.gone = GoneRanks() if self._heart is None else self._heart.gone
        self._record_types = record_types(runner.sizes.grains, runner.sizes.spins)
        self._result_type = runner.result_dtype

    def send(self, rank: int, tasks: NDArray[np.void]) -> None:
        """Send a batch, (n,) of `scheduling.interface.task_type`, to a rank; never waits."""
        if rank == 0 or self._world is None:
            self._thread.put(tasks)
            return
        self._post(tasks, rank, TASKS)

    def cancel(self, rank: int, strings: NDArray[np.int64]) -> None:
        """Let a rank leave out its samples of some strings, (n,); never waits."""
        if rank == 0 or self._world is None:
            self._thread.cancel(strings.tolist())
            return
        self._post(strings, rank, CANCEL)

    def poll(self) -> Iterator[RankMessage]:
        """Wait a moment, and yield everything that has arrived."""
        rung, found = self._wakeup.wait(self._timeout()), False
        for message in self._arrived():
            found = True
            yield message
        self._backoff.polled(found, rung)
        if self._heart is not None:
            self._heart.beat_if_due()
        under_way, now = self._sample_clock.read(), time.monotonic()
        if now - self._own_heartbeat > self._alive_every and under_way is not None:
            self._own_heartbeat = now
            yield RankMessage(0, under_way=under_way)

    @property
    def round_trip(self) -> float:
        """Idle time between a worker's last result and its next task, in s."""
        return WOKEN_ROUND_TRIP_SECONDS if self._all_wake else ROUND_TRIP_SECONDS

    @property
    def _all_wake(self) -> bool:
        """Whether rank 0 and every other rank wake each other."""
        return len(self._wakeups) == self.size - 1

    def _arrived(self) -> Iterator[RankMessage]:
        yield from self._received()
        while (finished := self._thread.poll()) is not None:
            yield finished

    def _timeout(self) -> float:
        """Return how long to wait in s; large messages proceed only in calls of MPI."""
        self._forget_sent()
        return self._backoff.timeout(self._all_wake and not (self._sends or self._arriving))

    def sync(self) -> None:
        """Ask all other ranks to put on the disc what they have written; never waits.

        Ranks that have been asked to stop do so by themselves.
        """
        for rank in range(1, 0 if self._shutting_down else self.size):
            self._post(np.zeros(1, np.int32), rank, SYNC)

    def shut_down(self, code: int, silent: Collection[int] = ()) -> Iterator[RankMessage]:
        """Stop every rank, which then exits with `code`, and yield what they still report.

        Samples under way are abandoned. Ranks that are `silent`, or report nothing for
        `STOP_TIMEOUT`, are not waited for; they are `missing` then. `database_seconds` is complete
        when this ends.
        """
        self._shutting_down = True
        self._thread.stop()
        while (own := self._thread.poll()) is not None:
            yield own
        if self._world is None or self._heart is None:
            return
        self._heart.stop()
        working = set(range(1, self.size))
        silent = {*silent, *filter(self.gone.include, working)}
        # To send to a host that is lost may end this process. Ranks there end by themselves.
        lost = {rank for rank in silent if self.hosts.get(rank) != self.hosts[0]}
        for rank in sorted(working - lost):
            self._post(np.array([code], np.int32), rank, STOP)
        heard = time.monotonic()
        while working.difference(silent) and time.monotonic() - heard < STOP_TIMEOUT:
            for message in self._received():
                yield message
                heard = time.monotonic()
                if message.stopped:
                    working.discard(message.rank)
            time.sleep(LONGEST)
        self.missing = working | self.deserted
        if not working:
            self._sends.wait()

    def _post(self, records: NDArray[Any], rank: int, tag: int) -> None:
        assert self._world is not None
        assert self._heart is not None
        with self._mpi:
            if self.gone.include(rank):
                return
            self._forget_sent()
            request = self._world.Isend([records, self._byte], dest=rank, tag=tag)
        self._sends.add(request, records)
        self._heart.sent(rank)
        if rank in self._wakeups and not self._wakeup.ring_at(self._wakeups[rank]):
            del self._wakeups[rank]

    def _forget_sent(self) -> None:
        if self._sends:
            with self._mpi:
                self._sends.forget_sent()

    def _received(self) -> Iterator[RankMessage]:
        if self.size == 1 or self._world is None:
            return
        status = self._status
        while True:
            with self._mpi:
                if not message_waits(self._world, self._any_rank, status):
                    break
                rank, tag = status.Get_source(), status.Get_tag()
                dtype = self._record_types[tag]
                records = np.empty(status.Get_count(self._byte) // dtype.itemsize, dtype)
                request = self._world.Irecv([records, self._byte], source=rank, tag=tag)
            self._arriving.setdefault(rank, deque()).append((request, tag, records))
            yield from self._whole(rank)
        for rank in list(self._arriving):
            yield from self._whole(rank)

    def _whole(self, rank: int) -> Iterator[RankMessage]:
        """Yield the messages of a rank that are here, in order.

        Of a long one the rest may never come, as the connection is lost: nothing waits for it.
        """
        arriving = self._arriving[rank]
        while arriving:
            request, tag, records = arriving[0]
            with self._mpi:
                if not request.Test():
                    return
            arriving.popleft()
            if tag == ALIVE:
                self._register(rank, records)
            message = decoded(rank, tag, records, self._result_type)
            self.database_seconds += message.database_seconds
            yield message
        del self._arriving[rank]

    def _register(self, rank: int, record: NDArray[np.void]) -> None:
        """Keep the host of a rank, and the name that it is woken by if that is in reach."""
        self.hosts[rank] = record["host"][0].decode()
        if record["alone"][0] and self.hosts[rank] != self.hosts[0]:
            self.deserted.add(rank)
        wakeup = bytes(record["wakeup"][0])
        if rank not in self._wakeups and self._wakeup.ring_at(wakeup):
            self._wakeups[rank] = wakeup
            self._post(heartbeat(self._wakeup.name), rank, ALIVE)
