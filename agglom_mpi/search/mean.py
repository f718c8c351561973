"""A mean with its standard error."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from agglom_mpi.search.student import t_95


class Mean(NamedTuple):
    """A mean over so many independent samples, and its standard error, nan for one of them."""

    value: float
    error: float
    samples: int

    @property
    def half_width(self) -> float:
        """Half the 95 % t interval; inf where there is none."""
        return t_95(self.samples - 1) * self.error if self.samples > 1 else math.inf


def mean_of(values: ArrayLike) -> Mean:
    """Mean and standard error of independent values, shape (n,); that of none is nan."""
    numbers = np.asarray(values, float)
    if numbers.size == 0:
        return Mean(math.nan, math.nan, 0)
    if numbers.size == 1:
        return Mean(float(numbers[0]), math.nan, 1)
    error = float(np.std(numbers, ddof=1)) / math.sqrt(numbers.size)
    return Mean(float(np.mean(numbers)), error, numbers.size)
