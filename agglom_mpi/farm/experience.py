"""What the strings judged so far say about those that are not: how many samples they may need."""

from bisect import bisect_right, insort


class Experience:
    """Samples that strings turned out to need, of which each was one string's worth.

    With no experience a string is as likely to need twice the samples that it has had as not to;
    that guess goes on counting as much as one string.
    """

    def __init__(self) -> None:
        self._used: list[int] = []
        self._sum = 0

    def learn(self, used: int) -> None:
        """Take note of a string that needed so many samples."""
        insort(self._used, used)
        self._sum += used

    @property
    def mean(self) -> float:
        """Mean number of samples that a string needed; nought with no experience."""
        return self._sum / len(self._used) if self._used else 0.0

    def chance(self, judged: int, sample: int) -> float:
        """Probability that a sample is needed, given that those before `judged` were not enough.

        Parameters
        ----------
        judged
            Samples judged so far.
        sample
            Number of the sample in question, at least `judged`.
        """
        guess = (judged + 1) / (sample + 1)
        return (self._more_than(sample) + guess) / (self._more_than(judged) + 1)

    def _more_than(self, samples: int) -> int:
        return len(self._used) - bisect_right(self._used, samples)
