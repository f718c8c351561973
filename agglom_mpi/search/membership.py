"""Whether a string is right, by fresh samples of it, and what many such decisions prove.

**One string.** It is *right* if the means of its samples meet the criterion of a set. The samples
are judged at a few numbers of them, the looks. At a look it is decided to be right if the
one-sided intervals of all compared means end within their bounds, and wrong if one begins beyond
a bound. Each interval is Student's with the error α_t/L, L being the number of looks (Bonferroni).
A wrong string has a mean beyond some bound, so to be taken for right it needs an error of that
interval at some look: the probability is at most α_t for normal samples. The skewness of others
makes it larger: 0.028 instead of 0.02 for the skewness 1 of [A]'s samples, 0.048 for the 2 of an
exponential distribution. So all that follows counts with α_d = 0.05. A right string is taken for
wrong with at most s·α_d, s being the number of finite bounds. A string that is undecided at the
last look, or more than 10 % of whose samples failed, does not count as right. Means of functions
have the error of the jackknife (Tukey 1958).

**Many strings.** n strings are drawn evenly from a part of the box, of which a share f is right,
and k of them are decided to be right. These decisions are independent, and each has the
probability q ≤ f + (1 − f)·α_d. Clopper and Pearson (Biometrika 26, 1934, 404) bound q from below
by q₋(k, n) with any confidence, so with the same confidence

    f ≥ (q₋ − α_d) / (1 − α_d).

Likewise strings that are not decided to be wrong, m of them, have q ≥ f·(1 − s·α_d), so that
f ≤ q₊(m, n) / (1 − s·α_d). Both need one look at one number n of strings that was fixed before.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.criteria import Criterion
from agglom_mpi.statistics import t_quantile

Floats = NDArray[np.float64]

FIRST_LOOK: Final = 40
"""Number of samples at the first look; each further look has twice as many."""
TEST_ERROR: Final = 0.02
"""Largest probability α_t that normal samples decide a wrong string to be right."""
DECISION_ERROR: Final = 0.05
"""Largest probability α_d that samples do so, as bounds count with it."""
MOST_STRINGS: Final = 10**6
"""Maximum number of strings that is considered."""


class Verdict(IntEnum):
    """What is decided of a string."""

    UNDECIDED = 0
    RIGHT = 1
    WRONG = 2


def looks_until(most: int) -> tuple[int, ...]:
    """Return the numbers of samples at which a string is judged, the last one being `most`."""
    looks, count = [], FIRST_LOOK
    while count < most:
        looks.append(count)
        count *= 2
    return (*looks, most)


class MembershipTest(NamedTuple):
    """The sequential test of one string.

    Attributes
    ----------
    criterion
        What makes a string right.
    looks
        Numbers of samples at which it is judged, ascending.
    """

    criterion: Criterion
    looks: tuple[int, ...]

    def verdict(self, numbers: Floats, failed: int) -> Verdict:
        """Return what the samples so far decide; without a look nothing.

        Parameters
        ----------
        numbers
            Numbers of the completed samples that the criterion compares, shape (n, k).
        failed
            Number of samples that failed.
        """
        samples = len(numbers) + failed
        if 10 * failed > samples:
            return Verdict.WRONG
        if samples not in self.looks or len(numbers) < 2:
            return Verdict.UNDECIDED
        mean, error = compared_means(self.criterion, numbers)
        half = self.factor(len(numbers)) * error
        lower, upper = np.array(self.criterion.bands()).T
        if np.all((mean - half >= lower) & (mean + half <= upper)):
            return Verdict.RIGHT
        if np.any((mean + half < lower) | (mean - half > upper)):
            return Verdict.WRONG
        return Verdict.UNDECIDED

    def factor(self, completed: int) -> float:
        """Return Student's t of the one-sided intervals of so many completed samples."""
        return t_quantile(completed - 1, 1.0 - 2.0 * TEST_ERROR / len(self.looks))

    @property
    def error_of_right(self) -> float:
        """Largest probability that a right string is decided to be wrong."""
        sides = sum(math.isfinite(end) for band in self.criterion.bands() for end in band)
        return min(1.0, sides * DECISION_ERROR)


def compared_means(criterion: Criterion, numbers: Floats) -> tuple[Floats, Floats]:
    """Return what a criterion compares of n > 1 samples, and its standard errors, shape (q,) each.

    Parameters
    ----------
    criterion
    numbers
        Its numbers of the samples, shape (n, k).
    """
    n, total = len(numbers), numbers.sum(axis=0)
    whole = criterion.compared(total[None] / n)
    pseudo = n * whole - (n - 1) * criterion.compared((total - numbers) / (n - 1))
    return pseudo.mean(axis=0), pseudo.std(axis=0, ddof=1) / math.sqrt(n)


def least_share(right: int, strings: int, confidence: float, error: float) -> float:
    """Return the lower bound of the share of a part that is right.

    Parameters
    ----------
    right, strings
        Strings that were decided to be right, of how many.
    confidence
        Of the bound, between 0 and 1.
    error
        Largest probability that a wrong string is decided to be right.
    """
    from scipy.special import betaincinv  # takes long to load

    if right == 0:
        return 0.0
    bound = float(betaincinv(right, strings - right + 1, 1.0 - confidence))
    return max(0.0, (bound - error) / (1.0 - error))


def largest_share(possible: int, strings: int, confidence: float, error: float) -> float:
    """Return the upper bound of the share of a part that is right.

    Parameters
    ----------
    possible, strings
        Strings that were not decided to be wrong, of how many.
    confidence
        Of the bound, between 0 and 1.
    error
        Largest probability that a right string is decided to be wrong.
    """
    from scipy.special import betaincinv

    if possible == strings or error >= 1.0:
        return 1.0
    bound = float(betaincinv(possible + 1, strings - possible, confidence))
    return min(1.0, bound / (1.0 - error))


def right_needed(strings: int, claim: float, confidence: float, error: float) -> int | None:
    """Return how many of n strings must be decided to be right for a claim; None: n are too few."""
    counts = range(strings + 1)
    right = bisect_left(counts, claim, key=lambda k: least_share(k, strings, confidence, error))
    return right if right in counts else None


def strings_needed(share: float, claim: float, confidence: float, error: float) -> int | None:
    """Return how many strings show a claim if this share of them is decided to be right.

    None if `MOST_STRINGS` do not.
    """

    def enough(strings: int) -> bool:
        right = math.floor(share * strings + 1e-9)
        return least_share(right, strings, confidence, error) >= claim

    high = 1
    while not enough(high):
        high *= 2
        if high > MOST_STRINGS:
            return None
    return bisect_left(range(high), True, high // 2 + 1, key=enough)


def chance_to_show(needed: int, strings: int, shares: Floats | Sequence[float]) -> Floats:
    """Return the probability that at least so many of n strings come out right, by their share."""
    from scipy.special import betainc

    return np.asarray(betainc(needed, strings - needed + 1, np.asarray(shares, np.float64)))
