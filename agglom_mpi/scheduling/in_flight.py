"""Samples in flight: what every rank was given and has not returned; what is given twice."""

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.judge import EnsembleMeans
from agglom_mpi.scheduling.interface import ReturnedPart

MESSAGES_IN_FLIGHT: Final = 2
"""Largest number of batches of a rank: one under way, and one that it finds when it is done."""


class SampleRange(NamedTuple):
    """Samples `first` to `first + size - 1` of a string.

    With the `means` of those before the first where the rank that simulates them may end it, as
    `SampleDemand.judged_from` returns them.
    """

    string: int
    first: int
    size: int
    means: EnsembleMeans | None = None

    def split(self, count: int) -> tuple["SampleRange", "SampleRange"]:
        """Return the first `count` samples, and the others."""
        rest = self.first + count
        return (
            SampleRange(self.string, self.first, count),
            SampleRange(self.string, rest, self.size - count),
        )


class InFlightTable:
    """Batches in flight on every rank, and when each rank was heard last.

    Parameters
    ----------
    ranks
        Number of ranks.

    Attributes
    ----------
    samples
        Number of samples in flight on all ranks.
    silent
        Ranks without a heartbeat, which are given no more.
    """

    def __init__(self, ranks: int) -> None:
        self._batches: list[deque[deque[SampleRange]]] = [deque() for _ in range(ranks)]
        self._holders: dict[int, set[int]] = {}  # of samples of a string, now or before
        self._last_heard = [0.0] * ranks
        self.samples = 0
        self.silent: set[int] = set()
        # Ranks by their number of batches, in the order in which they came to have as many.
        self._with = [dict.fromkeys(range(ranks))] + [{} for _ in range(MESSAGES_IN_FLIGHT)]

    def ranges(self, rank: int) -> Iterator[SampleRange]:
        """Yield what a rank has in flight, in execution order."""
        for batch in self._batches[rank]:
            yield from batch

    def next_rank(self, batches: int) -> int | None:
        """Return the rank with exactly `batches` batches that should finish first, or None."""
        return next(iter(self._with[batches]), None)

    @property
    def working(self) -> int:
        """Number of ranks that have work and are not silent."""
        return sum(len(ranks) for ranks in self._with[1:])

    def assign(self, rank: int, batch: list[SampleRange], now: float) -> None:
        """Add a batch to those of a rank, at the time `now` in s."""
        if not self._batches[rank]:
            self._last_heard[rank] = now  # it had nothing to report before
        self._batches[rank].append(deque(batch))
        self.samples += sum(part.size for part in batch)
        for part in batch:
            self._holders.setdefault(part.string, set()).add(rank)
        self._place(rank, len(self._batches[rank]) - 1)

    def remove(self, rank: int, returned: ReturnedPart) -> SampleRange:
        """Remove and return what a rank no longer has in flight: those left out, too.

        Raises
        ------
        RuntimeError
            If it is not the beginning of what the rank was to do next.
        """
        batches = self._batches[rank]
        part = next(self.ranges(rank), SampleRange(-1, -1, 0))
        if returned[:2] != part[:2] or returned.size > part.size:
            raise RuntimeError(f"rank {rank} sent {returned}; expected was a part of {part}")
        batches[0].popleft()
        if returned.size < part.size and not returned.left_out:
            part, rest = part.split(returned.size)
            batches[0].appendleft(rest)
        elif not batches[0]:
            batches.popleft()
            self._place(rank, len(batches) + 1)
        self.samples -= part.size
        return part

    def close(self, string: int) -> list[tuple[int, int]]:
        """Return the ranks, except silent ones, with samples of a string, and how many.

        No more samples of the string may be assigned after that.
        """
        held = [
            (rank, sum(part.size for part in self.ranges(rank) if part.string == string))
            for rank in sorted(self._holders.pop(string, set()) - self.silent)
        ]
        return [(rank, samples) for rank, samples in held if samples]

    def heartbeat(self, rank: int, now: float) -> bool:
        """Record a heartbeat of `rank`; return True if it was marked silent."""
        self._last_heard[rank] = now
        if rank not in self.silent:
            return False
        self.silent.discard(rank)
        self._with[len(self._batches[rank])][rank] = None
        return True

    def mark_silent(self, before: float) -> list[int]:
        """Mark and return the ranks with work whose last heartbeat is earlier than `before`."""
        marked = [
            rank
            for rank, batches in enumerate(self._batches)
            if batches and self._last_heard[rank] < before and rank not in self.silent
        ]
        for rank in marked:
            self.silent.add(rank)
            self._with[len(self._batches[rank])].pop(rank)
        return marked

    def _place(self, rank: int, before: int) -> None:
        if rank not in self.silent:
            self._with[before].pop(rank)
            self._with[len(self._batches[rank])][rank] = None


@dataclass(slots=True)
class DuplicateSample:
    """A sample of a silent rank: the number of ranks that have it in flight, and if it is back."""

    holders: int = 1
    returned: bool = False


class DuplicateSamples:
    """Samples that several ranks may return; the first result counts.

    They are kept as long as a rank has them in flight; `len` is their number.
    """

    def __init__(self) -> None:
        self._samples: dict[tuple[int, int], DuplicateSample] = {}
        self._waiting: dict[int, list[int]] = {}  # heaps of samples to assign again, by string

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, part: SampleRange, needed: bool) -> None:
        """Add the samples of a silent rank, to be assigned again where they are `needed`."""
        for sample in range(part.first, part.first + part.size):
            self._samples.setdefault((part.string, sample), DuplicateSample())
            if needed:
                heapq.heappush(self._waiting.setdefault(part.string, []), sample)

    def first(self, string: int) -> int | None:
        """Return the first sample of a string to assign again; None if there is none."""
        waiting = self._waiting.get(string, [])
        while waiting and self._is_back(string, waiting[0]):
            heapq.heappop(waiting)
        return waiting[0] if waiting else None

    def take(self, string: int, limit: int) -> SampleRange:
        """Return at most `limit` consecutive samples of a string that are assigned again now."""
        waiting = self._waiting[string]
        first, count = heapq.heappop(waiting), 1
        while waiting and waiting[0] <= first + count:  # one may be there for several ranks
            if waiting[0] == first + count:
                if count == limit or self._is_back(string, waiting[0]):
                    break
                count += 1
            heapq.heappop(waiting)
        for sample in range(first, first + count):
            self._samples[string, sample].holders += 1
        return SampleRange(string, first, count)

    def first_returns(self, part: SampleRange, count: int) -> NDArray[np.bool_]:
        """Return which of the first `count` samples of a range nobody returned before, (count,)."""
        first = np.arange(part.size) < count
        done = first.copy()
        for place in range(part.size) if self._samples else ():
            key = part.string, part.first + place
            duplicate = self._samples.get(key)
            if duplicate is not None:
                first[place] = done[place] and not duplicate.returned
                duplicate.returned |= done[place]
                duplicate.holders -= 1
                if not duplicate.holders:
                    del self._samples[key]
        return first[:count]

    def drop(self, string: int) -> None:
        """Assign no more samples of a string."""
        self._waiting.pop(string, None)

    def _is_back(self, string: int, sample: int) -> bool:
        duplicate = self._samples.get((string, sample))
        return duplicate is None or duplicate.returned
