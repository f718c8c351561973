"""Records that wait until the samples that they rest on are in the campaign file."""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


class WriteOrderBarrier:
    """Keeps the order of writing where ranks write their samples themselves.

    A judgement is made as soon as the samples are known, and stored when the ranks that simulated
    them say that they have written them. Nothing waits for an answer.
    """

    def __init__(self) -> None:
        self._delivered: Counter[int] = Counter()
        self._written: Counter[int] = Counter()
        self._taken_over: Counter[int] = Counter()
        self._rows: dict[int, deque[NDArray[np.void]]] = {}
        self._kept: Counter[int] = Counter()  # samples in them
        self._entries: deque[tuple[dict[int, int], Callable[[], None]]] = deque()

    def delivered(self, rank: int, rows: NDArray[np.void]) -> None:
        """Take note of samples, (n,), that a rank writes itself."""
        self._delivered[rank] += len(rows)
        self._rows.setdefault(rank, deque()).append(rows)
        self._kept[rank] += len(rows)
        self._forget_written(rank)

    def written(self, rank: int, count: int) -> None:
        """Take note that so many more samples of a rank are in the file, and store what can be."""
        late = min(count, self._taken_over[rank])
        self._taken_over[rank] -= late
        self._written[rank] += count - late
        self._forget_written(rank)
        self._catch_up()

    def take_over(self, rank: int) -> list[NDArray[np.void]]:
        """Return samples that a rank has delivered and perhaps not written; wait no longer for it.

        Whoever calls this writes them, and then calls `taken_over`.
        """
        rows = list(self._rows.pop(rank, ()))
        self._kept[rank] = 0
        waiting = max(0, self._delivered[rank] - self._written[rank])
        self._taken_over[rank] += waiting
        self._written[rank] += waiting
        return rows

    def taken_over(self) -> None:
        """Store what can be stored after `take_over`."""
        self._catch_up()

    def _forget_written(self, rank: int) -> None:
        rows = self._rows.get(rank, deque())
        missing = self._delivered[rank] - self._written[rank]
        while rows and self._kept[rank] - len(rows[0]) >= missing:
            self._kept[rank] -= len(rows.popleft())

    def store(self, action: Callable[[], None]) -> None:
        """Store something after all samples delivered so far, and after what waits already."""
        needed = {
            rank: count for rank, count in self._delivered.items() if self._written[rank] < count
        }
        self._entries.append((needed, action))
        self._catch_up()

    def finish(self) -> None:
        """Store all that waits: every rank has written what it had."""
        while self._entries:
            self._entries.popleft()[1]()

    def _catch_up(self) -> None:
        while self._entries:
            needed, action = self._entries[0]
            if any(self._written[rank] < count for rank, count in needed.items()):
                return
            self._entries.popleft()
            action()
