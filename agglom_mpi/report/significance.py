"""Which means differ: a t test of every pair, Welch's or paired, corrected by Holm."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

from agglom_mpi.search.mean import Mean

LEVEL: Final = 0.05
"""Chance that any of several equal means is said to differ from another."""


def differ(
    means: Sequence[Mean], differences: Mapping[tuple[int, int], Mean] | None = None
) -> set[tuple[int, int]]:
    """Pairs of places, the lower first, of means that differ at 95 %.

    All pairs count in the correction (Holm 1979), so that it holds for comparisons with the best
    one, too, though the data say which one that is.

    Parameters
    ----------
    means
        Of samples that are independent of those of the others, unless there are `differences`.
    differences
        Of each pair of means, over samples that are paired.
    """
    pairs = list(combinations(range(len(means)), 2))
    if differences is None:
        chances = {(i, j): p_value(means[i], means[j]) for i, j in pairs}
    else:
        chances = {pair: paired_p_value(differences[pair]) for pair in pairs}
    tested = sorted((chance, pair) for pair, chance in chances.items())
    found: set[tuple[int, int]] = set()
    for left, (chance, pair) in zip(range(len(tested), 0, -1), tested, strict=True):
        if chance > LEVEL / left:
            break
        found.add(pair)
    return found


def p_value(one: Mean, other: Mean) -> float:
    """Two-sided chance of such a difference of equal means (Welch 1947)."""
    variances = one.error**2, other.error**2
    total = sum(variances)
    difference = abs(one.value - other.value)
    if total == 0.0:
        return 1.0 if difference == 0.0 else 0.0
    shares = (variances[0] / total) ** 2, (variances[1] / total) ** 2
    freedom = 1.0 / (shares[0] / (one.samples - 1) + shares[1] / (other.samples - 1))
    return beyond(difference / math.sqrt(total), freedom)


def paired_p_value(difference: Mean) -> float:
    """Two-sided chance of such a mean difference of pairs of samples if there is none.

    It is right however the samples of a pair depend on each other; less than two tell nothing.
    """
    value, error, samples = difference
    if samples < 2:
        return 1.0
    if error == 0.0:
        return 1.0 if value == 0.0 else 0.0
    return beyond(abs(value) / error, samples - 1.0)


def beyond(t: float, freedom: float) -> float:
    """Probability of |T| > t in Student's distribution, also for fractional freedom.

    It is the regularised incomplete beta function I_x(ν/2, 1/2) at x = ν/(ν + t²).
    """
    if t == 0.0:
        return 1.0
    a, b = 0.5 * freedom, 0.5
    x, rest = freedom / (freedom + t * t), t * t / (freedom + t * t)
    scale = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
    front = math.exp(scale + a * math.log1p(-rest) + b * math.log(rest))
    if x < (a + 1.0) / (a + b + 2.0):
        return front * _fraction(x, a, b) / a
    return 1.0 - front * _fraction(rest, b, a) / b


def _fraction(x: float, a: float, b: float) -> float:
    """Evaluate the continued fraction of the incomplete beta function by Lentz's method.

    It is Abramowitz and Stegun 26.5.8, and converges fast for x < (a + 1)/(a + b + 2).
    """
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    value = d
    for m in range(1, 1000):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        for term in (even, odd):
            d = 1.0 / (1.0 + term * d)
            c = 1.0 + term / c
            value *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return value
