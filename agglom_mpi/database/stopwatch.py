"""Time spent on a campaign file."""

import time
from typing import Self


class Stopwatch:
    """Sums up wall-clock time inside `with` blocks, which may be nested.

    Attributes
    ----------
    seconds
        Time so far, s.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0
        self._begun = 0.0

    def __enter__(self) -> Self:
        if not self._depth:
            self._begun = time.perf_counter()
        self._depth += 1
        return self

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        if not self._depth:
            self.seconds += time.perf_counter() - self._begun
