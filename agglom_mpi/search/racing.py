"""Racing: no more samples for a string that will surely not be among the kept parents.

Strings race in rounds (Maron and Moore 1994). When every string of a generation that needs samples
has r of them, the intervals of all strings are compared, and those that are out are judged by what
they have; then r is doubled. Rounds, not arrivals, decide: the ranks play no part.
"""

import math
from typing import Final, NamedTuple

from agglom_mpi.search.student import t_quantile

FEWEST: Final = 2
"""Samples that an interval needs."""


class Standing(NamedTuple):
    """What is known of a string: its objective, the standard error, and samples they rest on."""

    objective: float
    standard_error: float
    samples: int


class Racing(NamedTuple):
    """Rules of the race.

    Attributes
    ----------
    kept
        Strings that the search keeps, K.
    confidence
        Least probability that a string which belongs among the best K is not dropped.
    first
        Samples of each string before the first round.
    """

    kept: int
    confidence: float
    first: int

    def samples(self, race: int) -> int:
        """Return the number of samples that round `race`, from 0, is held at."""
        return self.first << race

    def dropped(self, race: int, running: dict[int, Standing], others: list[Standing]) -> list[int]:
        """Return those running strings that are out.

        One is out if its objective lies above that of K others, whatever of their intervals is
        true. If all intervals hold, none that belongs among the best K is dropped. Its own and
        those K intervals all hold with the wanted confidence, over all rounds, if each fails with a
        probability of (1 - confidence) / 2^(round + 1) / (K + 1) at most (Bonferroni).

        Parameters
        ----------
        race
            Number of the round, from 0.
        running
            Strings that still get samples, by number.
        others
            Parents, and strings of this generation that have enough.
        """
        risk = (1.0 - self.confidence) / 2.0 ** (race + 1) / (self.kept + 1)
        coverage = 1.0 - 2.0 * risk
        ends = {string: _interval(standing, coverage) for string, standing in running.items()}
        uppers = [_interval(standing, coverage)[1] for standing in others]
        uppers = sorted(uppers + [upper for _, upper in ends.values()])
        if len(uppers) <= self.kept:
            return []
        # A string's own upper end is never below its lower one, so it need not be left out.
        threshold = uppers[self.kept - 1]
        return [string for string, (lower, _) in ends.items() if lower > threshold]


def _interval(standing: Standing, coverage: float) -> tuple[float, float]:
    """Confidence interval of an objective; all numbers where nothing is known of its error."""
    if standing.samples < FEWEST or not math.isfinite(standing.standard_error):
        return -math.inf, math.inf
    half = t_quantile(standing.samples - 1, coverage) * standing.standard_error
    return standing.objective - half, standing.objective + half
