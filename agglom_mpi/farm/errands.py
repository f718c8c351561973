"""Tasks that are known beforehand, one for each message: who does which."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.lanes import MESSAGES_IN_FLIGHT, Lanes, Piece


class Errands:
    """Hand out given tasks to ranks; those of a rank that fell silent to others, too.

    Parameters
    ----------
    tasks
        (n,) of `TASK`, each of one sample.
    ranks
        Number of ranks.
    """

    def __init__(self, tasks: NDArray[np.void], ranks: int) -> None:
        self._lanes = Lanes(ranks)
        self._tasks = {
            (int(task["string"]), int(task["first"])): tasks[i : i + 1]
            for i, task in enumerate(tasks)
        }
        self._waiting = list(reversed(self._tasks))

    def assignments(self, now: float) -> Iterator[tuple[int, NDArray[np.void]]]:
        """Ranks and what to send them, arrays of one `TASK`, at the time `now` in s."""
        for batches in range(MESSAGES_IN_FLIGHT):
            while self._waiting and (rank := self._lanes.next_with(batches)) is not None:
                key = self._waiting.pop()
                if key in self._tasks:
                    self._lanes.give(rank, [Piece(*key, 1)], now)
                    yield rank, self._tasks[key]

    def done(self, rank: int) -> None:
        """Take note that a rank is done with the first task that it holds."""
        [piece] = self._lanes.returned(rank, 1)
        self._tasks.pop((piece.string, piece.first), None)

    def heard(self, rank: int, now: float) -> bool:
        """Take a sign of life of a rank; whether it had fallen silent."""
        return self._lanes.heard(rank, now)

    def clock(self, now: float, patience: float) -> list[int]:
        """Ranks that have work and were not heard for so many seconds; others do it, too."""
        fallen = self._lanes.fall_silent(now - patience)
        for rank in fallen:
            self._waiting += [(piece.string, piece.first) for piece in self._lanes.held(rank)]
        return fallen
