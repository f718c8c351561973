"""A rank that is not there: it only takes time."""

from collections import deque
from collections.abc import Collection, Iterator
from typing import NamedTuple


class Sample(NamedTuple):
    """A sample that an imaginary rank holds, and the time that it spends on it, in s."""

    string: int
    seconds: float
    needed: bool = True


class Rank:
    """Batches of an imaginary rank, which does them in the order in which they come.

    Attributes
    ----------
    free
        When the first of them can begin, for all that the rank has done before; s.
    batches
        Each after the time when it comes, in s.
    """

    def __init__(self) -> None:
        self.free = 0.0
        self.batches: deque[tuple[float, list[Sample]]] = deque()

    def put(self, now: float, samples: list[Sample]) -> None:
        """Give the rank a batch."""
        self.batches.append((now, samples))

    @property
    def end(self) -> float:
        """When it is done with its first batch, s."""
        received, samples = self.batches[0]
        return max(self.free, received) + sum(sample.seconds for sample in samples)

    def take(self) -> list[Sample]:
        """Its first batch, which is done."""
        self.free = self.end
        return self.batches.popleft()[1]

    def withdraw(self, now: float, strings: Collection[int]) -> None:
        """Let it do no more of some strings from then on."""
        for samples, place, end in list(self.schedule()):
            sample = samples[place]
            if sample.string in strings and end > now:
                spent = max(0.0, now - (end - sample.seconds))
                samples[place] = sample._replace(seconds=spent, needed=False)

    def schedule(self) -> Iterator[tuple[list[Sample], int, float]]:
        """Batches, places in them, and when the sample there ends, s."""
        end = self.free
        for received, samples in self.batches:
            end = max(end, received)
            for place, sample in enumerate(samples):
                end += sample.seconds
                yield samples, place, end
