"""Comparison of strings: paired and Welch tests with Holm's correction."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from itertools import combinations
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import Estimate, objective_at
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.statistics import MeanEstimate, mean_of, t_tails
from agglom_mpi.storage.reader import CampaignData


class SampleValues(NamedTuple):
    """The completed samples of a string.

    Attributes
    ----------
    numbers : array of int64, shape (n,), ascending
    values : array, shape (n,)
        Contribution of each to the objective, which is their mean (delta method).
    """

    numbers: NDArray[np.int64]
    values: NDArray[np.float64]


class PairedSamples:
    """Samples of several strings; those with the same number start from the same configuration.

    Parameters
    ----------
    samples
        By string.
    """

    def __init__(self, samples: Mapping[int, SampleValues]) -> None:
        self._samples = samples

    @classmethod
    def behind(cls, estimates: Iterable[Estimate], data: CampaignData) -> Self | None:
        """Return the fresh samples behind estimates; None if strings do not share configurations.

        They do if the campaign has `common_configurations`.
        """
        if not data.identity.get("ensemble.common_configurations", False):
            return None
        fresh = data.fresh_samples
        fresh = fresh[fresh["state"] == COMPLETED]
        strings = [estimate.string for estimate in estimates if estimate.known]
        return cls(
            {i: sample_values(objective_at(data, i), fresh[fresh["string"] == i]) for i in strings}
        )

    def difference(self, one: int, other: int) -> MeanEstimate:
        """Return the objective of `one` minus that of `other`, over the samples that both have."""
        numbers = self._shared([one, other])
        return mean_of(self._values(one, numbers) - self._values(other, numbers))

    def average(self) -> MeanEstimate:
        """Return the mean objective of all strings, over the samples that all have."""
        strings = list(self._samples)
        numbers = self._shared(strings)
        return mean_of(np.mean([self._values(string, numbers) for string in strings], axis=0))

    def _shared(self, strings: list[int]) -> NDArray[np.int64]:
        return reduce(np.intersect1d, (self._samples[string].numbers for string in strings))

    def _values(self, string: int, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        sampled = self._samples[string]
        return sampled.values[np.searchsorted(sampled.numbers, numbers)]


def sample_values(law: Objective, rows: NDArray[np.void]) -> SampleValues:
    """Return what the completed samples of one string, rows of `/samples`, add to an objective.

    An objective that is the magnitude of a mean has the sign of that mean put on the values, so
    that their mean is the objective.
    """
    values = law.influence_values(law.summaries(rows))
    return SampleValues(rows["sample"].astype(np.int64), math.copysign(1.0, values.mean()) * values)


SIGNIFICANCE: Final = 0.05
"""Familywise error rate: probability that any of several equal means is reported to differ."""


def significant_differences(
    means: Sequence[MeanEstimate],
    differences: Mapping[tuple[int, int], MeanEstimate] | None = None,
    rounding: float = 0.0,
) -> set[tuple[int, int]]:
    """Return the pairs of indices (i, j), i < j, of means that differ at 95 %.

    The correction (Holm 1979) counts all pairs, so that it holds for comparisons with the best one,
    too, though the data decide which one that is.

    Parameters
    ----------
    means
        Their samples are independent of each other, unless there are `differences`.
    differences
        Of each pair of means, if their samples are paired.
    rounding
        Largest difference that is rounding: such means are equal.
    """
    pairs = list(combinations(range(len(means)), 2))
    if differences is None:
        chances = {(i, j): p_value(means[i], means[j], rounding) for i, j in pairs}
    else:
        chances = {pair: paired_p_value(differences[pair], rounding) for pair in pairs}
    tested = sorted((chance, pair) for pair, chance in chances.items())
    found: set[tuple[int, int]] = set()
    for left, (chance, pair) in zip(range(len(tested), 0, -1), tested, strict=True):
        if chance > SIGNIFICANCE / left:
            break
        found.add(pair)
    return found


def p_value(one: MeanEstimate, other: MeanEstimate, rounding: float = 0.0) -> float:
    """Return the two-sided p-value of the hypothesis that two means are equal (Welch 1947).

    It is 1 where they differ by no more than `rounding`.
    """
    variances = one.error**2, other.error**2
    total = sum(variances)
    difference = abs(one.value - other.value)
    if difference <= rounding:
        return 1.0
    if total == 0.0:
        return 0.0
    shares = (variances[0] / total) ** 2, (variances[1] / total) ** 2
    freedom = 1.0 / (shares[0] / (one.samples - 1) + shares[1] / (other.samples - 1))
    return t_tails(difference / math.sqrt(total), freedom)


def paired_p_value(difference: MeanEstimate, rounding: float = 0.0) -> float:
    """Return the two-sided p-value of the hypothesis that a mean of paired differences is 0.

    It holds however the samples of a pair depend on each other; it is 1 below two pairs, and where
    the difference is no larger than `rounding`.
    """
    value, error, samples = difference
    if samples < 2 or abs(value) <= rounding:
        return 1.0
    if error == 0.0:
        return 0.0
    return t_tails(value / error, samples - 1.0)
