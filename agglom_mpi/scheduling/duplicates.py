"""Samples in flight on silent ranks, which other ranks simulate once more."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.scheduling.in_flight import SampleRange


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

    def first_returns(self, part: SampleRange, done: Sequence[bool]) -> NDArray[np.bool_]:
        """Return which `done` samples of a range no rank has returned before, shape (size,)."""
        first = np.array(done)
        for place in range(part.size) if self._samples else ():
            key = part.string, part.first + place
            duplicate = self._samples.get(key)
            if duplicate is not None:
                first[place] = done[place] and not duplicate.returned
                duplicate.returned |= done[place]
                duplicate.holders -= 1
                if not duplicate.holders:
                    del self._samples[key]
        return first

    def drop(self, string: int) -> None:
        """Assign no more samples of a string."""
        self._waiting.pop(string, None)

    def _is_back(self, string: int, sample: int) -> bool:
        duplicate = self._samples.get((string, sample))
        return duplicate is None or duplicate.returned
