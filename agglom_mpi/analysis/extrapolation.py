"""Extrapolation of means to infinitely many grains: y(N) = limit + slope/N + quadratic/N².

A box without walls has no surface, so that the leading correction of a mean per particle is one of
1/N: the mean of a ratio of sums over N grains, each correlated with few others. The fit is by
weighted least squares, the weights being the inverse squares of the standard errors, and all that
it gives is a linear combination of the means. So its errors follow from theirs without further
assumptions.

With three numbers of grains or more the term 1/N² is always fitted. A line would have a third of
the error, but to take it wherever χ² does not reject it makes the interval of the limit miss in up
to 18 % of cases instead of 5 %, and adding to it what the term would change does not mend that: an
interval that holds for every curvature cannot be much shorter than that of the full model (Leeb and
Pötscher, Econometric Theory 21, 2005, 21). With two numbers of grains the curvature is unknown.
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
    limit
        Mean for infinitely many grains.
    slope
        Coefficient of 1/N.
    quadratic
        Coefficient of 1/N²; 0 for a line.
    shift
        Mean at the first number of grains, as measured, less the limit. Its error allows for the
        mean being among those that are fitted.
    curvature
        Change of the limit of a line by a term 1/N². It is nan below three numbers of grains.
    chi_square, p_value
        Sum of the squared misfits of a line over their standard errors, and the probability of at
        least that if the line holds, of χ² with n - 2 degrees of freedom; nan below three numbers
        of grains.
    """

    limit: Value
    slope: Value
    quadratic: Value
    shift: Value
    curvature: Value
    chi_square: float
    p_value: float

    @property
    def is_linear(self) -> bool:
        """Whether the means are linear in 1/N as far as their errors allow to see."""
        return not self.p_value < POOR_FIT


def extrapolated(
    grains: Sequence[float], means: Sequence[MeanEstimate], order: int = 2
) -> Extrapolation:
    """Fit a polynomial in 1/N to means with known standard errors.

    Parameters
    ----------
    grains
        Different numbers of grains N, (n,), n at least 2; the first is that of the shift.
    means
        Means at these, independent of each other, (n,). If one of their errors is 0, as where
        nothing happens, all have the same weight.
    order
        Highest power of 1/N, 1 or 2; it is 1 for two numbers of grains.
    """
    inverse = 1.0 / np.asarray(grains, np.float64)
    values = np.array([mean.value for mean in means], np.float64)
    errors = np.array([mean.error for mean in means], np.float64)
    known = bool((errors > 0.0).all())
    weights = errors if known else np.ones_like(errors)
    line = np.vstack([_coefficients(inverse, weights, 1), np.zeros_like(values)])
    misfit = (values - line[0] @ values - (line[1] @ values) * inverse) / weights
    freedom = len(values) - 2
    parabola = _coefficients(inverse, weights, 2) if freedom else np.full_like(line, np.nan)
    limit, slope, quadratic = parabola if order == 2 and freedom else line
    first = np.zeros_like(values)
    first[0] = 1.0
    chi_square = float(misfit @ misfit) if freedom and known else math.nan
    return Extrapolation(
        _combined(limit, values, errors),
        _combined(slope, values, errors),
        _combined(quadratic, values, errors),
        _combined(first - limit, values, errors),
        _combined(parabola[0] - line[0], values, errors),
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
