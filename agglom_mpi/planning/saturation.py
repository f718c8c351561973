"""The forecast of a run, what bounds it, and advice."""

from typing import Final, NamedTuple

WORK: Final = "work"

CHAIN: Final = "chain"

MASTER: Final = "rank 0"


class Forecast(NamedTuple):
    """How a campaign would go.

    Attributes
    ----------
    ranks : int
    seconds
        From the first sample to the last decision.
    busy
        Share of the ranks' time in which they simulate.
    simulated, used
        Samples finished by the last decision, and those of them that decisions rest on.
    work
        Sum of the time of the samples that are used, s.
    chain
        Generations one after the other, each as long as the longest sample that is used of its
        strings that learn from results, which nobody can begin before those are there; s.
    master
        Share of the time in which rank 0 serves messages.
    again
        Time after that for the fresh samples of the best strings, spread evenly, s.
    """

    ranks: int
    seconds: float
    busy: float
    simulated: int
    used: int
    work: float
    chain: float
    master: float
    again: float = 0.0

    @property
    def bound(self) -> float:
        """Seconds that no scheduler could beat: the work spread evenly, or the chain."""
        return max(self.work / self.ranks, self.chain)

    @property
    def reached(self) -> float:
        """Share of the best possible speed."""
        return self.bound / self.seconds

    @property
    def needed(self) -> float:
        """Share of the ranks' time that goes into samples which decisions rest on."""
        return self.work / (self.seconds * self.ranks)

    @property
    def wasted(self) -> float:
        """Share of the samples that no decision rests on."""
        return 1.0 - self.used / self.simulated

    @property
    def limit(self) -> str:
        """What would take the longest if it were all there is: `WORK`, `CHAIN` or `MASTER`."""
        alone = {
            WORK: self.work / self.ranks,
            CHAIN: self.chain,
            MASTER: self.master * self.seconds,
        }
        return max(alone, key=lambda name: alone[name])
