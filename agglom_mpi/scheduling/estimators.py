"""Estimates for the scheduler: batch sizes, samples a string may need, priorities."""

import heapq
import math
from bisect import bisect_right, insort
from collections.abc import Sequence
from typing import Final

from agglom_mpi.scheduling.interface import MOST_SAMPLES

BATCH_SECONDS: Final = 0.02
"""Work of one message in s, unless rank 0 needs longer ones."""

ROUND_TRIP_SECONDS: Final = 4e-3
"""Idle time between a worker's last result and its next task, in s; both ends poll."""

WOKEN_ROUND_TRIP_SECONDS: Final = 1e-3
"""The same in s where all ranks wake each other."""

SECOND_BATCH_SHARE: Final = 0.004
"""A rank has a second batch in flight if a round trip takes more than this share of one batch."""

COST_MEMORY: Final = 1000
"""Number of messages from which the costs of messages are estimated; older ones fade."""

LEAST_SPREAD: Final = 0.1
"""Relative spread of the lengths of messages below which their costs say little of a sample's."""

RANGE_SECONDS: Final = 3e-4
"""Time of a rank to begin and to end a range of samples, beside that of the samples, s."""

BURST: Final = 4.0
"""Maximum ratio of the cost of a message to the mean, in learning it. What costs more, as proposing
a generation does, would not become cheaper by fewer messages."""

BUSY_SHARE: Final = 0.4
"""Share of its time that rank 0 spends on messages, if all ranks work, above which they grow. Less
than half, as cancellations come in bursts."""

SAMPLE_SHARE: Final = 0.25
"""Minimum useful ratio of the cost of a message to that of its samples: longer messages would save
less, and more of their samples turn out not to be needed."""

QUEUE_PROBABILITY: Final = 0.6
"""Samples less likely than this to be needed are never queued behind other work of a rank."""


class MessageCostModel:
    """What a message, and each sample in it, costs rank 0.

    A regression line through the costs of recent messages of different lengths, exponentially
    weighted. Where all have the same length, the whole cost counts as that of a message.

    Attributes
    ----------
    message, sample
        Cost of a message without its samples, and of a sample, s.
    """

    def __init__(self) -> None:
        self.message = self.sample = 0.0
        self._messages = 0
        self._seconds = self._samples = 0.0  # means per message
        self._variance = self._covariance = 0.0

    def learn(self, seconds: float, messages: int, samples: int) -> None:
        """Update the line with some messages; nothing is learnt from none.

        Parameters
        ----------
        seconds
            Processor time of rank 0's main thread for them, from assigning the samples to storing
            the results, s.
        messages
            Number of messages with results.
        samples
            Number of samples in them.
        """
        if not messages:
            return
        self._messages += messages
        cost, weight = seconds / messages, min(1.0, messages / min(COST_MEMORY, self._messages))
        if self._seconds:
            cost = min(cost, BURST * self._seconds)
        longer, dearer = samples / messages - self._samples, cost - self._seconds
        self._samples += weight * longer
        self._seconds += weight * dearer
        self._variance = (1.0 - weight) * (self._variance + weight * longer**2)
        self._covariance = (1.0 - weight) * (self._covariance + weight * longer * dearer)
        if self._variance:
            slope = self._covariance / (self._variance + (LEAST_SPREAD * self._samples) ** 2)
            self.sample = min(max(0.0, slope), self._seconds / self._samples)
        self.message = max(0.0, self._seconds - self.sample * self._samples)


class BatchSizer:
    """Number of samples in a message, and messages in flight, from recent times and costs.

    Attributes
    ----------
    round_trip
        Idle time between a worker's last result and its next task, in s.
    mean_seconds
        Mean time of a sample in s; 0 while unknown.
    """

    def __init__(self) -> None:
        self.mean_seconds = 0.0
        self._costs = MessageCostModel()
        self.round_trip = ROUND_TRIP_SECONDS

    def learn(self, seconds: Sequence[float]) -> None:
        """Update the exponentially weighted mean with times of samples, in s."""
        count = len(seconds)
        if count:
            weight = 1.0 - 0.95**count if self.mean_seconds else 1.0
            self.mean_seconds += weight * (sum(seconds) / count - self.mean_seconds)

    def learn_cost(self, seconds: float, messages: int, samples: int) -> None:
        """Update the costs of messages with what rank 0 has spent on some, as `MessageCostModel`.

        To be called after each poll that has brought results.
        """
        self._costs.learn(seconds, messages, samples)

    @property
    def message_seconds(self) -> float:
        """Processor time of rank 0 per message apart from that per sample, s; 0 while unknown."""
        return self._costs.message

    def batch_size(self, limit: float, ranks: int = 1, waiting: float = math.inf) -> int:
        """Return the number of samples in a message, 1 … `MOST_SAMPLES`.

        They are `BATCH_SECONDS` of work and at most `limit` samples, but at least as many as leave
        rank 0 half of its time.

        Parameters
        ----------
        limit
            Maximum number of samples where messages cost nothing.
        ranks
            Number of ranks.
        waiting
            Expected number of samples of a generation, at the end of which all ranks wait.
        """
        if not self.mean_seconds:
            return 1
        size = max(min(BATCH_SECONDS / self.mean_seconds, limit), self.least(ranks, waiting))
        return int(max(1.0, min(MOST_SAMPLES, size)))

    def least(self, ranks: int, waiting: float) -> float:
        """Return the fewest samples per message that leave rank 0 half of its time.

        The arguments are those of `batch_size`.
        """
        if not self.mean_seconds:
            return 1.0
        # The longer a message, the longer all wait for the last one, and the less time rank 0
        # takes for all of them. The sum of both is smallest where they are equal.
        cost = self._costs.message
        equal = math.sqrt(waiting * cost / self.mean_seconds)
        left = BUSY_SHARE * self.mean_seconds / ranks - self._costs.sample
        per_sample = max(left, SAMPLE_SHARE * self._costs.sample)
        return min(cost / per_sample, equal) if per_sample > 0.0 else equal

    def judged_range(self, waiting: float, ranks: int) -> float:
        """Return the best number of samples of a range that its rank may end.

        The longer it is, the longer the others wait for the last ones of a generation, and the less
        time ranks and rank 0 take for all ranges. The sum of both is smallest where they are equal.

        Parameters
        ----------
        waiting
            Expected number of samples of the generation.
        ranks
            Number of ranks.
        """
        if ranks == 1:
            return math.inf
        if not self.mean_seconds:
            return 1.0
        cost = RANGE_SECONDS + ranks * self._costs.message
        return math.sqrt(2.0 * waiting / ranks * cost / self.mean_seconds)

    def most_ranks(self, size: int) -> float:
        """Return the number of ranks whose messages of `size` samples take all of rank 0's time."""
        cost = self._costs.message + size * self._costs.sample
        return 1.0 + size * self.mean_seconds / cost if cost else math.inf

    def range_weight(self, ranks: int, size: int) -> float:
        """Return how much the work of rank 0 counts against a rank's, 1 … `ranks`.

        While rank 0 keeps up, a second of its time is one of one rank. Where all ranks wait for it,
        it is one of each.

        Parameters
        ----------
        ranks
            Number of ranks.
        size
            Number of samples in a message.
        """
        work = size * self.mean_seconds
        cost = self._costs.message + size * self._costs.sample
        busy = ranks * cost / work if work else 0.0
        return 1.0 + (ranks - 1) * min(1.0, busy / BUSY_SHARE)

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

    @property
    def strings(self) -> int:
        """Number of strings learnt from: probabilities change when it does."""
        return len(self._used)

    def probability(self, used: int, sample: int) -> float:
        """Return the probability that a sample is needed, given that `used` ones are not enough.

        Parameters
        ----------
        used
            Samples used so far.
        sample
            Number of the sample in question, at least `used`.
        """
        if sample == used:
            return 1.0
        return self._weight(used, sample) / self._weight(used, used)

    def _weight(self, used: int, sample: int) -> float:
        """Return how many strings needed a sample, and the prior for one that has used some."""
        return len(self._used) - bisect_right(self._used, sample) + (used + 1) / (sample + 1)

    def likely_range(self, used: int, first: int, count: int, loss: float) -> int:
        """Return how many samples are hardly less likely to be needed than the first of them.

        Parameters
        ----------
        used
            Samples used so far.
        first
            Number of the first sample, at least `used`.
        count
            Number of samples; it is halved until those are as likely.
        loss
            Maximum relative loss of the probability from the first to the last sample.
        """
        least = (1.0 - loss) * self._weight(used, first)
        while count > 1 and self._weight(used, first + count - 1) < least:
            count //= 2
        return count


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
