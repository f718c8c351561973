"""The covariance of a Gaussian process through many noisy points, by fits of some of them."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, lapack

from agglom_mpi.emulation.gaussian_process import (
    JITTER,
    Covariance,
    covariance_of,
    first_guess,
    matern,
    matern_slope,
    most_likely,
    squared_differences,
    standardised,
)

Floats = NDArray[np.float64]

FITS: Final = 3
"""Fits of a covariance, of random subsets; the most likely by all points is kept."""
SUBSET: Final = 320
"""Points of each of them."""
REFINED: Final = 700
"""Points at most that the most likely one is refined with."""
JUDGED: Final = 1200
"""Points at most by which the most likely one is found."""
EXPECTED_LENGTH, EXPECTED_BESIDE_GROUPS, EXPECTED_OF_GROUPS = 1.0, 2.0, 0.0
"""Expected logarithms of a length over the square root of d, before the data.

Groups of variables decide more, by the laws of a scene, than single variables do. Samples near a
maximum cannot tell a group from a power of one of its variables.
"""
LENGTH_SPREAD: Final = 3.0
"""Variance of these logarithms."""


def fit_covariance_of_many(
    points: Floats,
    values: Floats,
    weights: Floats,
    random: np.random.Generator,
    groups: int = 0,
) -> Covariance:
    """Return the covariance of maximum posterior density, found by several fits of subsets.

    Parameters
    ----------
    points
        Shape (n, d).
    values
        Means observed there, shape (n,).
    weights
        Number of samples of each, or what else the variance of its noise is inverse to, (n,).
    random
        Draws the subsets.
    groups
        How many of the coordinates, the last ones, are groups of variables.
    """
    _, _, standard = standardised(values)
    start, expected = first_guess(points.shape[1]), expected_lengths(points.shape[1], groups)
    if len(points) <= SUBSET:
        data = squared_differences(points), standard, weights, expected
        return covariance_of(most_likely(negative_log_likelihood, start, data, 100))
    found = []
    for _ in range(FITS):
        some = random.permutation(len(points))[:SUBSET]
        data = squared_differences(points[some]), standard[some], weights[some], expected
        found.append(most_likely(negative_log_likelihood, start, data, 60))
    some = random.permutation(len(points))[:JUDGED]
    data = squared_differences(points[some]), standard[some], weights[some], expected
    best = min(found, key=lambda at: negative_log_likelihood(at, *data, slope=False)[0])
    return refined(covariance_of(best), points, values, weights, random, groups)


def refined(
    covariance: Covariance,
    points: Floats,
    values: Floats,
    weights: Floats,
    random: np.random.Generator,
    groups: int,
) -> Covariance:
    """Return a more likely covariance near one; arguments as for `fit_covariance_of_many`."""
    _, _, standard = standardised(values)
    some = random.permutation(len(points))[:REFINED]
    expected = expected_lengths(points.shape[1], groups)
    start = np.log([covariance.variance, *covariance.lengths, covariance.noise])
    data = squared_differences(points[some]), standard[some], weights[some], expected
    return covariance_of(most_likely(negative_log_likelihood, start, data, 15))


def negative_log_likelihood(
    logarithms: Floats,
    squares: Floats,
    values: Floats,
    weights: Floats,
    expected: Floats,
    slope: bool = True,
) -> tuple[float, Floats]:
    """Negative logarithm of likelihood times prior, and its gradient [RW 5.8, 5.9].

    Parameters
    ----------
    logarithms
        Of variance, lengths and noise, shape (d + 2,).
    squares
        Squared differences of the points, shape (d, n, n).
    values, weights
        Standardised means, and what their noise is divided by, shape (n,).
    expected
        Logarithms of the lengths before the data, shape (d,).
    slope
        Whether to compute the gradient, too, which takes most of the time.
    """
    variance, lengths, noise = (
        np.exp(logarithms[0]),
        np.exp(logarithms[1:-1]),
        np.exp(logarithms[-1]),
    )
    flat = squares.reshape(len(lengths), -1)
    r = np.sqrt(lengths**-2.0 @ flat).reshape(squares.shape[1:])
    smooth = variance * matern(r)
    matrix = smooth.copy()
    matrix[np.diag_indices_from(matrix)] += noise / weights + JITTER
    root = cholesky(matrix, lower=True, check_finite=False)
    alpha = cho_solve((root, True), values, check_finite=False)
    prior, prior_slope = _length_prior(logarithms[1:-1] - expected)
    value = 0.5 * values @ alpha + np.log(np.diag(root)).sum() + prior
    if not slope:
        return float(value), np.empty(0)
    # The lower half of the inverse alone: it is summed with symmetric matrices.
    change, _ = lapack.dpotri(root, lower=1, overwrite_c=1)
    change[np.diag_indices_from(change)] *= 0.5
    change -= 0.5 * np.outer(alpha, alpha)
    slopes = change * (variance * matern_slope(r))
    gradient = np.concatenate(
        (
            [np.vdot(change, smooth)],
            flat @ slopes.ravel() / lengths**2 + prior_slope,
            [change.diagonal() @ (noise / weights)],
        )
    )
    return float(value), gradient


def expected_lengths(dimensions: int, groups: int) -> Floats:
    """Return the logarithms of lengths that are expected before the data, shape (d,).

    The last coordinates are the groups.
    """
    own = EXPECTED_BESIDE_GROUPS if groups else EXPECTED_LENGTH
    expected = np.full(dimensions, own + 0.5 * np.log(dimensions))
    expected[dimensions - groups :] += EXPECTED_OF_GROUPS - own
    return expected


def _length_prior(away: Floats) -> tuple[float, Floats]:
    """Negative logarithm of the density of lengths, and its gradient by their logarithms.

    `away` is how far these are from what is expected, shape (d,).

    As that of the search (Hvarfner et al. 2024), but of shorter lengths: with it an influence that
    the data hardly show is not taken for none, so that intervals cover.
    """
    return float((away**2).sum()) / (2.0 * LENGTH_SPREAD), away / LENGTH_SPREAD
