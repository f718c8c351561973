"""Stopping rules over their tolerances: error of the mean, samples spent, coverage.

The rules are those of `STUDIED_RULES`; a new one there is studied as well. One pool of samples is
drawn in many random orders. `search.ensemble.Ensemble` decides sample by sample. Here every order
is run to its last sample once, all orders side by side, and each rule and tolerance is evaluated
afterwards.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.time_integration.steps import lasting
from agglom_mpi.search.objectives.objective import RadiusObjective
from agglom_mpi.search.stopping import (
    EnsembleState,
    Moments,
    StandardError,
    StoppingRule,
    SuccessiveDifference,
)
from agglom_mpi.statistics import t_95

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

STUDIED_RULES: Final[tuple[tuple[str, Callable[..., StoppingRule]], ...]] = (
    ("successive difference, mean radius", partial(SuccessiveDifference, quantity="mean_radius")),
    ("successive difference, objective", SuccessiveDifference),
    *((f"moments 1 to {order}", partial(Moments, order=order)) for order in (2, 3, 4)),
    ("standard error", StandardError),
)
"""Rules whose tolerance is varied: name, and the rule of a `tolerance` and of `max_samples`."""
OWN: Final = "this campaign's"
PUBLISHED_TOLERANCES: Final = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)
"""Tolerances of rules whose tolerance is a share; an absolute one follows from the spread."""


def run_paths(
    pool: np.ndarray, objective: RadiusObjective, draws: NDArray[np.int64]
) -> tuple[EnsembleState[Floats], Floats]:
    """Return the running statistics of samples taken from a pool, and the objective's with sign.

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
    signed, error = _running(objective.deviation(ratio), draws, count)
    states = EnsembleState(
        count.astype(np.int64), mean, np.abs(signed), error, _pooled(pool, draws)
    )
    return states, signed


def _member(values: Floats) -> float:
    """Return the median, or the value above it, which is a member of `values`."""
    return float(np.sort(values)[len(values) // 2])


def _running(values: Floats, draws: NDArray[np.int64], count: Floats) -> tuple[Floats, Floats]:
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


def stop(
    rule: StoppingRule, states: EnsembleState[Floats], min_samples: int, max_samples: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the samples after which an `Ensemble` with this rule and these limits would end.

    Returns
    -------
    tuple
        Samples used by each order, and whether the rule was satisfied then, (orders,) each.
    """
    enough = rule.satisfied_paths(states)[:max_samples]
    enough[: max(min_samples, 2) - 1] = False  # there is no rule before the second sample
    satisfied: NDArray[np.bool_] = np.logical_or.reduce(enough)
    return np.where(satisfied, enough.argmax(axis=0) + 1, len(enough)), satisfied


def at_stop(values: Floats, used: NDArray[np.int64]) -> Floats:
    """Return the value that each order ended with, shape (orders,), of paths (samples, orders)."""
    return values[used - 1, np.arange(values.shape[1])]


class Truth(NamedTuple):
    """Exact statistics of the pool that samples are drawn from, with replacement.

    Attributes
    ----------
    mean, spread
        Mean and standard deviation of b^f/b⁰ over the pool's samples.
    deviation
        Mean of the objective's signed deviation; the objective is its magnitude.
    slope
        Change of the deviation with b^f/b⁰, positive.
    """

    mean: float
    spread: float
    deviation: float
    slope: float

    @classmethod
    def of_pool(cls, pool: np.ndarray, objective: RadiusObjective) -> "Truth":
        """Return the statistics of a pool of completed samples."""
        ratio = pool["mean_radius_ratio"]
        ends = objective.deviation(np.array([0.0, 1.0]))  # linear in b^f/b⁰ up to a single sphere
        deviation, slope = float(np.mean(objective.deviation(ratio))), abs(float(ends[1] - ends[0]))
        return cls(float(np.mean(ratio)), float(np.std(ratio)), deviation, slope)


Rules = list[tuple[str, StoppingRule]]
"""Rules to study, each with its label: one label has a rule of each tolerance."""


def families(truth: Truth, most: int) -> Rules:
    """Return the rules to study, in ensembles of at most `most` samples."""
    found: Rules = []
    for label, make in STUDIED_RULES:
        rule = make(tolerance=1.0, max_samples=most)
        widths = half_widths(truth, rule.min_samples, most)
        for tolerance in PUBLISHED_TOLERANCES if rule.relative_to else widths:
            found.append((label, make(tolerance=tolerance, max_samples=most)))
    return found


def half_widths(truth: Truth, fewest: int, most: int) -> Iterator[float]:
    """Yield round half-widths of the objective, widest first, for `fewest` to `most` samples."""
    spread = truth.slope * truth.spread
    widest = t_95(fewest - 1) * spread / math.sqrt(fewest)
    narrowest = t_95(most - 1) * spread / math.sqrt(most)
    decade = math.floor(math.log10(widest)) + 1
    while 10.0**decade > 0.1 * narrowest:
        for digit in (7.0, 5.0, 3.0, 2.0, 1.5, 1.0):
            width = float(f"{digit}e{decade - 1}")
            if narrowest <= width <= widest:
                yield width
        decade -= 1


def study(
    pool: np.ndarray, objective: RadiusObjective, rules: Rules, draws: NDArray[np.int64]
) -> "pd.DataFrame":
    """Apply every rule to the same orders of a pool; one row per rule and tolerance.

    Proportions come with binomial standard errors. The `draws` are those of `run_paths`.
    """
    import pandas as pd

    truth, rows = Truth.of_pool(pool, objective), []
    states, signed = run_paths(pool, objective, draws)
    for label, rule in rules:
        most = min(rule.max_samples, len(draws))
        used, satisfied = stop(rule, states, rule.min_samples, most)
        error = at_stop(states.mean_radius_ratio, used) / truth.mean - 1.0
        rms, low, high = root_mean_square(error)
        factor = np.array([t_95(count - 1) for count in used.tolist()])
        half_width = factor * at_stop(states.standard_error, used)
        covered = np.abs(at_stop(signed, used) - truth.deviation) <= half_width
        coverage, coverage_error = proportion(covered)
        rows.append(
            {
                "rule": label,
                "tolerance": rule.tolerance,
                "orders": len(error),
                "samples, mean": float(np.mean(used)),
                "rms error": rms,
                "rms error, low": low,
                "rms error, high": high,
                "coverage": coverage,
                "coverage, standard error": coverage_error,
                "ended at max_samples": float(np.mean(~satisfied)),
            }
        )
    return pd.DataFrame(rows)


def root_mean_square(errors: Floats) -> tuple[float, float, float]:
    """Return the root mean square and its 95 % interval, of independent errors."""
    squares = errors**2
    mean = float(np.mean(squares))
    half = 1.96 * float(np.std(squares, ddof=1)) / math.sqrt(len(squares))
    return math.sqrt(mean), math.sqrt(max(mean - half, 0.0)), math.sqrt(mean + half)


def proportion(hits: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the proportion of hits and its standard error (Agresti and Coull 1998).

    The error is that of two hits and two misses more, so that it is not 0 where all hit or miss.
    """
    count = len(hits)
    smooth = (np.count_nonzero(hits) + 2.0) / (count + 4.0)
    return float(np.mean(hits)), math.sqrt(smooth * (1.0 - smooth) / (count + 4.0))


def round_goal(truth: Truth) -> float:
    """Return the error at which rules are compared: 1 %, or less if two samples reach that."""
    goal = 1e-2
    while (truth.spread / truth.mean / goal) ** 2 < 2.0:
        goal *= 0.1
    return goal


def of_rules(frame: "pd.DataFrame") -> "pd.DataFrame":
    """Return the rows without the campaign's own rule, and where most ensembles were stopped."""
    return frame[(frame["rule"] != OWN) & (frame["ended at max_samples"] <= 0.5)]


def at_goal(frame: "pd.DataFrame", goal: float) -> "pd.DataFrame":
    """Return of each rule the loosest tolerance that reaches a relative error, or the tightest.

    All tighter ones reach it, too.
    """
    picked = []
    for _, rows in frame.groupby("rule", sort=False):
        reached = np.flatnonzero(lasting(rows["rms error"], goal))
        picked.append(rows.index[reached[0] if len(reached) else -1])
    return frame.loc[picked]
