"""Ranks on other hosts that may have ended: rank 0 sends nothing to them any more.

A message to a process that has ended may end its sender, by a segmentation fault in UCX, which
MPICH uses.
"""

import math
import time
from collections.abc import Collection, Iterable

from agglom_mpi.runtime.coordinator_watch import Patience


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
        patience = Patience.of(same_host=False, beats=beats)
        self.after = patience.ends - 2.0 * beat_every if remote else math.inf
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
