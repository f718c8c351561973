"""Running and pooled means and moments, their standard errors, normal and Student's t.

The moments of all particles are functions of the samples' means of a few numbers: particles left,
and the sums of the powers of their radii. So their standard errors follow from the covariance of
these numbers between samples (the delta method), which is updated in constant time.

`scipy.special` is imported when it is used: to load it takes a quarter of a second.
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
"""Array of numbers."""
Central = tuple[float, float, float]
"""Central moments 2, 3, 4."""


class RunningMean:
    """Mean and standard error of the values so far (Welford, Technometrics 4, 1962, 419).

    Attributes
    ----------
    count, mean
        Number of values so far, and their mean; nan without any.
    squares
        Sum of the squared distances of the values from their mean.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = math.nan
        self.squares = 0.0

    def add(self, value: float) -> None:
        """Add one value."""
        self.count += 1
        if self.count == 1:
            self.mean = value
            return
        step = value - self.mean
        self.mean += step / self.count
        self.squares += step * (value - self.mean)

    def set(self, count: int, mean: float, squares: float = 0.0) -> None:
        """Go on from mean and squares of a number of values, which were computed elsewhere."""
        self.count, self.mean, self.squares = count, mean, squares

    @property
    def standard_error(self) -> float:
        """Standard error of the mean; nan below two values."""
        if self.count < 2:
            return math.nan
        return math.sqrt(self.squares / (self.count - 1) / self.count)


class PooledMoments:
    """Central moments of the members of all groups so far, from each group's own moments.

    The sums of powers about the common mean are combined pairwise by the exact shift formulas
    (Chan, Golub and LeVeque 1979; Pébay 2008), so no member is ever looked at again.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = 0.0
        self._sums = (0.0, 0.0, 0.0)

    def add(self, count: int, mean: float, central: Central) -> None:
        """Add one group.

        Parameters
        ----------
        count
            Its members, at least 1.
        mean, central
            Their mean and central moments 2, 3, 4.
        """
        a, b = self.count, count
        n = a + b
        shift = mean - self.mean
        a2, a3, a4 = self._sums
        b2, b3, b4 = (moment * b for moment in central)
        self._sums = (
            a2 + b2 + shift**2 * a * b / n,
            a3 + b3 + shift**3 * a * b * (a - b) / n**2 + 3 * shift * (a * b2 - b * a2) / n,
            a4
            + b4
            + shift**4 * a * b * (a * a - a * b + b * b) / n**3
            + 6 * shift**2 * (a * a * b2 + b * b * a2) / n**2
            + 4 * shift * (a * b3 - b * a3) / n,
        )
        self.count = n
        self.mean += shift * b / n

    @property
    def central(self) -> tuple[float, float, float]:
        """Central moments 2, 3, 4 of all members [A 24]; needs at least one member."""
        second, third, fourth = self._sums
        return second / self.count, third / self.count, fourth / self.count


class PooledMomentErrors:
    """Standard errors of functions of the pooled moments of particles, by the delta method.

    Keeps means over samples, and the covariance, of (mean b/b⁰, n, S1, S2, S3, S4). S_r is the sum
    over the n particles of a sample of (b/b⁰ − c)^r; c is the mean of the first sample, so that
    little cancels.
    """

    def __init__(self) -> None:
        self._origin = 0.0
        self._of = RunningMeans(6)

    def add(self, particles: int, mean: float, central: Central) -> None:
        """Add one sample: its number of particles, their mean b/b⁰ and central moments 2, 3, 4."""
        if self._of.count == 0:
            self._origin = mean
        self._of.add(self._numbers(particles, mean, central))

    def standard_error(self, slopes: Mapping[str, float], central: Central) -> float:
        """Return the standard error of a function of the moments; needs two samples.

        Parameters
        ----------
        slopes
            Its derivatives by `mean`, the mean over samples, and by the central moments `second`,
            `third` and `fourth` of all particles; a derivative left out is 0.
        central
            These three moments.
        """
        return self._of.standard_error(self._gradient(slopes, central))

    def influence(
        self,
        sample: tuple[int, float, Central],
        slopes: Mapping[str, float],
        central: Central,
    ) -> float:
        """Return the influence of one sample on a function of the moments.

        That is how far the function moves when this sample is added, times the number of samples.

        Parameters
        ----------
        sample
            Particles, mean and central moments, as for `add`.
        slopes, central
            As for `standard_error`.
        """
        away = self._numbers(*sample) - self._of.means
        return float(self._gradient(slopes, central) @ away)

    def _numbers(self, particles: int, mean: float, central: Central) -> Floats:
        second, third, fourth = central
        d = mean - self._origin
        about_origin = (
            d,
            second + d**2,
            third + 3.0 * d * second + d**3,
            fourth + 4.0 * d * third + 6.0 * d**2 * second + d**4,
        )
        return np.array([mean, particles, *(particles * power for power in about_origin)])

    def _gradient(self, slopes: Mapping[str, float], central: Central) -> Floats:
        """Return the derivatives by the six means, shape (6,).

        With D the distance of the common mean from c, the sums about that mean are binomial sums of
        S_r; that mean itself moves with S1 − D n, which changes moment r by −r M_{r−1}.
        """
        m2, m3, m4 = central
        n, distance = self._of.means[1], self._of.means[2] / self._of.means[1]
        a, b, c = (slopes.get(name, 0.0) / n for name in ("second", "third", "fourth"))
        d, d2, d3 = distance, distance**2, distance**3
        return np.array(
            [
                slopes.get("mean", 0.0),
                a * (d2 - m2) + b * (3.0 * d * m2 - d3 - m3) + c * (d2 * d2 + 4.0 * d * m3 - m4),
                -2.0 * a * d + 3.0 * b * (d2 - m2) - 4.0 * c * (d3 + m3),
                a - 3.0 * b * d + 6.0 * c * d2,
                b - 4.0 * c * d,
                c,
            ]
        )


class RunningMeans:
    """Means of several numbers of each sample, and the covariance of these, by Welford's sums.

    Parameters
    ----------
    numbers
        Number of numbers, k.

    Attributes
    ----------
    count
        Number of samples so far.
    means
        Their means, shape (k,); nan without samples.
    """

    def __init__(self, numbers: int) -> None:
        self.count = 0
        self.means = np.full(numbers, math.nan)
        self._products = np.zeros((numbers, numbers))

    def add(self, numbers: ArrayLike) -> None:
        """Add the numbers of one sample, (k,)."""
        values = np.array(numbers, np.float64)
        self.count += 1
        if self.count == 1:
            self.means = values
            return
        step = values - self.means
        self.means = self.means + step / self.count
        self._products += np.outer(step, values - self.means)

    @property
    def standard_errors(self) -> Floats:
        """Standard errors of the means, shape (k,); nan below two samples."""
        return self._errors_of(np.diag(self._products))

    def standard_error(self, gradient: Floats) -> float:
        """Return the standard error of a function of the means by its derivatives, (k,)."""
        return float(self._errors_of(np.asarray(gradient @ self._products @ gradient)))

    def _errors_of(self, squares: Floats) -> Floats:
        if self.count < 2:
            return np.full(np.shape(squares), math.nan)
        return np.sqrt(np.maximum(squares, 0.0) / (self.count - 1) / self.count)


class MeanEstimate(NamedTuple):
    """Mean of `samples` independent values and its standard error, nan for a single one."""

    value: float
    error: float
    samples: int

    @property
    def half_width(self) -> float:
        """Half the 95 % t interval; inf below two samples."""
        return t_95(self.samples - 1) * self.error if self.samples > 1 else math.inf


def mean_of(values: ArrayLike) -> MeanEstimate:
    """Return mean and standard error of independent values, shape (n,); the mean of none is nan."""
    numbers = np.asarray(values, float)
    if numbers.size == 0:
        return MeanEstimate(math.nan, math.nan, 0)
    if numbers.size == 1:
        return MeanEstimate(float(numbers[0]), math.nan, 1)
    error = float(np.std(numbers, ddof=1)) / math.sqrt(numbers.size)
    return MeanEstimate(float(np.mean(numbers)), error, numbers.size)


def too_many_failed(failed: Any, samples: Any) -> Any:
    """Return whether more than 10 % of samples failed, so that their string has no result."""
    return 10 * failed > samples


def without_rounding(value: float, rounding: float) -> float:
    """Return a number, as 0 where its magnitude is at most `rounding`; nan and inf as they are."""
    return 0.0 if abs(value) <= rounding else value


def t_95(degrees_of_freedom: int) -> float:
    """Return the two-sided 95 % quantile of Student's t; see `t_quantile`."""
    return t_quantile(degrees_of_freedom, 0.95)


@cache
def t_quantile(degrees_of_freedom: int, coverage: float) -> float:
    """Return the two-sided quantile t of Student's distribution, P(|T| < t) = coverage.

    Parameters
    ----------
    degrees_of_freedom
        At least 1; one less than the number of samples.
    coverage
        The probability, above 0 and below 1.
    """
    from scipy.special import stdtrit

    return float(stdtrit(degrees_of_freedom, 0.5 + 0.5 * coverage))


def weighted_quantiles(
    values: Floats, weights: Floats, shares: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the values, of some of shape (n,), below which these shares of the weights lie."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) / weights.sum()
    places = np.minimum(np.searchsorted(below, shares), len(values) - 1)
    return tuple(values[order][places].tolist())


MAX_WITHIN: Final = 0.12
"""Largest variance within two groups, over that of all, at which they are apart.

The best split of even values leaves 0.25 of it, of normal ones 0.36.
"""


def gap_between(values: Floats, weights: Floats) -> float | None:
    """Return the number between two groups of weighted values, (n,), that are apart, or None.

    It splits them so that the variance within both groups is smallest (N. Otsu, IEEE Trans. Syst.
    Man Cybern. 9 (1979) 62).
    """
    order = np.argsort(values)
    values, shares = values[order], weights[order] / weights.sum()
    mean = float(shares @ values)
    whole, below = float(shares @ (values - mean) ** 2), np.cumsum(shares)[:-1]
    product = below * (1.0 - below)
    moments = np.cumsum(shares * (values - mean))[:-1]
    between = np.divide(moments**2, product, out=np.zeros_like(below), where=product > 1e-12)
    k = int(np.argmax(between)) if len(between) else 0
    if not len(between) or between[k] <= (1.0 - MAX_WITHIN) * whole:
        return None
    return 0.5 * float(values[k] + values[k + 1])


def probability_between(lower: float, upper: float, mean: Floats, deviation: Floats) -> Floats:
    """Return the probability of normally distributed values to lie between two bounds, (n,).

    Parameters
    ----------
    lower, upper
        Either may be infinite.
    mean, deviation
        Of the values, shape (n,).
    """
    from scipy.special import ndtr

    deviation = np.maximum(deviation, 1e-300)
    return np.asarray(ndtr((upper - mean) / deviation) - ndtr((lower - mean) / deviation))


def t_tails(t: float, degrees_of_freedom: float) -> float:
    """Return P(|T| > t) of Student's distribution, also for fractional degrees of freedom."""
    from scipy.special import stdtr

    return 2.0 * float(stdtr(degrees_of_freedom, -abs(t)))
