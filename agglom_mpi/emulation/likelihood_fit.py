"""Fit of the covariance of a Gaussian process by its posterior density.

The density is that of the data given variance, lengths and noise, times a broad prior of the
lengths. `fit_covariance` takes all points, for searches and sensitivities. `LargeFit` takes
subsets, for an emulator of many points. [RW] is Rasmussen and Williams 2006.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, lapack
from scipy.optimize import minimize

from agglom_mpi.emulation.gaussian_process import (
    JITTER,
    Covariance,
    matern,
    matern_slope,
    standardised,
)
from agglom_mpi.statistics import Floats

LENGTH_BOUNDS: Final = (0.05, 100.0)
"""Bounds of a length in units of the box; a variable with a much longer one has no influence."""

VARIANCE_BOUNDS: Final = (1e-2, 1e2)
"""Bounds of the variance of the function, in units of the variance of the values."""

NOISE_BOUNDS: Final = (1e-5, 1e2)
"""Bounds of the variance of one sample, in the same units."""

LITTLE_NOISE: Final = 1e-3
"""A second fit, to means that jump, begins with this variance of one sample, in the same units."""

LOG_LENGTH_VARIANCE: Final = 3.0
"""Prior variance of the logarithm of a length."""

LOG_LENGTH: Final = 1.0
"""Prior mean of the logarithm of a length over √d, in an emulator without groups of variables."""

LOG_LENGTH_BESIDE_GROUPS, LOG_LENGTH_OF_GROUPS = 2.0, 0.0
"""The same for a single variable and for a group, in an emulator with groups of variables.

Groups of variables decide more, by the laws of a scene, than single variables do. Samples near a
maximum cannot tell a group from a power of one of its variables.
"""

SUBSET_FITS: Final = 3
"""Number of random subsets of many points that a covariance is fitted to."""
SUBSET_SIZE: Final = 320
"""Maximum number of points in a subset."""
MAX_COMPARED_POINTS: Final = 1200
"""Maximum number of points by which the fits of the subsets are compared."""
MAX_REFINED_POINTS: Final = 700
"""Maximum number of points by which the best of these fits is refined."""


LengthPrior = tuple[Floats | float, ...]
"""Normal prior of the logarithms of d lengths, with the variance `LOG_LENGTH_VARIANCE`.

These are terms whose sum is the mean, each a number or of shape (d,). They are subtracted one by
one, because the order decides the last bits of the fits that recorded searches rest on.
"""


def negative_log(prior: LengthPrior, logarithms: Floats) -> tuple[float, Floats]:
    """Return the negative logarithm of the density at (d,), and its gradient, (d,)."""
    away = logarithms
    for term in prior:
        away = away - term
    return float((away**2).sum()) / (2.0 * LOG_LENGTH_VARIANCE), away / LOG_LENGTH_VARIANCE


def search_prior(dimensions: int) -> LengthPrior:
    """Return the prior of a search, as Hvarfner, Hellsten and Nardi (2024).

    It grows with the square root of d, so that a few points in many dimensions are not fitted by
    noise alone.
    """
    return math.sqrt(2.0), 0.5 * math.log(dimensions)


def emulator_prior(dimensions: int, groups: int) -> LengthPrior:
    """Return the prior of an emulator, whose last coordinates are groups of variables.

    It expects shorter lengths than that of a search, so that an influence that the data hardly show
    is not taken for none, and intervals cover.
    """
    own = LOG_LENGTH_BESIDE_GROUPS if groups else LOG_LENGTH
    expected = np.full(dimensions, own + 0.5 * np.log(dimensions))
    expected[dimensions - groups :] += LOG_LENGTH_OF_GROUPS - own
    return (expected,)


def covariance_of(logarithms: Floats) -> Covariance:
    """Return the covariance of the logarithms of variance, lengths and noise, shape (d + 2,)."""
    best = np.exp(logarithms)
    return Covariance(float(best[0]), best[1:-1], float(best[-1]))


class FitData(NamedTuple):
    """Data of a fit.

    Attributes
    ----------
    squares
        Squared differences of the points in each coordinate, shape (d, n, n).
    values
        Standardised means, shape (n,).
    weights
        Numbers of samples, or other numbers that the variance of the noise is inversely
        proportional to, shape (n,).
    prior
    is_recorded
        Whether to compute as searches do, which are resumed and replayed to the last bit. Emulators
        use the lower half of the inverse matrix, in a third of the time: the formulas are the same,
        the last bits are not.
    """

    squares: Floats
    values: Floats
    weights: Floats
    prior: LengthPrior
    is_recorded: bool


def fit_data(
    points: Floats, standard: Floats, weights: Floats, prior: LengthPrior, is_recorded: bool
) -> FitData:
    """Return the data of a fit to standardised means, (n,), at points, (n, d)."""
    squares = np.asarray((points.T[:, :, None] - points.T[:, None, :]) ** 2)
    return FitData(squares, np.asarray_chkfinite(standard), weights, prior, is_recorded)


def negative_log_posterior(
    logarithms: Floats, data: FitData, gradient: bool = True
) -> tuple[float, Floats]:
    """Return the negative logarithm of likelihood times prior, and its gradient [RW 5.8, 5.9].

    Parameters
    ----------
    logarithms
        Logarithms of variance, lengths and noise, shape (d + 2,).
    data
    gradient
        Whether to compute the gradient, (d + 2,), which takes most of the time; otherwise it is
        empty.
    """
    variance, lengths, noise = covariance_of(logarithms)
    if data.is_recorded:
        variance, noise = math.exp(logarithms[0]), math.exp(logarithms[-1])
        lengths = np.exp(logarithms[1:-1])
    squares = data.squares.reshape(len(lengths), -1)
    r = np.sqrt(lengths**-2.0 @ squares).reshape(data.squares.shape[1:])
    smooth = variance * matern(r)
    matrix = smooth.copy()
    matrix[np.diag_indices_from(matrix)] += noise / data.weights + JITTER
    root = cholesky(matrix, lower=True, check_finite=False)
    weights = cho_solve((root, True), data.values, check_finite=False)
    prior, prior_slope = negative_log(data.prior, logarithms[1:-1])
    value = 0.5 * data.values @ weights + np.log(np.diag(root)).sum() + prior
    if not gradient:
        return float(value), np.empty(0)
    # Derivatives by the covariance matrix [RW 5.9], but for an antisymmetric matrix.
    if data.is_recorded:
        inverse = cho_solve((root, True), np.eye(len(root)), check_finite=False)
        slopes = np.asarray(0.5 * (inverse - np.outer(weights, weights)))
        by_variance = float((slopes * smooth).sum())
    else:
        slopes, _ = lapack.dpotri(root, lower=1, overwrite_c=1)
        slopes[np.diag_indices_from(slopes)] *= 0.5
        slopes -= 0.5 * np.outer(weights, weights)
        by_variance = float(np.vdot(slopes, smooth))
    by_distance = slopes * (variance * matern_slope(r))
    parts = (
        [by_variance],
        squares @ by_distance.ravel() / lengths**2 + prior_slope,
        [slopes.diagonal() @ (noise / data.weights)],
    )
    return float(value), np.concatenate(parts)


def most_probable(start: Floats, data: FitData, iterations: int) -> Floats:
    """Return the logarithms, (d + 2,), within their bounds at which the density is greatest.

    Parameters
    ----------
    start
        Logarithms to start from, shape (d + 2,); clipped to the bounds.
    data
    iterations
        Maximum number of iterations.
    """
    bounds = np.log([VARIANCE_BOUNDS, *[LENGTH_BOUNDS] * (len(start) - 2), NOISE_BOUNDS])
    found = minimize(
        negative_log_posterior,
        np.clip(start, *bounds.T),
        (data,),
        jac=True,
        bounds=bounds,
        method="L-BFGS-B",
        options={"maxiter": iterations},
    )
    return np.asarray(found.x)


def first_guess(dimensions: int, noise: float = 0.3) -> Floats:
    """Return the logarithms of variance, lengths and noise that a fit starts from, (d + 2,)."""
    return np.asarray(np.log([1.0, *np.full(dimensions, math.sqrt(dimensions)), noise]))


def fit_covariance(
    points: Floats, values: Floats, samples: NDArray[np.int64], jumps: bool = False
) -> Covariance:
    """Return the most probable covariance by all points, with the prior and bits of a search.

    Parameters
    ----------
    points
        Points in the unit cube, shape (n, d).
    values
        Observed mean at each point, shape (n,).
    samples
        Number of samples of each mean, shape (n,).
    jumps
        Whether means jump, as to failed strings: a fit that begins with much noise may take jumps
        for noise, and another one begins with little.
    """
    _, _, standard = standardised(values)
    d = points.shape[1]
    data = fit_data(points, standard, samples.astype(np.float64), search_prior(d), True)
    found = most_probable(first_guess(d), data, 100)
    if jumps:
        other = most_probable(first_guess(d, LITTLE_NOISE), data, 100)
        found = min(
            found, other, key=lambda at: negative_log_posterior(at, data, gradient=False)[0]
        )
    return covariance_of(found)


class LargeFit(NamedTuple):
    """Points of an emulator that a covariance is fitted to.

    Attributes
    ----------
    points
        Shape (n, d).
    values
        Observed mean at each point, shape (n,).
    weights
        Number of samples of each mean, or another number that the variance of its noise is
        inversely proportional to, shape (n,).
    random
        Stream by which subsets are drawn.
    groups
        Number of coordinates, the last ones, that are groups of variables.
    """

    points: Floats
    values: Floats
    weights: Floats
    random: np.random.Generator
    groups: int = 0

    def fitted(self) -> Covariance:
        """Return the most probable covariance, found by fits of several subsets."""
        start = first_guess(self.points.shape[1])
        if len(self.points) <= SUBSET_SIZE:
            return covariance_of(most_probable(start, self._data(), 100))
        found = [
            most_probable(start, self._data(self._subset(SUBSET_SIZE)), 60)
            for _ in range(SUBSET_FITS)
        ]
        compared = self._data(self._subset(MAX_COMPARED_POINTS))
        best = min(found, key=lambda at: negative_log_posterior(at, compared, gradient=False)[0])
        return self.refined(covariance_of(best))

    def refined(self, covariance: Covariance) -> Covariance:
        """Return a more probable covariance near another one."""
        start = np.log([covariance.variance, *covariance.lengths, covariance.noise])
        data = self._data(self._subset(MAX_REFINED_POINTS))
        return covariance_of(most_probable(start, data, 15))

    def _subset(self, most: int) -> NDArray[np.int64]:
        return self.random.permutation(len(self.points))[:most]

    def _data(self, some: NDArray[np.int64] | slice = slice(None)) -> FitData:
        _, _, standard = standardised(self.values)
        prior = emulator_prior(self.points.shape[1], self.groups)
        return fit_data(self.points[some], standard[some], self.weights[some], prior, False)
