"""Extrapolation of means to infinitely many grains: y(N) = limit + slope/N.

A box without walls has no surface, so that the leading correction of a mean per particle is one of
1/N: the mean of a ratio of sums over N grains, each correlated with few others. The fit is by
weighted least squares, the weights being the inverse squares of the standard errors, and all that
it gives is a linear combination of the means. So its statistical errors follow from theirs without
further assumptions. The error of the model is another one. With three numbers of grains or more,
`curvature` estimates what a term 1/N² would change. Where the means are not linear in 1/N within
their errors, that term is fitted, too; where they are, what it would change is added to the error
of the limit, as a line that cannot be refuted is not therefore right.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.statistics import MeanEstimate

Floats = NDArray[np.float64]

POOR_FIT: Final = 0.05
"""Probability of a misfit at least as large below which means are not linear in 1/N."""


class Value(NamedTuple):
    """Number with its standard error."""

    value: float
    error: float

    @property
    def is_resolved(self) -> bool:
        """Whether the number is more than two of its standard errors from 0."""
        return abs(self.value) > 2.0 * self.error


class Extrapolation(NamedTuple):
    """Fit of means at n numbers of grains.

    Attributes
    ----------
    order
        Highest power of 1/N in it, 1 or 2.
    limit
        Mean for infinitely many grains, with its statistical error.
    slope
        Coefficient of 1/N.
    shift
        Mean at the first number of grains, as measured, less the limit. Its error allows for the
        mean being among those that are fitted.
    curvature
        Change of the limit by a term 1/N², whether it is fitted or not: the error of the linear
        model. It is nan below three numbers of grains.
    chi_square, p_value
        Sum of the squared misfits of the linear model over their standard errors, and the
        probability of at least that if it holds, of χ² with n - 2 degrees of freedom; nan below
        three numbers of grains.
    """

    order: int
    limit: Value
    slope: Value
    shift: Value
    curvature: Value
    chi_square: float
    p_value: float

    @property
    def model_error(self) -> float:
        """Error of the limit by the model: the size of the 1/N² term that is left out.

        It is 0 where that term is fitted, and below three numbers of grains, where it is unknown.
        """
        known = self.order == 1 and math.isfinite(self.curvature.value)
        return abs(self.curvature.value) if known else 0.0

    @property
    def quoted(self) -> Value:
        """The limit with its error by the means and by the model, in quadrature."""
        return Value(self.limit.value, math.hypot(self.limit.error, self.model_error))

    @property
    def is_linear(self) -> bool:
        """Whether the means are linear in 1/N as far as their errors allow to see."""
        return not self.p_value < POOR_FIT


def extrapolated(grains: Sequence[float], means: Sequence[MeanEstimate]) -> Extrapolation:
    """Fit limit + slope/N to means with known standard errors, and 1/N² where that does not fit.

    Parameters
    ----------
    grains
        Different numbers of grains N, (n,), n at least 2; the first is that of the shift.
    means
        Means at these, independent of each other, (n,). If one of their errors is 0, as where
        nothing happens, all have the same weight.
    """
    fit = fitted(grains, means)
    return fit if fit.is_linear else fitted(grains, means, order=2)


def fitted(grains: Sequence[float], means: Sequence[MeanEstimate], order: int = 1) -> Extrapolation:
    """Return the fit up to a power of 1/N, 1 or 2; other arguments as for `extrapolated`."""
    inverse = 1.0 / np.asarray(grains, np.float64)
    values = np.array([mean.value for mean in means], np.float64)
    errors = np.array([mean.error for mean in means], np.float64)
    known = bool((errors > 0.0).all())
    weights = errors if known else np.ones_like(errors)
    linear = _coefficients(inverse, weights, 1)
    misfit = (values - linear[0] @ values - (linear[1] @ values) * inverse) / weights
    freedom = len(values) - 2
    quadratic = _coefficients(inverse, weights, 2) if freedom else np.full_like(linear, np.nan)
    limit, slope = (linear if order == 1 else quadratic)[:2]
    first = np.zeros_like(values)
    first[0] = 1.0
    chi_square = float(misfit @ misfit) if freedom and known else math.nan
    return Extrapolation(
        order,
        _combined(limit, values, errors),
        _combined(slope, values, errors),
        _combined(first - limit, values, errors),
        _combined(quadratic[0] - linear[0], values, errors),
        chi_square,
        _chi_square_tail(chi_square, freedom),
    )


def _coefficients(inverse: Floats, weights: Floats, order: int) -> Floats:
    """Return the rows whose products with the means are the fitted coefficients, (order + 1, n).

    `weights` are the errors that the means are weighted by; powers of 1/N are scaled to at most 1.
    """
    scale = inverse.max()
    exponents = np.arange(order + 1)
    powers = (inverse[:, None] / scale) ** exponents
    found = np.linalg.pinv(powers / weights[:, None]) / weights
    return np.asarray(found / scale ** exponents[:, None])


def _combined(row: Floats, values: Floats, errors: Floats) -> Value:
    """Return a linear combination of independent means, with its error."""
    return Value(float(row @ values), float(np.linalg.norm(row * errors)))


def _chi_square_tail(chi_square: float, freedom: int) -> float:
    if math.isnan(chi_square):
        return math.nan
    from scipy.special import chdtrc

    return float(chdtrc(freedom, chi_square))
