"""Estimates for the scheduler: sample times, samples a string may need, priorities."""

import heapq
from bisect import bisect_right, insort
from collections.abc import Sequence
from typing import Final

from agglom_mpi.scheduling.interface import MOST_SAMPLES

BATCH_SECONDS: Final = 0.02
"""Work in one message: what serving one costs rank 0, some 100 µs, is less than 1 % of it."""

ROUND_TRIP_SECONDS: Final = 4e-3
"""Time that a rank without work waits for more, s: both sides look for mail every so often."""

WOKEN_ROUND_TRIP_SECONDS: Final = 1e-3
"""The same where all ring for each other, s."""

LOSS: Final = 0.004
"""A rank may hold a second batch where a turn-round is more than this part of one."""

QUEUED: Final = 0.6
"""Samples less likely than this to be needed never wait in the queue of a rank that has work."""


class BatchSizer:
    """Time of samples, as it was measured lately.

    Attributes
    ----------
    turnround
        Time that a rank without work waits for more, s.
    mean_seconds
        Of a sample; 0 while it is not known.
    """

    def __init__(self) -> None:
        self.mean_seconds = 0.0
        self.turnround = ROUND_TRIP_SECONDS

    def learn(self, seconds: Sequence[float]) -> None:
        """Take what samples took, s."""
        count = len(seconds)
        if count:
            weight = 1.0 - 0.95**count if self.mean_seconds else 1.0
            self.mean_seconds += weight * (sum(seconds) / count - self.mean_seconds)

    def batch(self, most: float) -> int:
        """Return the samples for a message: no less than pays, no more than `most`, at least 1."""
        if not self.mean_seconds:
            return 1
        return int(max(1.0, min(MOST_SAMPLES, BATCH_SECONDS / self.mean_seconds, most)))

    def in_flight(self, batch: int) -> int:
        """Batches of so many samples for each rank: two, but one of long samples ties it down."""
        return 2 if self.turnround > LOSS * batch * self.mean_seconds else 1

    def queued(self, batch: int) -> float:
        """Return how likely samples must be to be needed to wait behind so many others.

        A rank that waits for better ones loses a turn-round; others may turn out not to be needed
        before it comes to them.
        """
        seconds = batch * self.mean_seconds
        return max(QUEUED, 1.0 - self.turnround / seconds) if seconds else QUEUED


class SampleCountModel:
    """Samples that strings turned out to need, of which each was one string's worth.

    With no experience a string is as likely to need twice the samples that it has had as not to;
    that guess goes on counting as much as one string.
    """

    def __init__(self) -> None:
        self._used: list[int] = []
        self._sum = 0

    def learn(self, used: int) -> None:
        """Take note of a string that needed so many samples."""
        insort(self._used, used)
        self._sum += used

    @property
    def mean(self) -> float:
        """Mean number of samples that a string needed; nought with no experience."""
        return self._sum / len(self._used) if self._used else 0.0

    def chance(self, judged: int, sample: int) -> float:
        """Probability that a sample is needed, given that those before `judged` were not enough.

        Parameters
        ----------
        judged
            Samples judged so far.
        sample
            Number of the sample in question, at least `judged`.
        """
        guess = (judged + 1) / (sample + 1)
        return (self._more_than(sample) + guess) / (self._more_than(judged) + 1)

    def _more_than(self, samples: int) -> int:
        return len(self._used) - bisect_right(self._used, samples)


class PriorityQueue:
    """Strings by a chance each, the likeliest first, and of those that are as likely the first.

    What is out of date is dropped when it comes to the top.
    """

    def __init__(self) -> None:
        self._heap: list[tuple[float, int]] = []
        self._chance: dict[int, float] = {}

    def put(self, string: int, chance: float) -> None:
        """Give a string its place, or another one."""
        if self._chance.get(string) != chance:
            self._chance[string] = chance
            heapq.heappush(self._heap, (-chance, string))

    def drop(self, string: int) -> None:
        """Forget a string, if it is there."""
        self._chance.pop(string, None)

    def first(self) -> tuple[float, int] | None:
        """Return the likeliest string after its chance; None of none."""
        while self._heap:
            chance, string = -self._heap[0][0], self._heap[0][1]
            if self._chance.get(string) == chance:
                return chance, string
            heapq.heappop(self._heap)
        return None
