"""Tasks that are known beforehand: who does which."""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.scheduling.estimators import BatchSizer
from agglom_mpi.scheduling.in_flight import MESSAGES_IN_FLIGHT, InFlightTable, SampleRange
from agglom_mpi.scheduling.interface import TASK

Key = tuple[int, int]
"""String and number of a sample."""

SHARE: Final = 2 * MESSAGES_IN_FLIGHT
"""One batch is at most this part of what waits for each rank, so that all end together."""


class StaticScheduler:
    """Hand out given samples to ranks; those of a rank that fell silent to others, too.

    They are handed out in order, one by one until it is known what they take, and then as many
    together as are worth a message.

    Parameters
    ----------
    tasks
        (n,) of `TASK`; of one string all have the same frames and parameters.
    ranks
        Number of ranks.

    Attributes
    ----------
    pace
        How long samples take, and messages.
    """

    def __init__(self, tasks: NDArray[np.void], ranks: int) -> None:
        self._held = InFlightTable(ranks)
        self._ranks = ranks
        self.pace = BatchSizer()
        self._of_string = {int(task["string"]): task for task in tasks}
        self._waiting = deque(
            (int(task["string"]), sample)
            for task in tasks
            for sample in range(task["first"], task["first"] + task["count"])
        )
        self._open = set(self._waiting)

    @property
    def in_flight(self) -> int:
        """Samples that ranks hold."""
        return self._held.samples

    def assignments(self, now: float) -> Iterator[tuple[int, NDArray[np.void]]]:
        """Ranks and what to send them, arrays of `TASK`, at the time `now` in s."""
        size = self.pace.batch(len(self._waiting) / (SHARE * self._ranks))
        for batches in range(self.pace.in_flight(size)):
            while self._waiting and (rank := self._held.next_with(batches)) is not None:
                if not (pieces := self._choose(size)):
                    return
                self._held.give(rank, pieces, now)
                yield rank, self._tasks(pieces)

    def _choose(self, size: int) -> list[SampleRange]:
        """Pieces of so many samples that wait and that nobody has done meanwhile."""
        pieces: list[SampleRange] = []
        while self._waiting and size:
            string, sample = key = self._waiting.popleft()
            if key not in self._open:
                continue
            size -= 1
            if pieces and key == (pieces[-1].string, pieces[-1].first + pieces[-1].size):
                pieces[-1] = pieces[-1]._replace(size=pieces[-1].size + 1)
            else:
                pieces.append(SampleRange(string, sample, 1))
        return pieces

    def _tasks(self, pieces: list[SampleRange]) -> NDArray[np.void]:
        tasks = np.zeros(len(pieces), TASK)
        for i, piece in enumerate(pieces):
            tasks[i] = self._of_string[piece.string]
            tasks[i]["first"], tasks[i]["count"] = piece.first, piece.size
        return tasks

    def returned(
        self, rank: int, done: Sequence[bool]
    ) -> list[tuple[SampleRange, NDArray[np.bool_]]]:
        """Take the next samples that a rank was to do; none of them is left out.

        Returns
        -------
        list
            What they are, and which of each piece nobody had returned before, shape (size,).
        """
        return [(piece, self._first(piece)) for piece in self._held.returned(rank, len(done))]

    def _first(self, piece: SampleRange) -> NDArray[np.bool_]:
        keys = [(piece.string, piece.first + place) for place in range(piece.size)]
        first = np.array([key in self._open for key in keys])
        self._open.difference_update(keys)
        return first

    def done(self, rank: int) -> None:
        """Take note that a rank is done with the first sample that it holds."""
        self.returned(rank, [True])

    def heard(self, rank: int, now: float) -> bool:
        """Take a sign of life of a rank; whether it had fallen silent."""
        return self._held.heard(rank, now)

    def clock(self, now: float, patience: float) -> list[int]:
        """Ranks that have work and were not heard for so many seconds; others do it, too."""
        fallen = self._held.fall_silent(now - patience)
        lost = [
            (piece.string, piece.first + place)
            for rank in fallen
            for piece in self._held.held(rank)
            for place in range(piece.size)
        ]
        self._waiting.extendleft(reversed(lost))
        return fallen
