"""The sample that a rank simulates, and for how long: what its heartbeats report."""

from typing import NamedTuple

from agglom_mpi.runtime.abort_flag import AbortFlag
from agglom_mpi.runtime.active_clock import ActiveClock


class SampleUnderWay(NamedTuple):
    """A sample that has begun and is not finished.

    Attributes
    ----------
    string, sample
        Its numbers.
    seconds
        Time since it began, without the time in which the rank was stopped, s.
    """

    string: int
    sample: int
    seconds: float


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
