"""How long samples take, and how many of them are worth a message."""

from collections.abc import Sequence
from typing import Final

from agglom_mpi.farm.messages import MOST_SAMPLES

BATCH_SECONDS: Final = 0.01
"""Work in one message, so that a message of some 50 µs costs less than 1 %."""

QUEUE_SECONDS: Final = (1.0, 0.05)
"""A rank may hold a second and a third batch if batches are shorter than these."""


class Pace:
    """Time of samples, as it was measured lately.

    Attributes
    ----------
    mean_seconds
        Of a sample; 0 while it is not known.
    """

    def __init__(self) -> None:
        self.mean_seconds = 0.0

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
        """Batches of so many samples for each rank: short ones must last until the next come.

        Long ones would tie it down.
        """
        return 1 + sum(batch * self.mean_seconds < limit for limit in QUEUE_SECONDS)
