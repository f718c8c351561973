"""One pool of samples drawn in many random orders, and where a stopping rule ends each of them.

`search.ensemble.Ensemble` decides sample by sample. Here every order is run to its last sample
once, all orders side by side, and each rule and tolerance is evaluated afterwards.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.objectives.objective import RadiusObjective
from agglom_mpi.search.stopping import EnsembleState, StoppingRule

Floats = NDArray[np.float64]


class EstimatePaths(NamedTuple):
    """Statistics of the first 1, 2, … samples of each order; arrays of shape (samples, orders).

    Attributes
    ----------
    mean
        Of b^f/b⁰ over samples.
    deviation, standard_error
        Mean over samples of the objective's signed deviation, and its standard error, which is nan
        for one sample.
    central
        Moments 2, 3, 4 of b/b⁰ about its mean, over the particles of all samples [A 24].
    """

    mean: Floats
    deviation: Floats
    standard_error: Floats
    central: tuple[Floats, Floats, Floats]

    @property
    def moments(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Moments 1 to 4 as stopping rules compare them."""
        return (self.mean, *self.central)

    @property
    def states(self) -> EnsembleState[Floats]:
        """Statistics after each sample, as stopping rules take them."""
        count = np.arange(1, len(self.mean) + 1)[:, None]
        objective = np.abs(self.deviation)
        return EnsembleState(count, self.mean, objective, self.standard_error, self.central)


class Stops(NamedTuple):
    """Samples used by each order, and whether the rule was satisfied then; shape (orders,)."""

    used: NDArray[np.int64]
    satisfied: NDArray[np.bool_]


def run_paths(
    pool: np.ndarray, objective: RadiusObjective, draws: NDArray[np.int64]
) -> EstimatePaths:
    """Return the running statistics of samples taken from a pool.

    Sums are taken about a member of the pool, so that equal samples give exact zeros.

    Parameters
    ----------
    pool
        Completed samples as `OUTCOME` rows, shape (rows,).
    draws
        Which row each order takes as its 1st, 2nd, … sample, shape (samples, orders).
    """
    count = np.arange(1.0, len(draws) + 1.0)[:, None]
    ratio = pool["mean_radius_ratio"]
    mean, _ = _running(ratio, draws, count)
    deviation, error = _running(objective.deviation(ratio), draws, count)
    return EstimatePaths(mean, deviation, error, _pooled(pool, draws))


def stop(rule: StoppingRule, paths: EstimatePaths, min_samples: int, max_samples: int) -> Stops:
    """Return where an `Ensemble` with this rule and these limits would end.

    Parameters
    ----------
    min_samples, max_samples
        Fewest and most samples, at most as many as the paths have; the rule is evaluated from the
        second sample on at the earliest.
    """
    enough = rule.satisfied_paths(paths.states)[:max_samples]
    enough[: max(min_samples, 2) - 1] = False
    satisfied: NDArray[np.bool_] = np.logical_or.reduce(enough)
    return Stops(np.where(satisfied, enough.argmax(axis=0) + 1, len(enough)), satisfied)


def at_stop(values: Floats, stops: Stops) -> Floats:
    """Return the value that each order ended with, shape (orders,), of paths (samples, orders)."""
    return values[stops.used - 1, np.arange(values.shape[1])]


def pooled_moments(pool: np.ndarray) -> Floats:
    """Return mean b^f/b⁰ over samples and pooled central moments 2, 3, 4 of a pool, shape (4,)."""
    everyone = np.arange(len(pool))[:, None]
    central = [float(moment[-1, 0]) for moment in _pooled(pool, everyone)]
    return np.array([float(np.mean(pool["mean_radius_ratio"])), *central])


def _member(values: Floats) -> float:
    """Return the median, or the value above it, which is a member of `values`."""
    return float(np.sort(values)[len(values) // 2])


def _running(values: Floats, draws: NDArray[np.int64], count: Floats) -> tuple[Floats, Floats]:
    """Return the running mean and its standard error."""
    centre = _member(values)
    away = (values - centre)[draws]
    mean = np.cumsum(away, axis=0) / count
    squares = np.cumsum(away**2, axis=0) - count * mean**2
    with np.errstate(invalid="ignore"):  # 0/0: one sample has no standard error
        error = np.sqrt(np.maximum(squares, 0.0) / (count - 1.0) / count)
    return centre + mean, error


def _pooled(pool: np.ndarray, draws: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """Return running central moments 2, 3, 4 of the particles of all samples."""
    ratio = pool["mean_radius_ratio"]
    away = ratio - _member(ratio)
    m2, m3, m4 = (pool[f"radius_moment_{order}"] for order in (2, 3, 4))
    left = pool["particles"].astype(float)
    particles = np.cumsum(left[draws], axis=0)
    a1, a2, a3, a4 = (
        np.cumsum((left * sample)[draws], axis=0) / particles
        for sample in (
            away,
            m2 + away**2,
            m3 + 3.0 * away * m2 + away**3,
            m4 + 4.0 * away * m3 + 6.0 * away**2 * m2 + away**4,
        )
    )
    return (
        a2 - a1**2,
        a3 - 3.0 * a1 * a2 + 2.0 * a1**3,
        a4 - 4.0 * a1 * a3 + 6.0 * a1**2 * a2 - 3.0 * a1**4,
    )
