"""Gaussian-process regression of noisy means (Rasmussen and Williams 2006, "RW" below).

f has the covariance v·m(r) with the Matérn-5/2 form m(r) = (1 + √5 r + 5r²/3) exp(-√5 r) [RW 4.17],
where r² = Σ (Δx_d/ℓ_d)²: each variable has its own length. The mean of n samples of f is observed
with a noise of variance σ²/n.
"""

import math
from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Final, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from agglom_mpi.errors import require_library

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")

THREAD_LIMIT: Final = Lock()
"""Held while the limit is set: it is the whole process's, and lifting it changes the order of
summation in all threads."""


def single_threaded(method: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a method to use one BLAS thread, and to run at no time with another such method.

    Matrices are small: a second thread gains little, and where a campaign keeps all cores busy the
    two wait for each other many times as long as either computes.
    """

    @wraps(method)
    def limited(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        require_library("threadpoolctl", "report", "feasible sets")
        import scipy.linalg  # noqa: F401  (what is loaded later would not be limited)
        from threadpoolctl import threadpool_limits

        with THREAD_LIMIT, threadpool_limits(1):
            return method(*args, **kwargs)

    return limited


Matrix = NDArray[np.float64]


class CholeskyFactor(NamedTuple):
    """Cholesky factor of a symmetric positive definite matrix A, shape (n, n).

    Attributes
    ----------
    root
        Lower triangular L with A = L Lᵀ, shape (n, n).
    inverse
        Diagonal of A⁻¹, shape (n,).
    """

    root: Matrix
    inverse: Matrix


def factored(matrix: Matrix) -> CholeskyFactor:
    """Return the factor of a symmetric positive definite matrix, shape (n, n)."""
    root = cholesky(matrix, lower=True)
    return CholeskyFactor(root, _squares(solve_triangular(root, np.eye(len(root)), lower=True)))


def extended(known: CholeskyFactor, border: Matrix, corner: Matrix) -> CholeskyFactor:
    """Return the factor of a matrix from that of its leading block.

    It takes 3 m n² operations, `factored` n³ and more (Golub and Van Loan 2013, 4.2.9).

    Parameters
    ----------
    known
        Factor of the leading block, shape (n, n).
    border, corner
        The blocks beside it, shape (n, m), and after it, shape (m, m).
    """
    n, m = border.shape
    rows = solve_triangular(known.root, border, lower=True).T
    last = cholesky(corner - rows @ rows.T, lower=True)
    root = np.zeros((n + m, n + m), order="F")
    root[:n, :n], root[n:, :n], root[n:, n:] = known.root, rows, last
    # L⁻¹ grows by the rows [-last⁻¹ rows L⁻¹, last⁻¹].
    beside = solve_triangular(known.root, rows.T, lower=True, trans="T").T
    beside = solve_triangular(last, beside, lower=True)
    after = solve_triangular(last, np.eye(m), lower=True)
    inverse = np.concatenate((known.inverse + _squares(beside), _squares(after)))
    return CholeskyFactor(root, inverse)


def _squares(columns: Matrix) -> Matrix:
    return np.einsum("ij,ij->j", columns, columns)


LENGTHS: Final = (0.05, 100.0)
"""Bounds of a length in units of the box; a variable with a much longer one has no influence."""

VARIANCE: Final = (1e-2, 1e2)
"""Bounds of the variance of f, in units of that of the values."""

NOISE: Final = (1e-5, 1e2)
"""Bounds of the variance of one sample, in the same units."""

JITTER: Final = 1e-8
"""Added to the diagonal of a covariance of unit scale to keep it positive definite."""

ROOT_5: Final = math.sqrt(5.0)


class Covariance(NamedTuple):
    """Covariance of a Gaussian process, for values of mean 0 and variance 1.

    Attributes
    ----------
    variance
        v, of the function.
    lengths
        ℓ in units of the box, shape (d,).
    noise
        σ², the variance of one sample.
    """

    variance: float
    lengths: Matrix
    noise: float


class GaussianProcess:
    """Posterior of a function on the unit cube, given noisy means of it.

    Parameters
    ----------
    covariance
        As `fit_covariance` finds it.
    points
        Shape (n, d).
    values
        Means observed there, shape (n,).
    samples
        Number of samples of each, shape (n,).
    earlier
        A process of the same covariance through the first of these points, whose factor is
        extended. Its values may be others, its numbers of samples not.
    """

    def __init__(
        self,
        covariance: Covariance,
        points: Matrix,
        values: Matrix,
        samples: NDArray[np.int64] | Matrix,
        earlier: "GaussianProcess | None" = None,
    ) -> None:
        self._covariance = covariance
        self._points = points
        self._values = values
        self._centre, self._scale, self._standard = standardised(values)
        self._noise = covariance.noise / samples + JITTER
        self._factor = self._factored(earlier)
        self._weights = cho_solve((self._factor.root, True), self._standard)

    @property
    def sample_deviation(self) -> float:
        """Standard deviation of one sample."""
        return self._scale * math.sqrt(self._covariance.noise)

    def mean(self, points: Matrix) -> Matrix:
        """Return the posterior mean at points, shape (m, d), shape (m,) [RW 2.25]."""
        return self._centre + self._scale * (self._between(points, self._points) @ self._weights)

    @property
    def mean_at_points(self) -> Matrix:
        """Posterior mean at the points of the data, shape (n,)."""
        return self._centre + self._scale * (self._standard - self._noise * self._weights)

    @property
    def deviation_at_points(self) -> Matrix:
        """Posterior standard deviation at the points of the data, shape (n,)."""
        variance = self._noise * (1.0 - self._noise * self._factor.inverse)
        return self._scale * np.sqrt(np.maximum(variance, 0.0))

    def mean_and_slope(self, point: Matrix) -> tuple[float, Matrix]:
        """Return the posterior mean at one point, shape (d,), and its gradient, shape (d,)."""
        lengths = self._covariance.lengths
        away = (point - self._points) / lengths
        r = np.sqrt((away**2).sum(axis=1))
        value = self._covariance.variance * matern(r) @ self._weights
        slopes = -self._covariance.variance * matern_slope(r)[:, None] * away / lengths
        return self._centre + self._scale * float(value), self._scale * (self._weights @ slopes)

    def deviation(self, points: Matrix) -> Matrix:
        """Return the posterior standard deviation at points, shape (m, d), shape (m,)."""
        across = self._between(self._points, points)
        explained = solve_triangular(self._factor.root, across, lower=True)
        variance = self._covariance.variance - (explained**2).sum(axis=0)
        return self._scale * np.sqrt(np.maximum(variance, 0.0))

    def leave_one_out(self) -> Matrix:
        """Return the leave-one-out prediction of each value, shape (n,) [RW 5.12]."""
        return self._values - self._scale * self._weights / self._factor.inverse

    def draw(self, points: Matrix, number: int, random: np.random.Generator) -> Matrix:
        """Draw functions from the posterior at m points, (m, d): shape (number, m) [RW 2.24]."""
        across = self._between(self._points, points)
        explained = solve_triangular(self._factor.root, across, lower=True)
        covariance = self._between(points, points) - explained.T @ explained
        covariance[np.diag_indices_from(covariance)] += 1e-6 * self._covariance.variance
        root = cholesky(covariance, lower=True)
        values = across.T @ self._weights + random.normal(size=(number, len(points))) @ root.T
        return self._centre + self._scale * values

    def _factored(self, earlier: "GaussianProcess | None") -> CholeskyFactor:
        known = 0 if earlier is None else len(earlier._points)
        first, others = self._points[:known], self._points[known:]
        corner = self._between(others, others)
        corner[np.diag_indices_from(corner)] += self._noise[known:]
        if earlier is None:
            return factored(corner)
        return extended(earlier._factor, self._between(first, others), corner)

    def _between(self, left: Matrix, right: Matrix) -> Matrix:
        lengths = self._covariance.lengths
        return self._covariance.variance * matern(distances(left / lengths, right / lengths))


def standardised(values: Matrix) -> tuple[float, float, Matrix]:
    """Return mean and standard deviation of values, and the values standardised by them, (n,)."""
    centre, scale = float(values.mean()), float(values.std()) or 1.0
    return centre, scale, (values - centre) / scale


def distances(left: Matrix, right: Matrix) -> Matrix:
    """Return the distances of n points, shape (n, d), from m points, (m, d), shape (n, m)."""
    squares = (left**2).sum(axis=1)[:, None] + (right**2).sum(axis=1) - 2.0 * left @ right.T
    return np.sqrt(np.maximum(squares, 0.0))


def matern(r: Matrix) -> Matrix:
    """Return the Matérn-5/2 correlation [RW 4.17], elementwise."""
    return (1.0 + ROOT_5 * r + 5.0 / 3.0 * r**2) * np.exp(-ROOT_5 * r)


def matern_slope(r: Matrix) -> Matrix:
    """Return minus its derivative by r over r, which is finite at 0, elementwise."""
    return 5.0 / 3.0 * (1.0 + ROOT_5 * r) * np.exp(-ROOT_5 * r)


def fit_covariance(points: Matrix, values: Matrix, samples: NDArray[np.int64]) -> Covariance:
    """Return the covariance of maximum posterior density.

    Lengths have a broad prior that grows with the square root of d (Hvarfner, Hellsten and Nardi
    2024), so that a few points in many dimensions are not fitted by noise alone.

    Parameters
    ----------
    points
        Shape (n, d).
    values
        Means observed there, shape (n,).
    samples
        Number of samples of each, shape (n,).
    """
    _, _, standard = standardised(values)
    data = squared_differences(points), standard, samples.astype(np.float64)
    start = first_guess(points.shape[1])
    return covariance_of(most_likely(_negative_log_likelihood, start, data, 100))


def first_guess(dimensions: int) -> Matrix:
    """Return the logarithms of variance, lengths and noise that a fit starts from, (d + 2,)."""
    return np.asarray(np.log([1.0, *np.full(dimensions, math.sqrt(dimensions)), 0.3]))


def squared_differences(points: Matrix) -> Matrix:
    """Return the squared differences of points, (n, d), in each coordinate, shape (d, n, n)."""
    return np.asarray((points.T[:, :, None] - points.T[:, None, :]) ** 2)


def most_likely(
    negative: Callable[..., tuple[float, Matrix]],
    start: Matrix,
    data: tuple[Matrix, ...],
    iterations: int,
) -> Matrix:
    """Return the logarithms, (d + 2,), within their bounds at which a function is least.

    Parameters
    ----------
    negative
        Function of the logarithms of variance, lengths and noise, and of `data`, that returns
        the negative logarithm of a density, and its gradient.
    start
        Shape (d + 2,); put within the bounds.
    data
        The other arguments.
    iterations
        At most.
    """
    bounds = np.log([VARIANCE, *[LENGTHS] * (len(start) - 2), NOISE])
    found = minimize(
        negative,
        np.clip(start, *bounds.T),
        data,
        jac=True,
        bounds=bounds,
        method="L-BFGS-B",
        options={"maxiter": iterations},
    )
    return np.asarray(found.x)


def covariance_of(logarithms: Matrix) -> Covariance:
    """Return the covariance of the logarithms of variance, lengths and noise, shape (d + 2,)."""
    best = np.exp(logarithms)
    return Covariance(float(best[0]), best[1:-1], float(best[-1]))


def _negative_log_likelihood(
    logarithms: Matrix, squares: Matrix, values: Matrix, samples: Matrix
) -> tuple[float, Matrix]:
    """Negative logarithm of likelihood times prior, and its gradient [RW 5.8, 5.9].

    Parameters
    ----------
    logarithms
        Of variance, lengths and noise, shape (d + 2,).
    squares
        Squared differences of the points, shape (d, n, n).
    values, samples
        Standardised means, and numbers of samples, shape (n,).
    """
    variance, lengths, noise = (
        math.exp(logarithms[0]),
        np.exp(logarithms[1:-1]),
        math.exp(logarithms[-1]),
    )
    r = np.sqrt(np.tensordot(lengths**-2.0, squares, axes=1))
    smooth = variance * matern(r)
    matrix = smooth.copy()
    matrix[np.diag_indices_from(matrix)] += noise / samples + JITTER
    root = cholesky(matrix, lower=True)
    weights = cho_solve((root, True), values)
    inverse = cho_solve((root, True), np.eye(len(values)))
    change = 0.5 * (inverse - np.outer(weights, weights))
    slopes = change * (variance * matern_slope(r))
    prior, prior_slope = _length_prior(logarithms[1:-1])
    value = 0.5 * values @ weights + np.log(np.diag(root)).sum() + prior
    gradient = np.concatenate(
        (
            [(change * smooth).sum()],
            np.tensordot(squares, slopes, axes=2) / lengths**2 + prior_slope,
            [change.diagonal() @ (noise / samples)],
        )
    )
    return float(value), gradient


def _length_prior(logarithms: Matrix) -> tuple[float, Matrix]:
    """Negative logarithm of the density of lengths, by their logarithms, and its gradient."""
    away = logarithms - math.sqrt(2.0) - 0.5 * math.log(len(logarithms))
    return float((away**2).sum()) / 6.0, away / 3.0
