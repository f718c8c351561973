"""Records that wait until the samples that they rest on are in the campaign file."""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


class WriteOrderBarrier:
    """Keep the order of writing where ranks write their samples themselves.

    A decision is made as soon as its samples are known, and stored when the ranks that simulated
    them have reported that they are written. Nothing waits for an answer.
    """

    def __init__(self) -> None:
        self._delivered: Counter[int] = Counter()
        self._written: Counter[int] = Counter()
        self._taken_over: Counter[int] = Counter()
        self._rows: dict[int, deque[NDArray[np.void]]] = {}
        self._kept: Counter[int] = Counter()  # samples in them
        self._entries: deque[tuple[dict[int, int], Callable[[], None]]] = deque()

    def delivered(self, rank: int, rows: NDArray[np.void]) -> None:
        """Add samples, rows of `/samples`, (n,), that a rank writes itself."""
        self._delivered[rank] += len(rows)
        self._rows.setdefault(rank, deque()).append(rows)
        self._kept[rank] += len(rows)
        self._forget_written(rank)

    def written(self, rank: int, count: int) -> None:
        """Count `count` more samples of a rank as written, and store what waited for them."""
        late = min(count, self._taken_over[rank])
        self._taken_over[rank] -= late
        self._written[rank] += count - late
        self._forget_written(rank)
        self._store_ready()

    def take_over(self, rank: int) -> list[NDArray[np.void]]:
        """Return samples that a rank has delivered and perhaps not written; wait no longer for it.

        The caller writes them, and then calls `taken_over`.
        """
        rows = list(self._rows.pop(rank, ()))
        self._kept[rank] = 0
        waiting = max(0, self._delivered[rank] - self._written[rank])
        self._taken_over[rank] += waiting
        self._written[rank] += waiting
        return rows

    def taken_over(self) -> None:
        """Store what can be stored after `take_over`."""
        self._store_ready()

    def store(self, action: Callable[[], None]) -> None:
        """Call `action` after all samples delivered so far are written, and all earlier actions."""
        needed = {
            rank: count for rank, count in self._delivered.items() if self._written[rank] < count
        }
        self._entries.append((needed, action))
        self._store_ready()

    def finish(self) -> None:
        """Call all actions that wait: every rank has written what it had."""
        while self._entries:
            self._entries.popleft()[1]()

    def _forget_written(self, rank: int) -> None:
        rows = self._rows.get(rank, deque())
        missing = self._delivered[rank] - self._written[rank]
        while rows and self._kept[rank] - len(rows[0]) >= missing:
            self._kept[rank] -= len(rows.popleft())

    def _store_ready(self) -> None:
        while self._entries:
            needed, action = self._entries[0]
            if any(self._written[rank] < count for rank, count in needed.items()):
                return
            self._entries.popleft()
            action()
