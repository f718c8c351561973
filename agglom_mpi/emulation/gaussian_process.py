"""Gaussian-process regression of noisy means (Rasmussen and Williams 2006, "RW" below).

f has the covariance v·m(r) with the Matérn-5/2 form m(r) = (1 + √5 r + 5r²/3) exp(-√5 r) [RW 4.17],
where r² = Σ (Δx_d/ℓ_d)²: each variable has its own length. The mean of n samples of f is observed
with a noise of variance σ²/n.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular

from agglom_mpi.statistics import Floats

JITTER: Final = 1e-8
"""Number added to the diagonal of a covariance of unit scale to keep it positive definite."""

DRAW_JITTER: Final = 1e-6
"""The same for a posterior covariance that functions are drawn from, relative to the variance."""

ROOT_5: Final = math.sqrt(5.0)


class CholeskyFactor(NamedTuple):
    """Cholesky factor of a symmetric positive definite matrix A, shape (n, n).

    Attributes
    ----------
    root
        Lower triangular L with A = L Lᵀ, shape (n, n).
    inverse
        Diagonal of A⁻¹, shape (n,).
    """

    root: Floats
    inverse: Floats


def factored(matrix: Floats) -> CholeskyFactor:
    """Return the factor of a symmetric positive definite matrix, shape (n, n)."""
    root = cholesky(matrix, lower=True)
    return CholeskyFactor(root, _squares(solve_triangular(root, np.eye(len(root)), lower=True)))


def extended(known: CholeskyFactor, border: Floats, corner: Floats) -> CholeskyFactor:
    """Return the factor of a matrix whose leading block has a known factor.

    The extension takes 3 m n² operations, `factored` at least n³ (Golub and Van Loan 2013, 4.2.9).

    Parameters
    ----------
    known
        Factor of the leading block, shape (n, n).
    border, corner
        The block beside the leading one, shape (n, m), and the last one, shape (m, m).
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


def _squares(columns: Floats) -> Floats:
    return np.einsum("ij,ij->j", columns, columns)


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
    lengths: Floats
    noise: float


class GaussianProcess:
    """Posterior of a function on the unit cube, given noisy means of it.

    Parameters
    ----------
    covariance
        Covariance of the function, as `likelihood_fit` finds it.
    points
        Points in the unit cube, shape (n, d).
    values
        Observed mean at each point, shape (n,).
    samples
        Number of samples of each mean, or another number that the variance of its noise is
        inversely proportional to, shape (n,).
    earlier
        Process of the same covariance through the first of these points, with the same numbers of
        samples and any values. Its factor is extended.
    """

    def __init__(
        self,
        covariance: Covariance,
        points: Floats,
        values: Floats,
        samples: NDArray[np.int64] | Floats,
        earlier: "GaussianProcess | None" = None,
    ) -> None:
        self.covariance = covariance
        self.points = points
        self._values = values
        self._centre, self._scale, self._standard = standardised(values)
        self._noise = covariance.noise / samples + JITTER
        self._factor = self._factored(earlier)
        self._weights = cho_solve((self._factor.root, True), self._standard)

    @property
    def sample_deviation(self) -> float:
        """Standard deviation of one sample."""
        return self._scale * math.sqrt(self.covariance.noise)

    def mean(self, points: Floats) -> Floats:
        """Return the posterior mean at points, shape (m, d), shape (m,) [RW 2.25]."""
        return self._centre + self._scale * (self._between(points, self.points) @ self._weights)

    def means_of(self, values: Floats, points: Floats) -> Floats:
        """Return the posterior means for other values at the same points, as noisy as these.

        Parameters
        ----------
        values
            R times the observed mean at each point of the data, shape (R, n).
        points
            Where to predict, shape (m, d).

        Returns
        -------
        ndarray
            Shape (R, m).
        """
        standard = (values - self._centre) / self._scale
        weights = cho_solve((self._factor.root, True), standard.T)
        return self._centre + self._scale * (self._between(points, self.points) @ weights).T

    @property
    def noise_at_points(self) -> Floats:
        """Standard deviation of the noise of each observed mean, shape (n,)."""
        return self._scale * np.sqrt(self._noise)

    @property
    def mean_at_points(self) -> Floats:
        """Posterior mean at the points of the data, shape (n,)."""
        return self._centre + self._scale * (self._standard - self._noise * self._weights)

    @property
    def deviation_at_points(self) -> Floats:
        """Posterior standard deviation at the points of the data, shape (n,)."""
        variance = self._noise * (1.0 - self._noise * self._factor.inverse)
        return self._scale * np.sqrt(np.maximum(variance, 0.0))

    def arrays(self) -> dict[str, Floats]:
        """Return what `mean` and `deviation` rest on, beside the points, as plain arrays.

        They are `variance` and `lengths` of the covariance, `centre` and `scale` of the values, the
        `weights`, (n,), and the `inverse` of the Cholesky factor, (n, n).
        """
        root = self._factor.root
        return {
            "variance": np.float64(self.covariance.variance),
            "lengths": self.covariance.lengths,
            "centre": np.float64(self._centre),
            "scale": np.float64(self._scale),
            "weights": self._weights,
            "inverse": solve_triangular(root, np.eye(len(root)), lower=True),
        }

    def mean_and_slope(self, point: Floats) -> tuple[float, Floats]:
        """Return the posterior mean at one point, shape (d,), and its gradient, shape (d,)."""
        lengths = self.covariance.lengths
        away = (point - self.points) / lengths
        r = np.sqrt((away**2).sum(axis=1))
        value = self.covariance.variance * matern(r) @ self._weights
        slopes = -self.covariance.variance * matern_slope(r)[:, None] * away / lengths
        return self._centre + self._scale * float(value), self._scale * (self._weights @ slopes)

    def deviation(self, points: Floats) -> Floats:
        """Return the posterior standard deviation at points, shape (m, d), shape (m,)."""
        return self._deviation(self._between(self.points, points))

    def mean_and_deviation(self, points: Floats) -> tuple[Floats, Floats]:
        """Return posterior mean and standard deviation at points, (m, d), each of shape (m,)."""
        across = self._between(self.points, points)
        return self._centre + self._scale * (self._weights @ across), self._deviation(across)

    def _deviation(self, across: Floats) -> Floats:
        """Return standard deviations by the covariances with the points of the data, (n, m)."""
        explained = solve_triangular(self._factor.root, across, lower=True)
        variance = self.covariance.variance - (explained**2).sum(axis=0)
        return self._scale * np.sqrt(np.maximum(variance, 0.0))

    def leave_one_out(self) -> Floats:
        """Return the prediction of each value from all the others, shape (n,) [RW 5.12]."""
        return self._values - self._scale * self._weights / self._factor.inverse

    def leave_one_out_deviation(self) -> Floats:
        """Return the standard deviation of each `leave_one_out`, noise included, shape (n,)."""
        return self._scale / np.sqrt(self._factor.inverse)

    def draw(self, points: Floats, number: int, random: np.random.Generator) -> Floats:
        """Draw functions from the posterior at m points, (m, d): shape (number, m) [RW 2.24]."""
        across = self._between(self.points, points)
        explained = solve_triangular(self._factor.root, across, lower=True)
        covariance = self._between(points, points) - explained.T @ explained
        covariance[np.diag_indices_from(covariance)] += DRAW_JITTER * self.covariance.variance
        root = cholesky(covariance, lower=True)
        values = across.T @ self._weights + random.normal(size=(number, len(points))) @ root.T
        return self._centre + self._scale * values

    def drawn_update(self, prior: Floats, random: np.random.Generator) -> Floats:
        """Return weights by which functions drawn from the prior meet noisy data, shape (n, k).

        Parameters
        ----------
        prior
            k functions of the standardised prior at the points of the data, shape (n, k).
        random
            Stream of the noise.
        """
        noise = random.normal(size=prior.shape) * np.sqrt(self._noise)[:, None]
        return np.asarray(
            cho_solve((self._factor.root, True), self._standard[:, None] - prior - noise)
        )

    def updated(self, prior: Floats, points: Floats, update: Floats) -> Floats:
        """Return k functions of the posterior at points, (m, d), shape (m, k).

        Parameters
        ----------
        prior
            The functions of the standardised prior at these points, shape (m, k).
        points
        update
            Their `drawn_update`, shape (n, k).
        """
        standard = prior + self._between(points, self.points) @ update
        return self._centre + self._scale * standard

    def _factored(self, earlier: "GaussianProcess | None") -> CholeskyFactor:
        known = 0 if earlier is None else len(earlier.points)
        first, others = self.points[:known], self.points[known:]
        corner = self._between(others, others)
        corner[np.diag_indices_from(corner)] += self._noise[known:]
        if earlier is None:
            return factored(corner)
        return extended(earlier._factor, self._between(first, others), corner)

    def _between(self, left: Floats, right: Floats) -> Floats:
        lengths = self.covariance.lengths
        return self.covariance.variance * matern(distances(left / lengths, right / lengths))


def standardised(values: Floats) -> tuple[float, float, Floats]:
    """Return mean and standard deviation of values, (n,), and the standardised values, (n,)."""
    centre, scale = float(values.mean()), float(values.std()) or 1.0
    return centre, scale, (values - centre) / scale


def distances(left: Floats, right: Floats) -> Floats:
    """Return the distances of n points, shape (n, d), from m points, (m, d), shape (n, m)."""
    squares = (left**2).sum(axis=1)[:, None] + (right**2).sum(axis=1) - 2.0 * left @ right.T
    return np.sqrt(np.maximum(squares, 0.0))


def matern(r: Floats) -> Floats:
    """Return the Matérn-5/2 correlation [RW 4.17], elementwise."""
    return (1.0 + ROOT_5 * r + 5.0 / 3.0 * r**2) * np.exp(-ROOT_5 * r)


def matern_slope(r: Floats) -> Floats:
    """Return -m'(r)/r of the Matérn-5/2 correlation m(r), elementwise; it is finite at r = 0."""
    return 5.0 / 3.0 * (1.0 + ROOT_5 * r) * np.exp(-ROOT_5 * r)
