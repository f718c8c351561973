"""The sample under way: how another thread ends it early, and measures how long it takes."""

import math
import time
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.simulation.sample_range import Watch, new_watch

_NONE_FINISHED: Final = np.zeros(1, np.int64)


class AbortFlag:
    """Ends samples early, from another thread than the one that simulates, and names them.

    All of them on `stop`, one that takes too long on `check_time`, any one on `interrupt`.

    Parameters
    ----------
    max_seconds
        Longest time of a sample in s; None without a limit.

    Attributes
    ----------
    abort
        Read by kernels, shape (1,); anything but 0 ends them.
    begun
        When the sample under way began, by `time.monotonic`, shape (1,), s; nan between samples.
        Kernels write it, too.
    stopped
        Whether no more samples are wanted.
    """

    def __init__(self, max_seconds: float | None) -> None:
        self.abort = np.zeros(1, np.uint8)
        self.stopped = False
        self.max_seconds = max_seconds
        self.begun = np.full(1, np.nan)
        self._first = -1, -1  # string, and number of the first sample of a call
        self._finished = _NONE_FINISHED

    def stop(self) -> None:
        """End all samples, from now on."""
        self.stopped = True
        self.abort[0] = 1

    def check_time(self) -> None:
        """End the sample under way if it has taken too long."""
        if self._late:
            self.abort[0] = 1

    def interrupt(self) -> None:
        """End the sample under way, if there is one; it may be simulated again."""
        self.abort[0] = 1

    def begin(self, string: int = -1, sample: int = -1) -> None:
        """Start the clock of a sample, and name it."""
        self._first, self._finished = (string, sample), _NONE_FINISHED
        self.begun[0] = time.monotonic()

    def follow(self, finished: NDArray[np.int64]) -> None:
        """Follow a compiled call, which has finished `finished`, (1,), of its samples so far."""
        self._finished = finished

    @property
    def under_way(self) -> tuple[int, int] | None:
        """String and number of the sample under way; None between samples."""
        if math.isnan(self.begun[0]):
            return None
        (string, first), finished = self._first, int(self._finished[0])
        return string, first + finished

    def watch(self, seconds: float) -> Watch:
        """Return the watch of samples in compiled code, the last begun within `seconds`."""
        most = math.inf if self.max_seconds is None else self.max_seconds
        return new_watch(self.abort, self.begun, most, seconds)

    def end(self) -> tuple[bool, bool]:
        """Stop the clock; return if the sample took too long, and if it may be cut off."""
        late, self.begun[0] = self._late, np.nan
        interrupted = bool(self.abort[0])
        if interrupted and not self.stopped:
            self.abort[0] = 0
            if self.stopped:  # just now
                self.abort[0] = 1
        return late, interrupted

    @property
    def _late(self) -> bool:
        begun, most = float(self.begun[0]), self.max_seconds
        return most is not None and time.monotonic() - begun > most


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


class SampleUnderWay(NamedTuple):
    """A sample that has begun and is not finished."""

    string: int
    sample: int
    """Its numbers."""
    seconds: float
    """Time since it began, without the time in which the rank was stopped, s."""


class SampleClock:
    """Measures how long the sample under way takes.

    Parameters
    ----------
    flag
        Names the sample under way.
    """

    def __init__(self, flag: AbortFlag) -> None:
        self._flag = flag
        self._clock = ActiveClock()
        self._seen: tuple[tuple[int, int], float] | None = None
        self._since = 0.0

    def read(self) -> SampleUnderWay | None:
        """Return the sample under way, None between samples; to be called often."""
        now, named = self._clock.read(), self._flag.under_way
        seen = None if named is None else (named, float(self._flag.begun[0]))
        if seen != self._seen:
            self._seen, self._since = seen, now
        return None if named is None else SampleUnderWay(*named, now - self._since)
