"""Races, which end the sampling of strings that will not be kept.

Strings race in rounds (Maron and Moore 1994). When every string of a generation that needs samples
has r of them, the intervals of all strings are compared, and those that are out are evaluated by
the samples that they have; then r is doubled. Rounds, not arrivals, decide: the ranks play no part.
"""

import math
from typing import Annotated, Final

from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import Declared
from agglom_mpi.statistics import MeanEstimate, t_quantile

MIN_INTERVAL_SAMPLES: Final = 2
"""Minimum number of samples for an interval."""


class Racing(Declared):
    """Stop sampling strings that will not be among the kept parents, by a race.

    Attributes
    ----------
    confidence
        Minimum probability that a race keeps a string that belongs among the parents.
    first
        Number of samples of each string before the first round.
    """

    confidence: Annotated[float, In("1", above=0.5, below=1, meaning="like 0.95")] = 0.95
    first: Annotated[int, Whole(at_least=2, at_most=10**4)] = 5

    def samples(self, round_number: int) -> int:
        """Return the samples that each string has when a round, counted from 0, is held."""
        return self.first << round_number

    def dropped(
        self,
        kept: int,
        round_number: int,
        running: dict[int, MeanEstimate],
        others: list[MeanEstimate],
    ) -> list[int]:
        """Return the running strings that are out, in the order of `running`.

        A string is out if its objective lies above that of K others, wherever in their intervals
        the true objectives are. If all intervals hold, none that belongs among the best K is
        dropped. Its own and those K intervals all hold with the wanted confidence, over all rounds,
        if each fails with a probability of (1 - confidence) / 2^(round + 1) / (K + 1) at most
        (Bonferroni).

        Parameters
        ----------
        kept
            Number of strings that the search keeps, K.
        round_number
            Counted from 0.
        running
            Objectives so far of strings that still get samples, by number.
        others
            Parents, and strings of this generation that have enough.
        """
        risk = (1.0 - self.confidence) / 2.0 ** (round_number + 1) / (kept + 1)
        coverage = 1.0 - 2.0 * risk
        ends = {string: _interval(entry, coverage) for string, entry in running.items()}
        uppers = [_interval(entry, coverage)[1] for entry in others]
        uppers = sorted(uppers + [upper for _, upper in ends.values()])
        if len(uppers) <= kept:
            return []
        # A string's own upper end is never below its lower one, so it need not be left out.
        threshold = uppers[kept - 1]
        return [string for string, (lower, _) in ends.items() if lower > threshold]


def _interval(entry: MeanEstimate, coverage: float) -> tuple[float, float]:
    """Return the t interval of an objective; (-inf, inf) where its error is not known."""
    if entry.samples < MIN_INTERVAL_SAMPLES or not math.isfinite(entry.error):
        return -math.inf, math.inf
    half = t_quantile(entry.samples - 1, coverage) * entry.error
    return entry.value - half, entry.value + half
