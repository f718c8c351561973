"""Which setting reaches an error, and at what cost: where all finer ones are within it, too.

An error that is small at one setting and larger at a finer one is small by accident: a bias that
changes its sign passes through zero, and noise dips below any bound.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def lasting(errors: ArrayLike, goal: float) -> NDArray[np.bool_]:
    """Return whether each error and those of all finer settings are at most `goal`, (n,).

    Parameters
    ----------
    errors
        Upper bounds of errors, the coarsest setting first, shape (n,); nan is within no goal.
    goal
        The error to reach.
    """
    within = np.asarray(errors, float) <= goal
    return np.logical_and.accumulate(within[::-1])[::-1]


def cost_at(errors: ArrayLike, costs: ArrayLike, goal: float) -> float:
    """Return the cost at which `goal` is reached to stay; inf if it never is.

    Between settings the logarithm of the cost is interpolated in that of the error; arguments as
    for `lasting`, costs of shape (n,).
    """
    error, cost = np.asarray(errors, float), np.asarray(costs, float)
    reached = np.flatnonzero(lasting(error, goal))
    if not len(reached):
        return math.inf
    k = int(reached[0])
    if k == 0 or math.isnan(error[k - 1]):
        return float(cost[k])
    share = math.log(error[k - 1] / goal) / math.log(error[k - 1] / error[k])
    return float(cost[k - 1] * (cost[k] / cost[k - 1]) ** share)
