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
Four numbers of grains or more test the parabola, too; a rejected one has no limit.

Errors of a few samples are uncertain themselves, and weights by them more so. The variance of a
mean falls as 1/N, so that all means then share one spread, and intervals are those of Student's t.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import value_with_error
from agglom_mpi.statistics import Floats, MeanEstimate

POOR_FIT: Final = 0.05
"""Probability of a misfit at least as large below which a line or parabola in 1/N is rejected."""
FEW_SAMPLES: Final = 30
"""Number of samples of a mean below which all means share one spread of a sample."""


class Value(MeanEstimate):
    """Number with its standard error; `samples` are the degrees of freedom of that error plus 1."""

    @property
    def is_resolved(self) -> bool:
        """Whether the number is more than two standard errors and `half_width` from 0."""
        return abs(self.value) > max(2.0 * self.error, self.half_width)

    @property
    def text(self) -> str:
        """Number and standard error for readers."""
        return value_with_error(self.value, self.error)


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
    parabola_p_value
        The same probability of a parabola, with n - 3 degrees of freedom; nan below four.
    """

    limit: Value
    slope: Value
    quadratic: Value
    shift: Value
    curvature: Value
    chi_square: float
    p_value: float
    parabola_p_value: float

    @property
    def is_linear(self) -> bool:
        """Whether the means are linear in 1/N as far as their errors allow to see."""
        return not self.p_value < POOR_FIT

    @property
    def has_limit(self) -> bool:
        """Whether there are a limit and a shift; they are nan otherwise."""
        return math.isfinite(self.limit.value)


def extrapolated(
    grains: Sequence[float],
    means: Sequence[MeanEstimate],
    order: int = 2,
    fitted: Sequence[bool] | None = None,
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
    fitted
        Which means the fit rests on, (n,); None: all. Where some are left out, a limit takes more
        than `order` of the others.
    """
    inverse = 1.0 / np.asarray(grains, np.float64)
    values = np.array([mean.value for mean in means], np.float64)
    used = np.ones(len(values), np.bool_) if fitted is None else np.asarray(fitted, np.bool_)
    enough = bool(used.all()) or int(used.sum()) > order
    used |= not enough
    errors, of_errors = _errors(inverse, means, used)
    known = bool((errors[used] > 0.0).all())
    # A mean of infinite error has no weight in a fit.
    weights = np.where(used, errors if known else 1.0, np.inf)
    freedom = int(used.sum()) - 2
    line = np.vstack([_coefficients(inverse, weights, 1), np.zeros_like(values)])
    parabola = np.full_like(line, np.nan)
    if freedom:
        parabola = _coefficients(inverse, weights, 2)

    def misfit(rows: Floats, freedom: int) -> tuple[float, float]:
        constant, linear, square = rows @ values
        away = (values - constant - linear * inverse - square * inverse**2) / weights
        chi_square = float(away @ away) if freedom > 0 and known else math.nan
        return chi_square, _misfit_tail(chi_square, freedom, of_errors)

    def combined(row: Floats) -> Value:
        return Value(float(row @ values), float(np.linalg.norm(row * errors)), of_errors + 1)

    chi_square, p_value = misfit(line, freedom)
    _, parabola_p_value = misfit(parabola, freedom - 1)
    chosen = parabola if order == 2 and freedom else line
    if not enough or (order == 2 and parabola_p_value < POOR_FIT):
        chosen = np.full_like(line, np.nan)
    first = np.zeros_like(values)
    first[0] = 1.0
    limit, slope, quadratic = chosen
    return Extrapolation(
        combined(limit),
        combined(slope),
        combined(quadratic),
        combined(first - limit),
        combined(parabola[0] - line[0]),
        chi_square,
        p_value,
        parabola_p_value,
    )


def _errors(
    inverse: Floats, means: Sequence[MeanEstimate], used: NDArray[np.bool_]
) -> tuple[Floats, int]:
    """Return the standard errors of means, (n,), and the degrees of freedom of these errors.

    `inverse` is 1/N; the means that are used decide a common spread.
    """
    errors = np.array([mean.error for mean in means], np.float64)
    samples = np.array([mean.samples for mean in means], np.int64)
    freedom = samples - 1
    if (samples[used] >= FEW_SAMPLES).all():
        return errors, int(freedom[used].min())
    variances = (errors**2 * samples / inverse)[used]
    pooled = np.average(variances, weights=freedom[used])
    return np.sqrt(pooled * inverse / samples), int(freedom[used].sum())


def _coefficients(inverse: Floats, weights: Floats, order: int) -> Floats:
    """Return the rows whose products with the means are the fitted coefficients, (order + 1, n).

    `weights` are the errors that the means are weighted by; powers of 1/N are scaled to at most 1.
    """
    scale = inverse.max()
    exponents = np.arange(order + 1)
    powers = (inverse[:, None] / scale) ** exponents
    found = np.linalg.pinv(powers / weights[:, None]) / weights
    return np.asarray(found / scale ** exponents[:, None])


def _misfit_tail(chi_square: float, freedom: int, of_errors: int) -> float:
    """Return the probability of at least a sum of squared misfits, by χ² or, with few samples, F.

    `of_errors` are the degrees of freedom of the errors.
    """
    if math.isnan(chi_square):
        return math.nan
    from scipy.special import chdtrc, fdtrc

    if of_errors >= FEW_SAMPLES - 1:
        return float(chdtrc(freedom, chi_square))
    return float(fdtrc(freedom, of_errors, chi_square / freedom))
