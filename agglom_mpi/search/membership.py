"""Whether a string is right, by fresh samples of it, and what many such decisions prove.

**One string.** It is *right* if the means of its completed samples meet the criterion of a set, and
at most 10 % of its samples fail. The samples are judged at a few numbers of them, the looks. At a
look the string is decided to be right if the one-sided intervals of all compared means end within
their bounds, and wrong if one begins beyond a bound. Each interval is Student's with the error
α_t/L, L being the number of looks (Bonferroni). Means of functions have the error of the jackknife
(Tukey 1958).

Student's interval fails for samples that take few values: until a rare outcome is seen, the
interval has no width. So it is taken again with `EXTRA_SAMPLES` = 2 made-up samples added, once for
each of the extreme outcomes, and the union of all these intervals counts. Agresti and Coull
(American Statistician 52, 1998, 119) add two samples of each kind to binomial ones for the same
reason. Let an extreme outcome of a small probability p be seen u times in n samples, and all others
be near one value. The upper end of the interval of p is

    p₊ = (u + 2 + t √(u + 2)) / n,

that is 5.6/n, 7.4/n, 9.1/n, 13.7/n and 20.8/n for u = 0, 1, 2, 5, 10, and t = 2.53 of seven looks.
The exact upper ends of Poisson's distribution at the error of that t are 5.2/n, 7.3/n, 9.1/n,
13.9/n and 21.2/n. Student's alone are 0, 3.5/n, 5.6/n, 10.7/n and 18/n. Samples that are 0 or 1
with a mean at the bound, from 0.0025 to 0.9, and the sums of such and normal ones, were taken for
right in at most 3.1 % of up to 12,000 simulations for one look and up to nine.

The extreme outcomes are the samples with the least and greatest numbers, of all samples of the
campaign and of the string itself. It is assumed that no rare outcome of the string is far beyond
them: no test can exclude a rare outcome of any size.

A wrong string has a mean beyond some bound, so to be taken for right it needs an error of that
interval at some look: the probability is at most α_t for normal samples, and was at most 0.020 for
gamma distributions with the skewness 1 of [A]'s samples and the 2 of an exponential one. All that
follows counts with α_d = 0.05.

The test of failures is binomial. At look i, a string is right only if a probability to fail of
0.1 gives as few failures as were seen with a probability of at most α_d/2^i, and wrong if it gives
as many with at most that; the last look has what is left of α_d. The first of several looks, at 40
samples, allows no failure for a right string, and nine make a wrong one.

A right string is taken for wrong with at most (s + 1)·α_d, s being the number of finite bounds. A
string that is undecided at the last look does not count as right.

**Many strings.** n strings are drawn evenly from a part of the box, of which a share f is right,
and k of them are decided to be right. These decisions are independent, and each has the
probability q ≤ f + (1 − f)·α_d. Clopper and Pearson (Biometrika 26, 1934, 404) bound q from below
by q₋(k, n) with any confidence, so with the same confidence

    f ≥ (q₋ − α_d) / (1 − α_d).

Likewise strings that are not decided to be wrong, m of them, have q ≥ f·(1 − (s + 1)·α_d), so
that f ≤ q₊(m, n) / (1 − (s + 1)·α_d). Both need one look at one number n of strings that was fixed
before.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.search.criteria import Criterion
from agglom_mpi.statistics import Floats, t_quantile

FIRST_LOOK: Final = 40
"""Number of samples at the first look; each further look has twice as many."""
TEST_ERROR: Final = 0.04
"""Largest probability α_t that normal samples decide a wrong string to be right."""
DECISION_ERROR: Final = 0.05
"""Largest probability α_d that samples do so, as bounds count with it."""
EXTRA_SAMPLES: Final = 2
"""Number of made-up samples of an extreme outcome that an interval is taken with."""
MAX_FAILING: Final = 0.1
"""Maximum probability to fail of a sample of a right string."""
MOST_STRINGS: Final = 10**6
"""Maximum number of strings that is considered."""


class Verdict(IntEnum):
    """Decision on a string."""

    UNDECIDED = 0
    RIGHT = 1
    WRONG = 2


def looks_until(most: int) -> tuple[int, ...]:
    """Return the numbers of samples at which a string is tested, the last one being `most`."""
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
        Numbers of samples at which it is tested, ascending.
    extremes
        Numbers of the samples that are extreme among all that are known, shape (m, k).
    """

    criterion: Criterion
    looks: tuple[int, ...]
    extremes: Floats

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
        if samples not in self.looks:
            return Verdict.UNDECIDED
        fewer, more = failing_tails(failed, samples)
        error = self.error_at(samples)
        if more <= error:
            return Verdict.WRONG
        if len(numbers) < 2:
            return Verdict.UNDECIDED
        low, high = self.interval(numbers)
        lower, upper = np.array(self.criterion.bands()).T
        if np.any((high < lower) | (low > upper)):
            return Verdict.WRONG
        if fewer <= error and np.all((low >= lower) & (high <= upper)):
            return Verdict.RIGHT
        return Verdict.UNDECIDED

    def interval(self, numbers: Floats) -> tuple[Floats, Floats]:
        """Return both ends of the intervals of the compared means of n > 1 samples, (q,) each.

        Parameters
        ----------
        numbers
            Their numbers, shape (n, k).
        """
        factor = self.factor(len(numbers))
        known = extreme_numbers(np.vstack((self.extremes, numbers)))
        added = (np.tile(row, (EXTRA_SAMPLES, 1)) for row in known)
        sets = (numbers, *(np.vstack((numbers, rows)) for rows in added))
        means, errors = map(
            np.array, zip(*(compared_means(self.criterion, each) for each in sets), strict=True)
        )
        return (means - factor * errors).min(axis=0), (means + factor * errors).max(axis=0)

    def margin(self, completed: int, means: Floats, noise: Floats) -> Floats:
        """Return how far means must be from a bound to be decided, shape (..., q).

        Parameters
        ----------
        completed
            Number of completed samples.
        means, noise
            Expected means, and standard deviations of a sample, shape (..., q). The criterion
            compares the means of the numbers themselves.
        """
        n, away = completed + EXTRA_SAMPLES, np.zeros_like(means)
        for row in self.extremes:
            away = np.maximum(away, np.abs(row - means))
        error = np.sqrt(completed * noise**2 + EXTRA_SAMPLES * away**2) / n
        return np.asarray(EXTRA_SAMPLES * away / n + self.factor(completed) * error)

    def factor(self, completed: int) -> float:
        """Return Student's t of the one-sided intervals, by the number of completed samples."""
        return t_quantile(completed - 1, 1.0 - 2.0 * TEST_ERROR / len(self.looks))

    def error_at(self, look: int) -> float:
        """Return the error that the test of failures may have at a look."""
        place = self.looks.index(look)
        return DECISION_ERROR / 2 ** min(place + 1, len(self.looks) - 1)

    @property
    def error_of_right(self) -> float:
        """Largest probability that a right string is decided to be wrong."""
        sides = sum(math.isfinite(end) for band in self.criterion.bands() for end in band)
        return min(1.0, (sides + 1) * DECISION_ERROR)


def extreme_numbers(numbers: Floats) -> Floats:
    """Return the samples, (m, k), that have the least or greatest of some number, of (n, k)."""
    finite = numbers[np.isfinite(numbers).all(axis=1)]
    if not len(finite):
        return finite
    return finite[np.unique((finite.argmin(axis=0), finite.argmax(axis=0)))]


def failing_tails(failed: int, samples: int) -> tuple[float, float]:
    """Return the probability of at most, and of at least, so many failures at `MAX_FAILING`."""
    from scipy.special import bdtr, bdtrc

    at_least = float(bdtrc(failed - 1, samples, MAX_FAILING)) if failed else 1.0
    return float(bdtr(failed, samples, MAX_FAILING)), at_least


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
    """Return the probability that at least `needed` of n strings come out right, by their share."""
    from scipy.special import betainc

    return np.asarray(betainc(needed, strings - needed + 1, np.asarray(shares, np.float64)))
