"""Samples that take so much longer than others that they may never end."""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.messages import storable
from agglom_mpi.runtime.under_way import SampleUnderWay
from agglom_mpi.scheduling.volume_strings import volume_string

FACTOR: Final = 20.0
"""Time of a sample relative to the longest one so far after which it is reported."""

MIN_SECONDS: Final = 10.0
"""Minimum time, s, after which a sample is reported."""

FIRST_SECONDS: Final = 300.0
"""Time, s, after which a sample is reported while the file has none to compare it with."""


class HangingSamples:
    """Report samples that take `FACTOR` times as long as the longest one, and again at twice that.

    Parameters
    ----------
    longest
        Time of the longest sample in the file, s; 0 if it has none.
    max_seconds
        Time after which a sample is ended, s; None without a limit.
    name_rank
        Returns the name of a rank and its host.
    show
        Shows one line.
    """

    def __init__(
        self,
        longest: float,
        max_seconds: float | None,
        name_rank: Callable[[int], str],
        show: Callable[[str], None],
    ) -> None:
        self._longest = longest
        self._max_seconds = max_seconds
        self._name_rank = name_rank
        self._show = show
        self._reported: dict[int, tuple[tuple[int, int], int]] = {}  # sample, how often; by rank

    def learn(self, rows: NDArray[np.void]) -> None:
        """Learn the times of samples, rows of `/samples`, (n,)."""
        if len(rows) and rows["seconds"].max() > self._longest:
            finished = storable(rows)  # not one that was ended early
            self._longest = max(self._longest, float(finished["seconds"].max(initial=0.0)))

    def check(self, rank: int, sample: SampleUnderWay) -> None:
        """Report the sample that a rank simulates if it has taken too long."""
        key = sample.string, sample.sample
        before, times = self._reported.get(rank, (key, 0))
        times = times if before == key else 0
        limit = max(MIN_SECONDS, FACTOR * self._longest) if self._longest else FIRST_SECONDS
        if sample.seconds <= limit * 2**times:
            return
        while sample.seconds > limit * 2**times:
            times += 1
        self._reported[rank] = key, times
        self._show(
            f"{self._name_rank(rank)}: string {volume_string(sample.string).text} sample "
            f"{sample.sample} has been under way for {sample.seconds:.0f} s, {self._comparison}; "
            f"{self._remedy(sample)}"
        )

    @property
    def _comparison(self) -> str:
        if not self._longest:
            return "and no sample is finished yet"
        return f"and the longest sample so far took {self._longest:.2g} s"

    def _remedy(self, sample: SampleUnderWay) -> str:
        most = self._max_seconds
        if most is None or sample.seconds < most:
            return (
                "stopping.max_seconds ends samples that take too long, unless they are in a "
                "function of your own"
            )
        return (
            f"stopping.max_seconds, {most:g} s, does not end it: it is in a function that does not "
            "return"
        )
