"""Wall-clock time and processor time of work that one thread does."""

import time
from typing import Final, NamedTuple

BUSY_RATIO: Final = 1.3
"""Ratio of wall-clock to processor time of simulations above which a machine counts as busy.

Where every rank has a core, the thread that serves messages takes up to 6 % of it.
"""


class TimeSpent(NamedTuple):
    """Time that a piece of work took, in s.

    Attributes
    ----------
    wall
        By the clock: what a user waits for.
    cpu
        Of the thread on a processor: what the work costs, whatever else the machine does.
    """

    wall: float
    cpu: float

    def less(self, part: "TimeSpent") -> "TimeSpent":
        """Return the time without that of a part of the work."""
        return TimeSpent(self.wall - part.wall, self.cpu - part.cpu)


class Stopwatch:
    """Measures the time since it was made; only the thread that made it may read it."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), time.thread_time()

    def read(self) -> TimeSpent:
        """Return the time spent so far."""
        return TimeSpent(time.perf_counter() - self._wall, time.thread_time() - self._cpu)
