"""Ranks that rank 0 does not hear: others do their work, and they are named; and its heartbeats.

A message to a process that has ended may end its sender, by a segmentation fault in UCX, which
MPICH uses.
"""

import math
import threading
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.abort_flag import ActiveClock
from agglom_mpi.runtime.launch import name_ranks
from agglom_mpi.runtime.messages import ALIVE, RankMessage, heartbeat
from agglom_mpi.runtime.watches import NAMED_AFTER, patience
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.scheduling.static_scheduler import StaticScheduler

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class GoneRanks:
    """Ranks that are gone for the rest of this leg; what they still send is kept.

    A rank on another host ends when it has not heard rank 0 for a while, because the connection is
    lost or rank 0 is suspended. Rank 0 stops sending two heartbeats earlier, as the last one may
    have been sent long before, and as it may look late.

    Attributes
    ----------
    after
        Silence, s, of a rank or of rank 0 itself, after which a rank may have ended.
    suspended
        Whether rank 0 was suspended for that long.
    """

    def __init__(
        self, remote: Collection[int] = (), *, beats: bool = True, beat_every: float = 0.0
    ) -> None:
        _, ends = patience(same_host=False, beats=beats)
        self.after = ends - 2.0 * beat_every if remote else math.inf
        self.suspended = False
        self._remote, self._gone = frozenset(remote), set[int]()
        self._looked = time.monotonic()

    def include(self, rank: int) -> bool:
        """Return whether a rank is gone; to be asked before each message, and every second."""
        now = time.monotonic()
        if now - self._looked >= self.after:
            self.suspended = True
            self._gone |= self._remote
        self._looked = now
        return rank in self._gone

    def add(self, silent: Iterable[int]) -> list[int]:
        """Add those of some silent ranks that are on other hosts; return new ones."""
        found = [rank for rank in silent if rank in self._remote - self._gone]
        self._gone.update(found)
        return found


ALIVE_EVERY: Final = 1.5
"""Time without another message, s, after which a rank sends a heartbeat."""

REASSIGNED_AFTER: Final = 5.0
"""Time without a message, s, after which the work of a rank is given to others, too."""

STALLED_AFTER: Final = 600.0
"""The same of a rank that has reported that it writes to the campaign file, s: its file system may
stall, and the rank sends nothing then."""

RANKS_AT_THIS_PACE: Final = 2000
"""Maximum number of ranks with these intervals. Of more ranks they are longer in proportion, as
rank 0 would be busy with heartbeats."""


def pace(ranks: int) -> float:
    """Return how much longer the intervals of a job are, by its number of ranks."""
    return max(1.0, ranks / RANKS_AT_THIS_PACE)


class RankWatch:
    """When each rank was heard last, by a clock that stands still while rank 0 does not listen.

    Parameters
    ----------
    ranks
        Number of ranks.
    hosts
        Host of each rank, as far as it is known.
    show
        Shows one line.
    gone
        Ranks to which nothing is sent any more; this adds to them.

    Attributes
    ----------
    silent
        Ranks that have been named and not been heard since.
    """

    def __init__(
        self, ranks: int, hosts: Mapping[int, str], show: Callable[[str], None], gone: GoneRanks
    ) -> None:
        self._gone = gone
        self.silent: set[int] = set()
        self._hosts = hosts
        self._show = show
        self._pace = pace(ranks)
        self._named = self._pace * NAMED_AFTER
        self._clock = ActiveClock()
        self._heard = np.full(ranks, self.now())
        self._patience = np.full(ranks, self._named)
        self._patience[0] = math.inf

    def now(self) -> float:
        """Return the time of this clock, s; to be called in every round."""
        return self._clock.read()

    def name_rank(self, rank: int) -> str:
        """Return a rank and its host as text."""
        host = self._hosts.get(rank)
        return f"rank {rank}" if host is None else f"rank {rank} on {host}"

    def hear(
        self,
        scheduler: Scheduler | StaticScheduler,
        messages: Sequence[RankMessage],
        now: float,
    ) -> None:
        """Take into account who has sent messages; a rank that is gone gets no work again."""
        for message in messages:
            rank = message.rank
            if self._gone.include(rank):
                continue
            self._heard[rank] = now
            if rank:
                self._patience[rank] = STALLED_AFTER if message.writes else self._named
            scheduler.in_flight.heartbeat(rank, now)
            if rank in self.silent:
                self.silent.discard(rank)
                self._show(f"{self.name_rank(rank)} is back")

    def check(self, scheduler: Scheduler | StaticScheduler, now: float) -> list[int]:
        """Let others do the work of silent ranks; name and return those silent for long."""
        present = self._heard > now - self._patience
        for rank in np.flatnonzero(present & (self._patience > self._named)).tolist():
            scheduler.in_flight.heartbeat(rank, now)  # it may write for long, or is this rank
        scheduler.mark_silent(now, self._pace * REASSIGNED_AFTER)
        limits = np.maximum(self._patience, self._gone.after)
        if gone := self._gone.add(np.flatnonzero(self._heard <= now - limits).tolist()):
            self._show(f"{name_ranks(gone)} may have ended: this run sends nothing there any more")
        late = set(np.flatnonzero(~present).tolist()) - self.silent
        if not late:
            return []
        # Of a host that is lost, the ranks were not heard last in the same moment.
        nearly = self._heard <= now - self._patience + 2.0 * self._pace * ALIVE_EVERY
        hosts = {self._hosts.get(rank) for rank in late} - {None}
        found = late | {
            rank
            for rank in np.flatnonzero(nearly).tolist()
            if rank not in self.silent and self._hosts.get(rank) in hosts
        }
        self.silent |= found
        for host in dict.fromkeys(self._hosts.get(rank) for rank in sorted(found)):
            self._name([rank for rank in sorted(found) if self._hosts.get(rank) == host], host)
        return sorted(found)

    def _name(self, ranks: list[int], host: str | None) -> None:
        """Show which ranks of a host are silent, and if it is all of them."""
        there = {rank for rank, its in self._hosts.items() if its == host}
        seconds = min(float(self._patience[rank]) for rank in ranks)
        if host is not None and host != self._hosts.get(0) and there <= self.silent:
            who = f"host {host} ({name_ranks(ranks)}) has"
        else:
            have = "has" if len(ranks) == 1 else "have"
            who = f"{name_ranks(ranks)}{'' if host is None else f' on {host}'} {have}"
        its = "its" if who.endswith("has") else "their"
        self._show(f"{who} not been heard of for {seconds:g} s; others do {its} work")


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
