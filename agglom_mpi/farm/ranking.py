"""Strings in the order of how likely their next samples are to be needed."""

import heapq


class Ranking:
    """Strings by a chance each, the likeliest first, and of those that are as likely the first.

    What is out of date is dropped when it comes to the top.
    """

    def __init__(self) -> None:
        self._heap: list[tuple[float, int]] = []
        self._chance: dict[int, float] = {}

    def put(self, string: int, chance: float) -> None:
        """Give a string its place, or another one."""
        if self._chance.get(string) != chance:
            self._chance[string] = chance
            heapq.heappush(self._heap, (-chance, string))

    def drop(self, string: int) -> None:
        """Forget a string, if it is there."""
        self._chance.pop(string, None)

    def first(self) -> tuple[float, int] | None:
        """Return the likeliest string after its chance; None of none."""
        while self._heap:
            chance, string = -self._heap[0][0], self._heap[0][1]
            if self._chance.get(string) == chance:
                return chance, string
            heapq.heappop(self._heap)
        return None
