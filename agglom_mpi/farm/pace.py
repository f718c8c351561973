"""How long samples take, and how many of them are worth a message."""

from collections.abc import Sequence
from typing import Final

from agglom_mpi.farm.messages import MOST_SAMPLES

BATCH_SECONDS: Final = 0.02
"""Work in one message: what serving one costs rank 0, some 100 µs, is less than 1 % of it."""

TURNROUND: Final = 4e-3
"""Time that a rank without work waits for more, s: both sides look for mail every so often."""

RUNG_TURNROUND: Final = 1e-3
"""The same where all ring for each other, s."""

LOSS: Final = 0.004
"""A rank may hold a second batch where a turn-round is more than this part of one."""

QUEUED: Final = 0.6
"""Samples less likely than this to be needed never wait in the queue of a rank that has work."""


class Pace:
    """Time of samples, as it was measured lately.

    Attributes
    ----------
    turnround
        Time that a rank without work waits for more, s.
    mean_seconds
        Of a sample; 0 while it is not known.
    """

    def __init__(self) -> None:
        self.mean_seconds = 0.0
        self.turnround = TURNROUND

    def learn(self, seconds: Sequence[float]) -> None:
        """Take what samples took, s."""
        count = len(seconds)
        if count:
            weight = 1.0 - 0.95**count if self.mean_seconds else 1.0
            self.mean_seconds += weight * (sum(seconds) / count - self.mean_seconds)

    def batch(self, most: float) -> int:
        """Return the samples for a message: no less than pays, no more than `most`, at least 1."""
        if not self.mean_seconds:
            return 1
        return int(max(1.0, min(MOST_SAMPLES, BATCH_SECONDS / self.mean_seconds, most)))

    def in_flight(self, batch: int) -> int:
        """Batches of so many samples for each rank: two, but one of long samples ties it down."""
        return 2 if self.turnround > LOSS * batch * self.mean_seconds else 1

    def queued(self, batch: int) -> float:
        """Return how likely samples must be to be needed to wait behind so many others.

        A rank that waits for better ones loses a turn-round; others may turn out not to be needed
        before it comes to them.
        """
        seconds = batch * self.mean_seconds
        return max(QUEUED, 1.0 - self.turnround / seconds) if seconds else QUEUED
