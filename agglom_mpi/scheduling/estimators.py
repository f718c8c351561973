"""Estimates for the scheduler: batch sizes, samples a string may need, priorities."""

import heapq
from bisect import bisect_right, insort
from collections.abc import Sequence
from typing import Final

from agglom_mpi.scheduling.interface import MOST_SAMPLES

BATCH_SECONDS: Final = 0.02
"""Work of one message in s: handling it takes rank 0 some 100 µs, less than 1 % of that."""

ROUND_TRIP_SECONDS: Final = 4e-3
"""Idle time between a worker's last result and its next task, in s; both ends poll."""

WOKEN_ROUND_TRIP_SECONDS: Final = 1e-3
"""The same in s where all ranks wake each other."""

SECOND_BATCH_SHARE: Final = 0.004
"""A rank has a second batch in flight if a round trip takes more than this share of one batch."""

QUEUE_PROBABILITY: Final = 0.6
"""Samples less likely than this to be needed are never queued behind other work of a rank."""


class BatchSizer:
    """Number of samples in a message, and messages in flight, from recent sample times.

    Attributes
    ----------
    round_trip
        Idle time between a worker's last result and its next task, in s.
    mean_seconds
        Mean time of a sample in s; 0 while unknown.
    """

    def __init__(self) -> None:
        self.mean_seconds = 0.0
        self.round_trip = ROUND_TRIP_SECONDS

    def learn(self, seconds: Sequence[float]) -> None:
        """Update the exponentially weighted mean with times of samples, in s."""
        count = len(seconds)
        if count:
            weight = 1.0 - 0.95**count if self.mean_seconds else 1.0
            self.mean_seconds += weight * (sum(seconds) / count - self.mean_seconds)

    def batch_size(self, limit: float) -> int:
        """Return the number of samples in a message: `BATCH_SECONDS` of work, 1 … `limit`."""
        if not self.mean_seconds:
            return 1
        return int(max(1.0, min(MOST_SAMPLES, BATCH_SECONDS / self.mean_seconds, limit)))

    def batches_per_rank(self, size: int) -> int:
        """Return how many batches of `size` samples to keep in flight per rank (1 or 2)."""
        # One, where a second would tie the rank to long samples that may become unnecessary.
        return 2 if self.round_trip > SECOND_BATCH_SHARE * size * self.mean_seconds else 1

    def queue_probability(self, size: int) -> float:
        """Return the least probability of being needed of samples queued behind `size` others."""
        # A rank that waits for better ones idles for a round trip; queued ones may turn out to be
        # unnecessary before it comes to them.
        seconds = size * self.mean_seconds
        if not seconds:
            return QUEUE_PROBABILITY
        return max(QUEUE_PROBABILITY, 1.0 - self.round_trip / seconds)


class SampleCountModel:
    """Empirical distribution of the number of samples that a string needs.

    A prior counts as much as one string: a string is as likely as not to need twice the samples
    that it has used.
    """

    def __init__(self) -> None:
        self._used: list[int] = []
        self._sum = 0

    def learn(self, used: int) -> None:
        """Add a string that needed `used` samples."""
        insort(self._used, used)
        self._sum += used

    @property
    def mean(self) -> float:
        """Mean number of samples of a string; 0 without data."""
        return self._sum / len(self._used) if self._used else 0.0

    def probability(self, used: int, sample: int) -> float:
        """Return the probability that a sample is needed, given that `used` ones are not enough.

        Parameters
        ----------
        used
            Samples used so far.
        sample
            Number of the sample in question, at least `used`.
        """
        prior = (used + 1) / (sample + 1)
        return (self._more_than(sample) + prior) / (self._more_than(used) + 1)

    def _more_than(self, samples: int) -> int:
        return len(self._used) - bisect_right(self._used, samples)


class PriorityQueue:
    """Strings by priority, the highest first, and the lowest number first among equals.

    Entries that are out of date are dropped when they reach the top of the heap.
    """

    def __init__(self) -> None:
        self._heap: list[tuple[float, int]] = []
        self._priority: dict[int, float] = {}

    def put(self, string: int, priority: float) -> None:
        """Insert a string, or change its priority."""
        if self._priority.get(string) != priority:
            self._priority[string] = priority
            heapq.heappush(self._heap, (-priority, string))

    def remove(self, string: int) -> None:
        """Remove a string if it is there."""
        self._priority.pop(string, None)

    def first(self) -> tuple[float, int] | None:
        """Return the highest priority and its string; None if the queue is empty."""
        while self._heap:
            priority, string = -self._heap[0][0], self._heap[0][1]
            if self._priority.get(string) == priority:
                return priority, string
            heapq.heappop(self._heap)
        return None
