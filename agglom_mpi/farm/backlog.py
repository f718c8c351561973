"""Records that wait until the samples that they rest on are in the campaign file."""

from collections import Counter, deque
from collections.abc import Callable


class Backlog:
    """Keeps the order of writing where ranks write their samples themselves.

    A judgement is made as soon as the samples are known, and stored when the ranks that simulated
    them say that they have written them. Nothing waits for an answer.
    """

    def __init__(self) -> None:
        self._delivered: Counter[int] = Counter()
        self._written: Counter[int] = Counter()
        self._entries: deque[tuple[dict[int, int], Callable[[], None]]] = deque()

    def delivered(self, rank: int, count: int) -> None:
        """Take note of samples that a rank writes itself."""
        self._delivered[rank] += count

    def written(self, rank: int, count: int) -> None:
        """Take note that so many more samples of a rank are in the file, and store what can be."""
        self._written[rank] += count
        self._catch_up()

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
