"""Cost until a search reaches a target, over independent runs: expected run time and its band.

The expected run time of a target is the cost of all runs, each until it reaches the target or ends,
per run that reaches it (Auger and Hansen 2005; Hansen et al. 2021, COCO). That is what it takes to
reach the target once if a run that has not is followed by another one.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.statistics import t_95

Floats = NDArray[np.float64]

TAIL: Final = 0.025
"""Probability beyond each end of a band."""
RESAMPLES: Final = 2000
"""Number of sets of runs that are drawn for a band."""


class Band(NamedTuple):
    """A value with the ends of its 95 % band; inf where too few runs reach the target.

    Where no run does, the value is inf and the band is open: its lower end is a bound.
    """

    value: float
    low: float
    high: float


class TimesToTargets(NamedTuple):
    """Costs of n independent runs until each of m targets.

    Attributes
    ----------
    reached
        Cost at which each run reaches each target, inf where it does not, shape (n, m).
    spent
        Cost of each whole run, shape (n,).
    """

    reached: Floats
    spent: Floats

    @classmethod
    def of_runs(
        cls, costs: list[Floats], errors: list[Floats], targets: ArrayLike
    ) -> "TimesToTargets":
        """Return the costs of runs whose answers have errors at some costs.

        Parameters
        ----------
        costs, errors
            Of each run, arrays of shape (k,): its cost so far, ascending, and the error of the
            answer that it has then.
        targets
            Errors to reach, shape (m,).
        """
        reached = [cost_to(c, e, targets) for c, e in zip(costs, errors, strict=True)]
        return cls(np.array(reached), np.array([cost[-1] for cost in costs]))

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.spent)

    @property
    def successes(self) -> NDArray[np.int64]:
        """Number of runs that reach each target, shape (m,)."""
        return np.isfinite(self.reached).sum(axis=0)

    @property
    def expected(self) -> Floats:
        """Expected run time of each target, shape (m,); inf where no run reaches it."""
        return _expected(self.reached[None], self.spent[None])[0]

    def share(self, costs: ArrayLike) -> Floats:
        """Return the share of all pairs of a run and a target that are reached by costs, (k,)."""
        return (self.reached[None] <= np.asarray(costs)[:, None, None]).mean(axis=(1, 2))

    def band(self, random: np.random.Generator) -> list[Band]:
        """Return the expected run time of each target with its bootstrap band."""
        draws = random.integers(self.runs, size=(RESAMPLES, self.runs))
        drawn = _expected(self.reached[draws], self.spent[draws])
        return [
            Band(float(value), *_ends(values, self.runs))
            if np.isfinite(value)
            else Band(math.inf, self.least, math.inf)
            for value, values in zip(self.expected, drawn.T, strict=True)
        ]

    @property
    def least(self) -> float:
        """Lower bound of the expected run time of a target that no run reaches.

        A run reaches it with a probability of at most 1 − 0.025^(1/n) (Clopper and Pearson 1934).
        What is counted is the cost of the runs that fail.
        """
        most = 1.0 - TAIL ** (1.0 / self.runs)
        return float(self.spent.mean() * (1.0 - most) / most)


def cost_to(costs: ArrayLike, errors: ArrayLike, targets: ArrayLike) -> Floats:
    """Return the cost at which a run first has an answer within each target, (m,); else inf.

    Parameters
    ----------
    costs, errors
        Shape (k,), costs ascending; an error of nan is within no target.
    targets
        Shape (m,).
    """
    within = np.asarray(errors)[:, None] <= np.asarray(targets)[None]
    first = within.argmax(axis=0)
    return np.where(within.any(axis=0), np.asarray(costs, np.float64)[first], np.inf)


def _expected(reached: Floats, spent: Floats) -> Floats:
    """Return expected run times, (r, m), of r sets of runs: (r, n, m) and (r, n)."""
    cost = np.minimum(reached, spent[..., None]).sum(axis=1)
    successes = np.isfinite(reached).sum(axis=1)
    with np.errstate(divide="ignore"):
        return np.where(successes > 0, cost / np.maximum(successes, 1), np.inf)


def _ends(values: Floats, runs: int) -> tuple[float, float]:
    """Return the ends of the expanded percentile interval of n runs (Hesterberg 2015).

    The percentiles of few runs are too narrow: by the factor √((n − 1)/n), and as they are those of
    a normal distribution in place of Student's t.
    """
    from scipy.special import ndtr

    known = np.sort(values[~np.isnan(values)])
    if not len(known) or runs < 2:
        return math.nan, math.nan
    tail = float(ndtr(-math.sqrt(runs / (runs - 1)) * t_95(runs - 1)))
    # Between inf and a number there is nothing to interpolate.
    low, high = math.floor(tail * (len(known) - 1)), math.ceil((1.0 - tail) * (len(known) - 1))
    return float(known[low]), float(known[high])
