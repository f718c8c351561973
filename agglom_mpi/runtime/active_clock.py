"""A clock of the time in which a process was awake, not stopped or held up."""

import time
from typing import Final

LONGEST_STEP: Final = 1.0
"""Maximum time, s, that passes between two readings: whoever reads the clock often was held up."""


class ActiveClock:
    """Monotonic clock that stands still while its process cannot read it.

    A process that is stopped, or whose file system stalls, has not listened in that time: nobody
    was silent then, and no sample took longer.
    """

    def __init__(self) -> None:
        self._last = self._seconds = time.monotonic()

    def read(self) -> float:
        """Return the time in s; it advances by at most `LONGEST_STEP` since the last reading."""
        now = time.monotonic()
        self._seconds += min(now - self._last, LONGEST_STEP)
        self._last = now
        return self._seconds
