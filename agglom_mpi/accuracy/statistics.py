"""Estimates with their errors, as the sections of the report use them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.search.student import t_95
from agglom_mpi.simulation.outcome import COMPLETED


class Estimate(NamedTuple):
    """A mean, its standard error (nan for one value) and the number of samples."""

    mean: float
    error: float
    samples: int

    @property
    def half_width(self) -> float:
        """Half the 95 % t interval; inf where there is none."""
        return t_95(self.samples - 1) * self.error if self.samples > 1 else math.inf


def estimate(values: ArrayLike) -> Estimate:
    """Mean and standard error of independent values, shape (n,)."""
    numbers = np.asarray(values, float)
    if numbers.size == 0:
        return Estimate(math.nan, math.nan, 0)
    if numbers.size == 1:
        return Estimate(float(numbers[0]), math.nan, 1)
    error = float(np.std(numbers, ddof=1)) / math.sqrt(numbers.size)
    return Estimate(float(np.mean(numbers)), error, numbers.size)


def completed(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Rows of samples that did not fail."""
    return rows[rows["state"] == COMPLETED]


def paired_difference(rows: NDArray[np.void], reference: NDArray[np.void], name: str) -> Estimate:
    """Mean of a column less that of the reference, over samples that completed in both.

    Samples of one number have the same random start, so what they share cancels.
    """
    ours, theirs = completed(rows), completed(reference)
    _, first, second = np.intersect1d(ours["sample"], theirs["sample"], return_indices=True)
    return estimate(ours[name][first] - theirs[name][second])
