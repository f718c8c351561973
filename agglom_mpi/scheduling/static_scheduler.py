"""Static scheduling: tasks that are known beforehand."""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.scheduling.estimators import BatchSizer
from agglom_mpi.scheduling.in_flight import MESSAGES_IN_FLIGHT, InFlightTable, SampleRange
from agglom_mpi.scheduling.interface import ReturnedPart, runs


class SampleSet:
    """Samples of strings; `len` is their number.

    Parameters
    ----------
    parts
        Ranges of samples that are in the set; a string may have several.
    """

    def __init__(self, parts: Iterable[SampleRange]) -> None:
        of_string: dict[int, list[SampleRange]] = {}
        for part in parts:
            of_string.setdefault(part.string, []).append(part)
        self._first: dict[int, int] = {}
        self._flags: dict[int, NDArray[np.bool_]] = {}
        for string, ranges in of_string.items():
            first = min(part.first for part in ranges)
            flags = np.zeros(max(part.first + part.size for part in ranges) - first, np.bool_)
            for part in ranges:
                flags[part.first - first :][: part.size] = True
            self._first[string], self._flags[string] = first, flags
        self._count = sum(int(np.count_nonzero(flags)) for flags in self._flags.values())

    def __len__(self) -> int:
        return self._count

    def discard(self, strings: NDArray[np.int64], samples: NDArray[np.int64]) -> None:
        """Take samples out, by string and number, (n,) each; those of no range are ignored."""
        for string in np.unique(strings).tolist():
            if string in self._flags:
                flags, places = self._flags[string], samples[strings == string]
                places = places - self._first[string]
                places = places[(places >= 0) & (places < len(flags))]
                self._count -= int(np.count_nonzero(flags[np.unique(places)]))
                flags[places] = False

    def take(self, part: SampleRange) -> NDArray[np.bool_]:
        """Take a range out that once was in the set; return which of it still were, (size,)."""
        flags = self._of(part)
        found = flags.copy()
        flags[:] = False
        self._count -= int(np.count_nonzero(found))
        return found

    def runs(self) -> Iterator[SampleRange]:
        """Yield ranges of consecutive samples, in the order in which their strings were given."""
        for string, flags in self._flags.items():
            yield from self.runs_in(SampleRange(string, self._first[string], len(flags)))

    def runs_in(self, part: SampleRange) -> Iterator[SampleRange]:
        """Yield the ranges of a range that are in the set; it must once have been."""
        for run in runs(self._of(part)):
            yield SampleRange(part.string, part.first + run.start, run.stop - run.start)

    def _of(self, part: SampleRange) -> NDArray[np.bool_]:
        begin = part.first - self._first[part.string]
        return self._flags[part.string][begin : begin + part.size]


BATCHES_PER_RANK: Final = 2 * MESSAGES_IN_FLIGHT
"""Fewest batches into which what waits for each rank is divided, so that all end together."""


class StaticScheduler:
    """Assign given samples to ranks; those in flight on a silent rank to others, too.

    They are assigned in order, one by one until their time is known, and then in batches that are
    worth a message.

    Parameters
    ----------
    tasks
        (n,) of `task_type`; of one string all have the same frames and parameters.
    ranks
        Number of ranks.

    Attributes
    ----------
    batch_sizer
        Learns how long samples and messages take.
    in_flight
        What every rank was given and has not returned.
    """

    def __init__(self, tasks: NDArray[np.void], ranks: int) -> None:
        self.batch_sizer = BatchSizer()
        self.in_flight = InFlightTable(ranks)
        self._ranks = ranks
        self._type = tasks.dtype
        self._of_string = {int(task["string"]): task for task in tasks}
        self._waiting = deque(
            SampleRange(*part) for part in tasks[["string", "first", "count"]].tolist()
        )
        self._waiting_samples = sum(part.size for part in self._waiting)
        self._open = SampleSet(self._waiting)

    def assignments(self, now: float) -> Iterator[tuple[int, NDArray[np.void]]]:
        """Yield ranks and their new tasks, arrays of `task_type`, at the time `now` in s."""
        share = self._waiting_samples / (BATCHES_PER_RANK * self._ranks)
        size = self.batch_sizer.batch_size(share)
        for batches in range(self.batch_sizer.batches_per_rank(size)):
            while self._waiting and (rank := self.in_flight.next_rank(batches)) is not None:
                if not (batch := self._next_batch(size)):
                    return
                self.in_flight.assign(rank, batch, now)
                yield rank, self._tasks(batch)

    def _next_batch(self, size: int) -> list[SampleRange]:
        """Take at most `size` samples that wait and that no rank has done meanwhile."""
        batch: list[SampleRange] = []
        while self._waiting and size:
            part = self._waiting.popleft()
            part, rest = part.split(min(size, part.size))
            if rest.size:
                self._waiting.appendleft(rest)
            self._waiting_samples -= part.size
            for run in self._open.runs_in(part):
                size -= run.size
                if batch and run[:2] == (batch[-1].string, batch[-1].first + batch[-1].size):
                    batch[-1] = batch[-1]._replace(size=batch[-1].size + run.size)
                else:
                    batch.append(run)
        return batch

    def _tasks(self, batch: list[SampleRange]) -> NDArray[np.void]:
        tasks = np.zeros(len(batch), self._type)
        for i, part in enumerate(batch):
            tasks[i] = self._of_string[part.string]
            tasks[i]["first"], tasks[i]["count"] = part.first, part.size
        return tasks

    def returned(self, rank: int, part: ReturnedPart) -> list[slice]:
        """Take the next samples of a rank off those in flight.

        Returns
        -------
        list
            The places of those in the part that no rank has returned before.
        """
        removed = self.in_flight.remove(rank, part)
        return runs(self._open.take(removed._replace(size=part.size)))

    def done(self, rank: int) -> None:
        """Take the next sample of a rank off those in flight."""
        string, first, *_ = next(self.in_flight.ranges(rank))
        self.returned(rank, ReturnedPart(string, first, 1, left_out=False))

    def mark_silent(self, now: float, timeout: float) -> list[int]:
        """Mark and return ranks that have work and were not heard for `timeout` s; reassign it."""
        marked = self.in_flight.mark_silent(now - timeout)
        repeated = [part for rank in marked for part in self.in_flight.ranges(rank)]
        self._waiting.extendleft(reversed(repeated))
        self._waiting_samples += sum(part.size for part in repeated)
        return marked
