"""Heartbeats of rank 0 to all other ranks, also while it decides, writes or prints for long."""

import threading
import time
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, Final

from numpy.typing import NDArray

from agglom_mpi.runtime.messages import ALIVE, heartbeat
from agglom_mpi.runtime.silence import GoneRanks

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

BEAT_EVERY: Final = 5.0
"""Time without another message to a rank, s, after which it gets a heartbeat."""

LOOKS_PER_BEAT: Final = 5
"""How often, relative to `BEAT_EVERY`, rank 0 looks who needs one."""


class Heart:
    """Sends heartbeats, by a thread of its own where MPI may be called by several in turn.

    Parameters
    ----------
    world
        The MPI world.
    lock
        Held by whoever calls MPI.
    threaded
        Whether a thread may call MPI while the main thread does something else; that is not so
        where HDF5 calls MPI, too. Without it, `beat_if_due` has to be called.
    remote
        Ranks on other hosts.

    Attributes
    ----------
    gone
        Ranks to which nothing is sent any more.
    """

    def __init__(
        self, world: "Intracomm", lock: Any, *, threaded: bool, remote: Collection[int] = ()
    ) -> None:
        from mpi4py import MPI

        threaded = threaded and may_call_in_turn()
        self.gone = GoneRanks(remote, beats=threaded, beat_every=BEAT_EVERY)
        self._world, self._byte, self._lock = world, MPI.BYTE, lock
        self._record: NDArray[Any] = heartbeat(b"")
        self._last = [time.monotonic()] * world.size
        self._pending: dict[int, Any] = {}
        self._looked = time.monotonic()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._work, name="heart", daemon=True)
            self._thread.start()

    def sent(self, rank: int) -> None:
        """Take into account that a rank has been sent something else."""
        self._last[rank] = time.monotonic()

    def beat_if_due(self) -> None:
        """Send heartbeats now and then, unless a thread does so."""
        now = time.monotonic()
        if self._thread is None and now - self._looked > BEAT_EVERY / LOOKS_PER_BEAT:
            self._looked = now
            self.beat()

    def beat(self) -> None:
        """Send heartbeats to ranks that have got nothing for long; never waits.

        A rank that has not taken in the last one, as its connection is lost, gets no other.
        """
        with self._lock:
            now = time.monotonic()
            for rank in range(1, self._world.size):
                if self.gone.include(rank) or now - self._last[rank] < BEAT_EVERY:
                    continue
                if rank in self._pending and not self._pending[rank].Test():
                    continue
                buffer = [self._record, self._byte]
                self._pending[rank] = self._world.Isend(buffer, dest=rank, tag=ALIVE)
                self._last[rank] = now

    def stop(self) -> None:
        """Send no more."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        while not self._ended.wait(BEAT_EVERY / LOOKS_PER_BEAT):
            self.beat()


def may_call_in_turn() -> bool:
    """Return whether MPI may be called by several threads, one at a time."""
    from mpi4py import MPI

    return bool(MPI.Query_thread() >= MPI.THREAD_SERIALIZED)
