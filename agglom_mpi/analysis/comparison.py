"""Comparison of strings and of files: paired and Welch tests with Holm."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from itertools import combinations
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import Estimate, objective_of
from agglom_mpi.outcome import COMPLETED, summaries
from agglom_mpi.search.objectives import Objective
from agglom_mpi.statistics import MeanEstimate, mean_of, t_tails
from agglom_mpi.storage.reader import CampaignData


class SampleValues(NamedTuple):
    """Completed samples of a string.

    Attributes
    ----------
    numbers : array of int64, shape (n,), ascending
    values : array, shape (n,)
        What each adds to the objective, which is their mean (delta method).
    """

    numbers: NDArray[np.int64]
    values: NDArray[np.float64]


class PairedSamples:
    """Samples by string; those with the same number start from the same random numbers.

    Parameters
    ----------
    samples
        Of each string.
    """

    def __init__(self, samples: Mapping[int, SampleValues]) -> None:
        self._samples = samples

    @classmethod
    def of_file(
        cls, file: CampaignData, rows: NDArray[np.void], estimates: Iterable[Estimate]
    ) -> Self | None:
        """Take the fresh samples behind estimates from all rows of a file's `/samples`.

        None if its strings have configurations of their own.
        """
        if not file.identity.get("ensemble.common_configurations", False):
            return None
        fresh = rows[(rows["sample"] >= file.fresh_from) & (rows["state"] == COMPLETED)]
        law = objective_of(file)
        strings = [estimate.string for estimate in estimates if estimate.known]
        return cls({i: numbered(law, fresh[fresh["string"] == i]) for i in strings})

    def difference(self, one: int, other: int) -> MeanEstimate:
        """Objective of one string minus that of another, over the samples that both have."""
        numbers = self._shared([one, other])
        return mean_of(self._values(one, numbers) - self._values(other, numbers))

    def average(self) -> MeanEstimate:
        """Objective of all strings on average, over the samples that all have."""
        strings = list(self._samples)
        numbers = self._shared(strings)
        return mean_of(np.mean([self._values(string, numbers) for string in strings], axis=0))

    def _shared(self, strings: list[int]) -> NDArray[np.int64]:
        return reduce(np.intersect1d, (self._samples[string].numbers for string in strings))

    def _values(self, string: int, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        sampled = self._samples[string]
        return sampled.values[np.searchsorted(sampled.numbers, numbers)]


def numbered(law: Objective, rows: NDArray[np.void]) -> SampleValues:
    """Take completed rows of `/samples` of one string, by number, as an objective sees them.

    Of a magnitude the sign is that of the mean, so that the mean of the values is the objective.
    """
    values = law.influence_values(list(summaries(rows)))
    return SampleValues(rows["sample"].astype(np.int64), math.copysign(1.0, values.mean()) * values)


LEVEL: Final = 0.05
"""Chance that any of several equal means is said to differ from another."""


def significant_differences(
    means: Sequence[MeanEstimate], differences: Mapping[tuple[int, int], MeanEstimate] | None = None
) -> set[tuple[int, int]]:
    """Pairs of places, the lower first, of means that differ at 95 %.

    All pairs count in the correction (Holm 1979), so that it holds for comparisons with the best
    one, too, though the data say which one that is.

    Parameters
    ----------
    means
        Of samples that are independent of those of the others, unless there are `differences`.
    differences
        Of each pair of means, over samples that are paired.
    """
    pairs = list(combinations(range(len(means)), 2))
    if differences is None:
        chances = {(i, j): p_value(means[i], means[j]) for i, j in pairs}
    else:
        chances = {pair: paired_p_value(differences[pair]) for pair in pairs}
    tested = sorted((chance, pair) for pair, chance in chances.items())
    found: set[tuple[int, int]] = set()
    for left, (chance, pair) in zip(range(len(tested), 0, -1), tested, strict=True):
        if chance > LEVEL / left:
            break
        found.add(pair)
    return found


def p_value(one: MeanEstimate, other: MeanEstimate) -> float:
    """Two-sided chance of such a difference of equal means (Welch 1947)."""
    variances = one.error**2, other.error**2
    total = sum(variances)
    difference = abs(one.value - other.value)
    if total == 0.0:
        return 1.0 if difference == 0.0 else 0.0
    shares = (variances[0] / total) ** 2, (variances[1] / total) ** 2
    freedom = 1.0 / (shares[0] / (one.samples - 1) + shares[1] / (other.samples - 1))
    return t_tails(difference / math.sqrt(total), freedom)


def paired_p_value(difference: MeanEstimate) -> float:
    """Two-sided chance of such a mean difference of pairs of samples if there is none.

    It is right however the samples of a pair depend on each other; less than two tell nothing.
    """
    value, error, samples = difference
    if samples < 2:
        return 1.0
    if error == 0.0:
        return 1.0 if value == 0.0 else 0.0
    return t_tails(value / error, samples - 1.0)
