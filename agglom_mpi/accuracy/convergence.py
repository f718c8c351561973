"""With which power of the step does an error fall?"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Power(NamedTuple):
    """The order of convergence, error ∝ step^order, and its standard error."""

    order: float
    standard_error: float


def fit_power(steps: ArrayLike, errors: ArrayLike, standard_errors: ArrayLike) -> Power:
    """Fit a straight line to the logarithms of mean errors.

    All points weigh the same. The order's standard error is the larger of two: from the points'
    own standard errors, and from their scatter about the line, which also holds what averaging
    does not remove.

    Parameters
    ----------
    steps, errors, standard_errors
        Positive, the last not negative, shape (points,), at least 3 points.
    """
    x, y = np.log(np.asarray(steps, float)), np.log(np.asarray(errors, float))
    own = np.asarray(standard_errors, float) / np.asarray(errors, float)
    away = x - np.mean(x)
    spread = float(np.sum(away**2))
    order = float(np.sum(away * y)) / spread
    scatter = float(np.sum((y - np.mean(y) - order * away) ** 2)) / (len(x) - 2)
    variance = max(scatter / spread, float(np.sum((away * own) ** 2)) / spread**2)
    return Power(order, math.sqrt(variance))
