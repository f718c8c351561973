"""Dynamic scheduling of samples: a pure state machine, without MPI, files or a clock.

Events go in (`returned`, `update`, `in_flight.heartbeat`, `mark_silent`); assignments and
cancellations come out.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.scheduling.estimators import BatchSizer, PriorityQueue, SampleCountModel
from agglom_mpi.scheduling.in_flight import DuplicateSamples, InFlightTable, SampleRange
from agglom_mpi.scheduling.interface import (
    MOST_SAMPLES,
    ProposeAhead,
    ReturnedPart,
    SampleDemand,
    StringProgress,
    new_tasks,
    runs,
)

TAIL_SHARE: Final = 0.01
"""Maximum of one batch of each rank together, as a share of all samples that known strings need;
more if rank 0 would be saturated."""

URGENCY: Final = 1.5
"""Maximum ratio of the priority of a sample that decisions wait for to that of an equally probable
one of a coming generation."""

URGENCY_PER_RANK: Final = 0.02
"""Increase of the urgency per rank, from 1: few ranks lose little by waiting for the last strings
of a generation, and more by samples that turn out not to be needed."""

MIN_PROBABILITY: Final = 0.02
"""Minimum probability that a sample is needed for it to be simulated."""

RANGE_LOSS: Final = 0.05
"""Maximum relative loss of the probability to be needed from the first to the last sample of a
range, where rank 0 is not busy. Of ranges with n samples, the work of rank 0 per sample is
proportional to 1/n and the loss to n, so that their best length grows with the square root of what
a second of rank 0 counts."""

MAX_RANGE_LOSS: Final = 0.5
"""The same where all ranks wait for rank 0."""

MOST_JUDGED: Final = 256
"""Maximum number of samples of a range whose rank ends it where no more are needed: it has room for
the results of as many."""

GENERATIONS_AHEAD: Final = 4
"""Maximum number of generations ahead whose samples may be simulated."""


class Scheduler:
    """Assign samples to ranks, those first that are most likely to be needed soonest.

    A string gets its samples in order. Open strings go before those of coming generations
    (speculative), which go before samples that are hardly needed. Samples in flight on a silent
    rank are assigned to others, too, and the first result counts.

    Parameters
    ----------
    demand
        The campaign: which strings need samples.
    propose_ahead
        Asked for speculative strings when ranks would otherwise idle.
    ranks
        Number of ranks.
    known
        (string, sample) pairs that need no simulation, from an earlier leg.
    used
        Numbers of samples that strings have needed before.

    Attributes
    ----------
    batch_sizer
        Learns how long samples and messages take.
    in_flight
        What every rank was given and has not returned.
    sample_counts
        Learns how many samples strings need.
    duplicates
        Samples of silent ranks that others simulate once more.
    """

    def __init__(
        self,
        demand: SampleDemand,
        propose_ahead: ProposeAhead,
        ranks: int,
        known: Iterable[tuple[int, int]] = (),
        used: Iterable[int] = (),
    ) -> None:
        self.batch_sizer = BatchSizer()
        self._demand = demand
        self._propose_ahead = propose_ahead
        self._ranks = self._employed = ranks
        self._urgency = min(URGENCY, 1.0 + URGENCY_PER_RANK * ranks)
        self.in_flight = InFlightTable(ranks)
        self.duplicates = DuplicateSamples()
        self.sample_counts = SampleCountModel()
        self._known: dict[int, set[int]] = {}
        self._generation = -1
        self._open: set[int] = set()
        self._next: dict[int, int] = {}  # sample to assign next, by string
        self._learnt: dict[int, int] = {}  # strings learnt from when one was prioritised
        self._urgent, self._speculative = PriorityQueue(), PriorityQueue()
        self._complete: list[int] = []  # strings of which ranks may have unnecessary samples
        self._most_used = 0
        self._range_loss, self._least, self._judged = RANGE_LOSS, 1.0, 1.0
        for string, sample in known:
            self._known.setdefault(string, set()).add(sample)
        for samples in used:
            self.sample_counts.learn(samples)

    def assignments(self, now: float) -> Iterator[tuple[int, NDArray[np.void]]]:
        """Yield ranks and their new tasks, arrays of `task_type`, at the time `now` in s."""
        self._follow_generation()
        size = self._batch_size()
        self._employed = int(min(self._ranks, self.batch_sizer.most_ranks(size)))
        weight = self.batch_sizer.range_weight(self._employed, size)
        self._range_loss = min(MAX_RANGE_LOSS, RANGE_LOSS * math.sqrt(weight))
        self._least = self.batch_sizer.least(self._employed, self._waiting)
        waiting = len(self._open) * max(self.sample_counts.mean, self._most_used)
        self._judged = self.batch_sizer.judged_range(waiting, self._employed)
        for batches in range(self.batch_sizer.batches_per_rank(size)):
            # Of samples for a rank with so many batches in flight.
            least = self.batch_sizer.queue_probability(size) if batches else MIN_PROBABILITY
            while (rank := self._rank_to_employ(batches)) is not None:
                batch = self._next_batch(size, least)
                if not batch:
                    return
                self.in_flight.assign(rank, batch, now)
                yield rank, self._tasks(batch)

    def _rank_to_employ(self, batches: int) -> int | None:
        """Return the next rank with exactly `batches` batches; None if rank 0 is full by others."""
        if not batches and self.in_flight.working >= self._employed:
            return None
        return self.in_flight.next_rank(batches)

    def cancellations(self) -> list[tuple[int, NDArray[np.int64]]]:
        """Return ranks and the strings, (n,), whose samples in flight there are unnecessary.

        Those that would be done before a message arrives are left alone. Each string is returned
        once.
        """
        self._follow_generation()
        if self._demand.open_count < len(self._open):  # a race has dropped some
            for string in [i for i in self._open if self._demand.progress(i) is None]:
                self._forget(string)
        cancelled: dict[int, list[int]] = {}
        for string in self._complete:
            for rank, samples in self.in_flight.close(string):
                if samples * self.batch_sizer.mean_seconds > self.batch_sizer.round_trip:
                    cancelled.setdefault(rank, []).append(string)
        self._complete.clear()
        return [(rank, np.array(strings)) for rank, strings in cancelled.items()]

    def cancel_all(self) -> None:
        """Let the next `cancellations` be of all strings: everything is decided."""
        self._complete.extend(self._next)

    def returned(self, rank: int, part: ReturnedPart) -> list[slice]:
        """Take the next samples of a rank off those in flight.

        Returns
        -------
        list
            The places of those in the part that no rank has returned before.
        """
        removed = self.in_flight.remove(rank, part)
        if not self.duplicates:
            return [slice(0, part.size)] if part.size else []
        return runs(self.duplicates.first_returns(removed, part.size))

    def update(self, string: int) -> None:
        """Take into account that the campaign has been given samples of a string."""
        if string in self._next:
            self._prioritise(string)

    def mark_silent(self, now: float, timeout: float) -> list[int]:
        """Mark and return ranks that have work and were not heard for `timeout` s; reassign it."""
        marked = self.in_flight.mark_silent(now - timeout)
        for rank in marked:
            for part in self.in_flight.ranges(rank):
                self.duplicates.add(part, needed=part.string in self._next)
                self.update(part.string)
        return marked

    def _forget(self, string: int) -> None:
        """Learn from a complete string, and forget it."""
        self.sample_counts.learn(self._demand.samples_used(string))
        self._complete.append(string)
        self._open.discard(string)
        self._next.pop(string, None)
        self._learnt.pop(string, None)
        self._known.pop(string, None)
        self.duplicates.drop(string)
        self._urgent.remove(string)
        self._speculative.remove(string)

    def _follow_generation(self) -> None:
        """Begin with the strings of a new generation."""
        if self._demand.generation == self._generation:
            return
        self._generation = self._demand.generation
        self._open = set(self._demand.open_strings)
        for string in [string for string in self._next if self._demand.progress(string) is None]:
            self._forget(string)
        for string in sorted(self._open):
            self._next.setdefault(string, 0)
        # New queues: entries that are out of date would sink to the bottom and stay there.
        self._urgent, self._speculative = PriorityQueue(), PriorityQueue()
        for string in list(self._next):
            self._prioritise(string)

    def _prioritise(self, string: int, progress: StringProgress | None = None) -> None:
        """Put a string, whose progress may be known, into its queue, or forget it if complete."""
        if progress is None:
            progress = self._demand.progress(string)
        if progress is None:
            self._forget(string)
            return
        queue = self._urgent if string in self._open else self._speculative
        repeated = self.duplicates.first(string) if self.duplicates else None
        sample = self._skip_known(string, progress.next_sample) if repeated is None else repeated
        if sample >= progress.max_samples:
            queue.remove(string)
            return
        self._most_used = max(self._most_used, progress.next_sample)
        self._learnt[string] = self.sample_counts.strings
        queue.put(string, self._probability(string, progress, sample))

    def _probability(self, string: int, progress: StringProgress, sample: int) -> float:
        """Return the probability that a sample is needed; it is 1 of the next one alone."""
        return self.sample_counts.probability(progress.next_sample, sample)

    def _skip_known(self, string: int, used: int) -> int:
        """Return the next sample to assign of a string, and keep it."""
        sample, known = max(self._next[string], used), self._known.get(string, ())
        while sample in known:
            sample += 1
        self._next[string] = sample
        return sample

    def _next_batch(self, room: int, least: float) -> list[SampleRange]:
        """Take at most `room` samples, none less likely to be needed than `least`."""
        batch: list[SampleRange] = []
        while room > 0:
            part = self._take_best(room, least)
            if part is None:
                break
            batch.append(part)
            room -= part.size if part.means is None else self._expected(part)
        return batch

    def _take_best(self, limit: int, least: float) -> SampleRange | None:
        """Take at most `limit` samples of the string with the highest priority."""
        string = self._best_string(least)
        if string is None:
            return None
        progress = self._demand.progress(string)
        assert progress is not None
        if self.duplicates and self.duplicates.first(string) is not None:
            part = self.duplicates.take(string, limit)
        else:
            part = self._next_range(string, progress, limit)
        self._next[string] = max(self._next[string], part.first + part.size)
        self._prioritise(string, progress)
        return part

    def _best_string(self, least: float) -> int | None:
        """Return the string with the highest priority whose probability is at least `least`."""
        probability, string = self._first(self._urgent)
        urgent = self._urgency * probability if probability >= least else 0.0
        if urgent >= 1.0:
            return string
        speculative, coming = self._first(self._speculative)
        while speculative < 1.0 and (strings := self._propose_ahead(GENERATIONS_AHEAD)):
            for proposed in strings:
                self._next[proposed] = 0
                self.update(proposed)
            speculative, coming = self._first(self._speculative)
        if max(urgent, speculative) < least:
            return None
        return string if urgent >= speculative else coming

    def _first(self, queue: PriorityQueue) -> tuple[float, int]:
        """Return the highest probability of a queue, 0 if it is empty, and its string."""
        while first := queue.first():
            # Probabilities grow with what is learnt, up to 1.
            if first[0] == 1.0 or self._learnt[first[1]] == self.sample_counts.strings:
                return first
            self._prioritise(first[1])
        return 0.0, -1

    def _next_range(self, string: int, progress: StringProgress, limit: int) -> SampleRange:
        """Return samples of a string that nobody has: at most `limit`, unless they are judged."""
        first, used = self._next[string], progress.next_sample
        means = self._demand.judged_from(string) if first == used else None
        if means is not None:
            limit = int(min(MOST_JUDGED, max(limit, self._judged)))
        count = min(limit, progress.max_samples - first)
        if string in self._open:
            count = min(count, self._range_limit(used))
        known = self._known.get(string)
        if known:
            count = next((n for n in range(1, count) if first + n in known), count)
        if means is None:
            count = self.sample_counts.likely_range(used, first, count, self._range_loss)
        return SampleRange(string, first, count, means)

    def _expected(self, part: SampleRange) -> int:
        """Return how many samples of a judged range are expected to be needed."""
        return max(1, min(part.size, int(self.sample_counts.mean) - part.first))

    def _range_limit(self, used: int) -> int:
        """Return the most samples of an open string for one rank, so that all ranks can help.

        Where rank 0 would be saturated, fewer ranks help, with more samples each.
        """
        strings_per_rank = len(self._open) / (2 * self._employed)
        if strings_per_rank >= 1.0:
            return MOST_SAMPLES
        need = max(self.sample_counts.mean, used + 1.0)
        return max(1, int(max(need * strings_per_rank, self._least)))

    def _batch_size(self) -> int:
        """Return the samples of a message: worth one, and no more than are surely needed."""
        waiting = self._waiting
        ranks = self._employed
        return self.batch_sizer.batch_size(TAIL_SHARE * waiting / ranks, ranks, waiting)

    @property
    def _waiting(self) -> float:
        """Number of samples that known strings are expected to need."""
        return len(self._next) * max(self.sample_counts.mean, self._most_used)

    def _tasks(self, batch: list[SampleRange]) -> NDArray[np.void]:
        tasks = new_tasks([self._demand.parameters(part.string) for part in batch])
        tasks["string"], tasks["first"], tasks["count"], means = zip(*batch, strict=True)
        for task, before in zip(tasks, means, strict=True):
            if before is not None:
                task["judged"], task["means"] = True, before
        return tasks
