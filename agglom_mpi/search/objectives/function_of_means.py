"""The objective as a function of the means of quantities: value, slopes, standard error.

The delta method needs the derivatives of the function at the means. The function is the user's, so
they are differences over steps that are small beside the standard errors of the means, and beside
the means. At a kink, as that of |mean - 2|, the derivatives are those beside it, as elsewhere in
this package: an error of 0 there would end an ensemble by luck.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.criteria import Criterion
from agglom_mpi.statistics import Floats, RunningMeans

OfMeans: TypeAlias = Callable[[Mapping[str, Any]], Any]
"""Function of the means by name that returns the objective; it may raise any exception.

Of arrays it may return an array.
"""

STEP_IN_ERRORS: Final = 1e-4
"""Step of a difference relative to the standard error of a mean."""
MIN_RELATIVE_STEP: Final = 1e-6
"""Minimum step relative to the mean itself: rounding then changes a slope by about 1e-10."""
COMPARED_CALLS: Final = 16
"""Number of single calls that the result of a call with arrays is compared with."""
KINK_SHARE: Final = 0.75
"""Minimum ratio of one-sided differences over half a step and over the step at a kink, where
their signs are opposite; the ratio is 0.5 where the function is smooth."""
KINK_STEPS: Final = 4.0
"""Steps away from a kink at which its slopes are taken."""


class ObjectiveOfMeans:
    """An objective that a function makes of the means of named quantities.

    Parameters
    ----------
    names
        Names of the quantities, in the order of their values.
    function
        Returns the objective of the means.
    """

    def __init__(self, names: Sequence[str], function: OfMeans) -> None:
        self.names = tuple(names)
        self._function = function

    def value(self, means: Floats) -> float:
        """Return the objective of means, (k,); inf where the function raises or is not finite."""
        try:
            return float(self._function(dict(zip(self.names, means.tolist(), strict=True))))
        except Exception:  # a user's function may raise any
            return math.inf

    def values(self, means: Floats) -> Floats:
        """Return the objectives of means, (n, k), shape (n,).

        Many functions take arrays as they take numbers, in a hundredth of the time. What one
        returns of arrays counts only if it agrees with single calls at some of the means.
        """
        count = len(means)
        if count > COMPARED_CALLS:
            try:
                with np.errstate(all="ignore"):
                    columns = dict(zip(self.names, means.T, strict=True))
                    found = np.asarray(self._function(columns), np.float64)
            except Exception:  # a user's function may raise any
                found = np.zeros(())
            if found.shape == (count,):
                found = np.where(np.isfinite(found), found, math.inf)
                some = np.linspace(0, count - 1, COMPARED_CALLS).astype(np.int64)
                if np.allclose(found[some], [self.value(means[i]) for i in some], rtol=1e-9):
                    return found
        return np.array([self.value(row) for row in means], np.float64)

    def gradient(self, means: Floats, errors: Floats) -> Floats:
        """Return the derivatives of the objective by the means, shape (k,).

        Parameters
        ----------
        means
            The means, (k,).
        errors
            Their standard errors, (k,). A derivative by a mean without an error is 0: that mean
            adds nothing to the error of the objective.
        """
        steps = np.where(
            errors > 0.0, np.maximum(STEP_IN_ERRORS * errors, MIN_RELATIVE_STEP * abs(means)), 0.0
        )
        sides = self._one_sided(means, steps)
        if (kinks := self._kinks(means, steps, sides)).any():
            changes = np.where(kinks, np.nanmax(abs(sides), axis=0), 0.0) * steps
            away = int(np.argmax(changes))
            means = means.copy()
            means[away] += KINK_STEPS * steps[away]
            sides = self._one_sided(means, steps)
        upper, lower = sides
        return np.where(
            np.isnan(upper), lower, np.where(np.isnan(lower), upper, sides.mean(axis=0))
        )

    def _one_sided(self, means: Floats, steps: Floats) -> Floats:
        """Return slopes to above and to below each mean, (2, k); nan where one is not finite."""
        centre, slopes = self.value(means), np.zeros((2, len(means)))
        for i in np.flatnonzero(steps).tolist():
            for side, sign in enumerate((1.0, -1.0)):
                moved = means.copy()
                moved[i] += sign * steps[i]
                change, step = self.value(moved) - centre, moved[i] - means[i]
                slopes[side, i] = change / step if math.isfinite(change) and step else math.nan
        return slopes

    def _kinks(self, means: Floats, steps: Floats, sides: Floats) -> NDArray[np.bool_]:
        """Return at which means the function has a kink, shape (k,)."""
        turns = sides[0] * sides[1] < 0.0
        if not turns.any():
            return turns
        closer = self._one_sided(means, np.where(turns, 0.5 * steps, 0.0))
        return turns & (abs(closer) > KINK_SHARE * abs(sides)).all(axis=0)


class MeansBelow(Criterion):
    """The objective of the means of quantities is at most a tolerance.

    Parameters
    ----------
    objective
        Function of the means.
    tolerance
        Largest objective of a member.
    """

    quantities = ("objective",)

    def __init__(self, objective: ObjectiveOfMeans, tolerance: float) -> None:
        self._objective, self._tolerance = objective, tolerance
        self.text = f"objective of the means at most {tolerance:.4g}"

    def bands(self) -> list[tuple[float, float]]:
        """Return the bounds."""
        return [(-math.inf, self._tolerance)]

    def distance(self, compared: Floats) -> Floats:
        """Return how far objectives are above the tolerance."""
        return np.asarray(compared[..., 0] - self._tolerance)

    def numbers(self, rows: NDArray[np.void], particles: int) -> Floats:
        """Return the quantities."""
        return np.column_stack([rows[name] for name in self._objective.names]).astype(np.float64)

    def compared(self, means: Floats) -> Floats:
        """Return the objectives, (…, 1)."""
        values = self._objective.values(means.reshape(-1, means.shape[-1]))
        return values.reshape(*means.shape[:-1], 1)

    def holds(self, compared: Floats) -> NDArray[np.bool_]:
        """Return which objectives are at most the tolerance."""
        return np.asarray(compared[..., 0] <= self._tolerance)


class MeansAccumulator:
    """Means of the quantities of the samples so far, and the objective that they make.

    Parameters
    ----------
    objective
        Function of the means.
    """

    def __init__(self, objective: ObjectiveOfMeans) -> None:
        self._objective = objective
        self._means = RunningMeans(len(objective.names))

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""
        self._means.add(outcome.quantities)
        self.__dict__.pop("value", None)

    @cached_property
    def value(self) -> float:
        """The objective of the means; inf where the function raises or is not finite."""
        return self._objective.value(self._means.means) if self._means.count else math.nan

    @property
    def standard_error(self) -> float:
        """Standard error by the delta method; 0 where the objective is inf."""
        if self._means.count < 2:
            return math.nan
        return 0.0 if math.isinf(self.value) else self._means.standard_error(self._slopes())

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> Floats:
        """Return the objective plus the first-order influence of each sample, (n,)."""
        if math.isinf(self.value):
            return np.full(len(outcomes), self.value)
        away = np.array([outcome.quantities for outcome in outcomes]) - self._means.means
        return np.asarray(self.value + away @ self._slopes())

    def _slopes(self) -> Floats:
        return self._objective.gradient(self._means.means, self._means.standard_errors)
