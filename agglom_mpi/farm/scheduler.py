"""Who simulates what next: a pure state machine, without MPI, files or a clock."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.messages import MOST_TASKS, TASK

MESSAGES_IN_FLIGHT: Final = 2
"""Batches a rank holds: one that it works on and one that it finds when it is done."""

BATCH_SECONDS: Final = 0.005
"""Work in one message, so that a message of some 50 µs costs about 1 %."""


class LiveString(Protocol):
    """How far the ensemble of a string is."""

    @property
    def next_sample(self) -> int:
        """Samples judged so far."""

    @property
    def max_samples(self) -> int:
        """Most samples."""


class Needs(Protocol):
    """What the scheduler asks of a campaign; `search.inversion.Inversion` answers it."""

    @property
    def live(self) -> Mapping[int, LiveString]:
        """Strings that are not judged yet."""

    def parameters(self, string: int) -> NDArray[np.float64]:
        """Return a proposed string, shape (10,)."""


class Lane(NamedTuple):
    """A rank as the scheduler sees it: the batches it holds, oldest first."""

    batches: list[set[tuple[int, int]]]


class Scheduler:
    """Hand out samples of the strings that are not judged yet.

    A string gets its samples in order. The string whose judgement is least far behind what was
    handed out comes first, so that ranks run ahead only when there is nothing more urgent.

    Parameters
    ----------
    needs
        The campaign's decisions.
    ranks
        Number of ranks.
    known
        (string, sample) pairs that need no simulation, from an earlier leg.
    """

    def __init__(self, needs: Needs, ranks: int, known: Iterable[tuple[int, int]] = ()) -> None:
        self._needs = needs
        self._lanes = [Lane([]) for _ in range(ranks)]
        self._handed_out: dict[int, int] = {}
        self._known: dict[int, set[int]] = {}
        self._mean_seconds = 0.0
        for string, sample in known:
            self._known.setdefault(string, set()).add(sample)

    @property
    def in_flight(self) -> int:
        """Samples handed out whose results are not back."""
        return sum(len(batch) for lane in self._lanes for batch in lane.batches)

    def assign(self, rank: int) -> NDArray[np.void]:
        """Tasks for a rank, an array of `TASK`; empty if it holds enough or nothing is needed."""
        lane = self._lanes[rank]
        if len(lane.batches) >= MESSAGES_IN_FLIGHT:
            return np.zeros(0, TASK)
        pairs = self._choose(self._batch_size())
        tasks = np.zeros(len(pairs), TASK)
        for task, (string, sample) in zip(tasks, pairs, strict=True):
            task["string"], task["sample"] = string, sample
            task["parameters"] = self._needs.parameters(string)
        if pairs:
            lane.batches.append(set(pairs))
        return tasks

    def returned(self, rank: int, string: int, sample: int, seconds: float) -> None:
        """Take note that a rank is done with a sample, which took it `seconds`."""
        weight = 0.05 if self._mean_seconds else 1.0
        self._mean_seconds += weight * (seconds - self._mean_seconds)
        for batch in self._lanes[rank].batches:
            batch.discard((string, sample))
        self._lanes[rank].batches[:] = [batch for batch in self._lanes[rank].batches if batch]

    def _batch_size(self) -> int:
        if not self._mean_seconds:
            return 1
        return int(min(MOST_TASKS, max(1.0, BATCH_SECONDS / self._mean_seconds)))

    def _choose(self, count: int) -> list[tuple[int, int]]:
        live = self._needs.live
        self._handed_out = {string: self._handed_out.get(string, 0) for string in live}
        ahead = {string: self._next(string) - live[string].next_sample for string in live}
        chosen: list[tuple[int, int]] = []
        while ahead and len(chosen) < count:
            string = min(ahead, key=lambda name: (ahead[name], name))
            # Consecutive samples: rows that lie together are written together.
            while len(chosen) < count and self._next(string) < live[string].max_samples:
                chosen.append((string, self._next(string)))
                self._handed_out[string] += 1
            del ahead[string]
        return chosen

    def _next(self, string: int) -> int:
        """First sample of a string that is neither handed out nor known."""
        sample = self._handed_out[string]
        known = self._known.get(string, ())
        while sample in known:
            sample += 1
        self._handed_out[string] = sample
        return sample
