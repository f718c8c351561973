"""The factor between a standard error and a confidence interval: Student's t."""

import math
from functools import cache
from statistics import NormalDist
from typing import Final

_ASYMPTOTIC: Final = 200


def t_95(freedom: int) -> float:
    """Return the two-sided 95 % quantile of Student's t; see `t_quantile`."""
    return t_quantile(freedom, 0.95)


@cache
def t_quantile(freedom: int, coverage: float) -> float:
    """Return the t with |T| < t at a probability, to nine digits or better.

    Parameters
    ----------
    freedom
        Degrees of freedom, at least 1: one less than the number of samples.
    coverage
        The probability, above 0 and below 1.
    """
    normal = NormalDist().inv_cdf(0.5 + 0.5 * coverage)
    t = _expansion(freedom, normal)
    if freedom > _ASYMPTOTIC:
        return t
    # The coverage is concave in t: from below, Newton's steps cannot run away.
    if t > 2.0 * normal and _coverage(t, freedom) > coverage:
        t = normal
    for _ in range(500):
        step = (coverage - _coverage(t, freedom)) / _slope(t, freedom)
        t += step
        if abs(step) <= 1e-14 * t:
            break
    return t


def _expansion(freedom: int, x: float) -> float:
    """Large-freedom expansion about the normal quantile x (Abramowitz and Stegun 26.7.5)."""
    terms = (
        x,
        (x**3 + x) / 4,
        (5 * x**5 + 16 * x**3 + 3 * x) / 96,
        (3 * x**7 + 19 * x**5 + 17 * x**3 - 15 * x) / 384,
        (79 * x**9 + 776 * x**7 + 1482 * x**5 - 1920 * x**3 - 945 * x) / 92160,
    )
    return sum(term / freedom**power for power, term in enumerate(terms))


def _coverage(t: float, freedom: int) -> float:
    """Probability of |T| < t, a finite sum (Abramowitz and Stegun 26.7.3, 26.7.4)."""
    angle = math.atan(t / math.sqrt(freedom))
    odd = freedom % 2
    square = math.cos(angle) ** 2
    term = math.cos(angle) if odd else 1.0
    total = 0.0
    for k in range(2 + odd, freedom + 1, 2):
        total += term
        term *= square * (k - 1) / k
    total *= math.sin(angle)
    return 2 / math.pi * (angle + total) if odd else total


def _slope(t: float, freedom: int) -> float:
    """Twice the density of Student's t."""
    log_scale = math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2)
    log_shape = -(freedom + 1) / 2 * math.log1p(t * t / freedom)
    return 2 * math.exp(log_scale + log_shape) / math.sqrt(freedom * math.pi)
