"""Stopping rules over their tolerances: error of the mean, samples spent, luck, coverage."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.resampling import (
    Floats,
    Paths,
    at_stop,
    pooled_moments,
    run_paths,
    stop,
)
from agglom_mpi.search.objectives import RadiusObjective
from agglom_mpi.search.stopping import (
    Moments,
    StandardError,
    StoppingRule,
    SuccessiveDifference,
)
from agglom_mpi.statistics import t_95

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.config.ensemble import AdaptiveEnsemble

FIRST_MOMENT: Final = "successive difference, mean radius"
"""Which the moments rule of order 1 is too."""

WITH_ERROR: Final = "standard error"
OWN: Final = "this campaign's"

PUBLISHED_TOLERANCES: Final = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)

FEWEST_PUBLISHED: Final = 2
FEWEST_WITH_ERROR: Final = 5
"""Fewest samples of the published rules and of the standard-error rule: the campaign's defaults."""


class Truth(NamedTuple):
    """What the pool is known to be, exactly.

    Attributes
    ----------
    mean, spread
        Of b^f/b⁰ over the pool's samples; the spread is their standard deviation.
    deviation
        Mean of the objective's signed deviation; the objective is its magnitude.
    slope
        Change of the deviation with b^f/b⁰, positive.
    moments
        Mean and pooled central moments 2, 3, 4, shape (4,).
    """

    mean: float
    spread: float
    deviation: float
    slope: float
    moments: Floats


class Family(NamedTuple):
    """A rule at several tolerances, the limits of its ensembles, the highest moment it watches."""

    label: str
    make: Callable[[float], StoppingRule]
    max_samples: int
    tolerances: tuple[float, ...] = PUBLISHED_TOLERANCES
    min_samples: int = FEWEST_PUBLISHED
    order: int = 1


def truth_of(pool: np.ndarray, objective: RadiusObjective) -> Truth:
    """Return the exact statistics of a pool from which samples are drawn with replacement."""
    ratio = pool["mean_radius_ratio"]
    ends = objective.deviation(np.array([0.0, 1.0]))  # linear in b^f/b⁰ up to one single sphere
    return Truth(
        mean=float(np.mean(ratio)),
        spread=float(np.std(ratio)),
        deviation=float(np.mean(objective.deviation(ratio))),
        slope=abs(float(ends[1] - ends[0])),
        moments=pooled_moments(pool),
    )


def families(truth: Truth, most: int) -> list[Family]:
    """Return the rules to study, in ensembles of at most `most` samples."""
    published = [
        Family(FIRST_MOMENT, partial(SuccessiveDifference, quantity="mean_radius"), most),
        Family("successive difference, objective", SuccessiveDifference, most),
        *(
            Family(f"moments 1 to {order}", partial(Moments, order=order), most, order=order)
            for order in (2, 3, 4)
        ),
    ]
    widths = tuple(half_widths(truth, most))
    return [*published, Family(WITH_ERROR, StandardError, most, widths, FEWEST_WITH_ERROR)]


def campaigns_own(model: "AdaptiveEnsemble", most: int) -> Family:
    """Return the rule that a campaign's `ensemble` asks for, with its one tolerance."""
    rule = model.build()
    order = rule.order if isinstance(rule, Moments) else 1
    limit = min(model.max_samples, most)
    return Family(OWN, lambda _: rule, limit, (model.tolerance,), model.min_samples, order)


def half_widths(truth: Truth, most: int) -> Iterator[float]:
    """Yield round tolerances of the objective that 5 to `most` samples reach, the widest first."""
    spread = truth.slope * truth.spread
    widest = t_95(FEWEST_WITH_ERROR - 1) * spread / math.sqrt(FEWEST_WITH_ERROR)
    narrowest = t_95(most - 1) * spread / math.sqrt(most)
    decade = math.floor(math.log10(widest)) + 1
    while 10.0**decade > 0.1 * narrowest:
        for digit in (7.0, 5.0, 3.0, 2.0, 1.5, 1.0):
            width = float(f"{digit}e{decade - 1}")
            if narrowest <= width <= widest:
                yield width
        decade -= 1


def study(
    pool: np.ndarray,
    objective: RadiusObjective,
    rules: list[Family],
    draws: NDArray[np.int64],
) -> "pd.DataFrame":
    """Let every rule judge the same orders of a pool; one row per rule and tolerance.

    Parameters
    ----------
    draws
        Which row of the pool each order takes next, shape (samples, orders).
    """
    import pandas as pd

    truth = truth_of(pool, objective)
    paths = run_paths(pool, objective, draws)
    return pd.DataFrame(
        [judge(family, value, paths, truth) for family in rules for value in family.tolerances]
    )


def believed(rule: StoppingRule, truth: Truth) -> float:
    """Relative error of the mean of b^f/b⁰ that a rule's tolerance is, taken as an error bound."""
    if isinstance(rule, StandardError):
        return rule.tolerance / truth.slope / truth.mean
    if isinstance(rule, SuccessiveDifference) and rule.quantity == "objective":
        return rule.tolerance * abs(truth.deviation) / truth.slope / truth.mean
    if isinstance(rule, SuccessiveDifference | Moments):
        return rule.tolerance
    raise TypeError(f"no such stopping rule: {rule!r}")


def judge(family: Family, tolerance: float, paths: Paths, truth: Truth) -> dict[str, object]:
    """Return what one rule makes of all orders; the shares come with binomial standard errors."""
    rule = family.make(tolerance)
    stops = stop(rule, paths, family.min_samples, family.max_samples)
    bound = believed(rule, truth)
    error = at_stop(paths.mean, stops) / truth.mean - 1.0
    rms, low, high = root_mean_square(error)
    highest = at_stop(paths.moments[family.order - 1], stops) / truth.moments[family.order - 1]
    factor = np.array([t_95(used - 1) for used in stops.used.tolist()])
    half_width = factor * at_stop(paths.standard_error, stops)
    covered = np.abs(at_stop(paths.deviation, stops) - truth.deviation) <= half_width
    lucky, lucky_error = share((np.abs(error) > bound)[stops.satisfied])
    coverage, coverage_error = share(covered)
    return {
        "rule": family.label,
        "tolerance": tolerance,
        "error believed": bound,
        "orders": len(error),
        "samples, mean": float(np.mean(stops.used)),
        "samples, 10 %": float(np.quantile(stops.used, 0.1)),
        "samples, 90 %": float(np.quantile(stops.used, 0.9)),
        "rms error": rms,
        "rms error, fixed number": truth.spread / truth.mean / math.sqrt(np.mean(stops.used)),
        "rms error, low": low,
        "rms error, high": high,
        "median error": float(np.median(np.abs(error))),
        "rms error, highest moment": root_mean_square(highest - 1.0)[0],
        "stopped by luck": lucky,
        "stopped by luck, standard error": lucky_error,
        "coverage": coverage,
        "coverage, standard error": coverage_error,
        "ended at max_samples": float(np.mean(~stops.satisfied)),
    }


def root_mean_square(errors: Floats) -> tuple[float, float, float]:
    """Return the root mean square and its 95 % interval, of independent errors."""
    squares = errors**2
    mean = float(np.mean(squares))
    half = 1.96 * float(np.std(squares, ddof=1)) / math.sqrt(len(squares))
    return math.sqrt(mean), math.sqrt(max(mean - half, 0.0)), math.sqrt(mean + half)


def share(hits: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the share of hits and its standard error, nan for none (Agresti and Coull 1998).

    The error is that of two hits and two misses more, so that it is not 0 for a share of 0 or 1.
    """
    count = len(hits)
    if count == 0:
        return math.nan, math.nan
    smooth = (np.count_nonzero(hits) + 2.0) / (count + 4.0)
    return float(np.mean(hits)), math.sqrt(smooth * (1.0 - smooth) / (count + 4.0))
