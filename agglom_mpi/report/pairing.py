"""Strings whose fresh samples start from the same random configurations: what differs in pairs."""

import math
from collections.abc import Iterable, Mapping
from functools import reduce
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.database.estimates import Estimate, objective_of
from agglom_mpi.database.reader import CampaignFile
from agglom_mpi.search.mean import Mean, mean_of
from agglom_mpi.search.worth import Objective
from agglom_mpi.simulation.outcome import COMPLETED, measured


class Numbered(NamedTuple):
    """Completed samples of a string.

    Attributes
    ----------
    numbers : array of int64, shape (n,), ascending
    values : array, shape (n,)
        What each adds to the objective, which is their mean (delta method).
    """

    numbers: NDArray[np.int64]
    values: NDArray[np.float64]


class Paired:
    """Samples by string; those with the same number start from the same random numbers.

    Parameters
    ----------
    samples
        Of each string.
    """

    def __init__(self, samples: Mapping[int, Numbered]) -> None:
        self._samples = samples

    @classmethod
    def of_file(
        cls, file: CampaignFile, rows: NDArray[np.void], estimates: Iterable[Estimate]
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

    def difference(self, one: int, other: int) -> Mean:
        """Objective of one string minus that of another, over the samples that both have."""
        numbers = self._shared([one, other])
        return mean_of(self._values(one, numbers) - self._values(other, numbers))

    def average(self) -> Mean:
        """Objective of all strings on average, over the samples that all have."""
        strings = list(self._samples)
        numbers = self._shared(strings)
        return mean_of(np.mean([self._values(string, numbers) for string in strings], axis=0))

    def _shared(self, strings: list[int]) -> NDArray[np.int64]:
        return reduce(np.intersect1d, (self._samples[string].numbers for string in strings))

    def _values(self, string: int, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        sampled = self._samples[string]
        return sampled.values[np.searchsorted(sampled.numbers, numbers)]


def numbered(law: Objective, rows: NDArray[np.void]) -> Numbered:
    """Take completed rows of `/samples` of one string, by number, as an objective sees them.

    Of a magnitude the sign is that of the mean, so that the mean of the values is the objective.
    """
    values = law.linear(list(measured(rows)))
    return Numbered(rows["sample"].astype(np.int64), math.copysign(1.0, values.mean()) * values)
