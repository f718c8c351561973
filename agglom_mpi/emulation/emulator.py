"""Emulator: a Gaussian process of a mean whose noise depends on the point.

The noise of one sample is a second process, of the logarithm of its variance. Its data are the
squared leave-one-out residuals of the first (Kersting et al. 2007) and, where a point has several
samples, their variance. Both are noisy by themselves, by as much as the logarithm of a variance of
as many degrees of freedom is.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.special import digamma, gammaincinv, ndtri, polygamma
from scipy.stats import qmc

from agglom_mpi.emulation.covariance_fit import fit_covariance_of_many, refined
from agglom_mpi.emulation.gaussian_process import Covariance, GaussianProcess

Floats = NDArray[np.float64]

ROUNDS: Final = 2
"""Turns of fitting the noise and the mean."""
LEAST_NOISE: Final = 1e-3
"""Smallest variance of a sample, relative to the mean one: where nothing grows there is none."""
LEAST_WEIGHED: Final = 0.5
"""Variance by which a sample is weighed, at least, relative to the median one.

Strings in which nothing grows would otherwise make the process as smooth elsewhere as they are.
"""
FEATURES: Final = 2048
"""Random frequencies of the functions drawn from the prior."""
BLOCK: Final = 2048
"""Points evaluated together."""


class NoisyMeans(NamedTuple):
    """Means of samples at n different points.

    Attributes
    ----------
    points
        Shape (n, d).
    means
        Shape (n,).
    samples
        Number of samples of each, shape (n,).
    squares
        Sum of the squared deviations of the samples from their mean, shape (n,); nan if unknown.
    """

    points: Floats
    means: Floats
    samples: NDArray[np.int64]
    squares: Floats


def merged(points: Floats, values: Floats) -> NoisyMeans:
    """Return the means of single samples, values (n,) at points (n, d); equal points are one."""
    different, place = np.unique(points, axis=0, return_inverse=True)
    place = place.ravel()
    samples = np.bincount(place).astype(np.int64)
    means = np.bincount(place, values) / samples
    squares = np.bincount(place, (values - means[place]) ** 2)
    return NoisyMeans(different, means, samples, squares.astype(np.float64))


class Emulator:
    """Mean of noisy samples as a function of the point, and the noise of one of them.

    Parameters
    ----------
    data
        The samples, at two points or more.
    random
        For the subsets that covariances are fitted to.
    groups
        How many of the coordinates, the last ones, are groups of variables.
    rounds
        Turns of fitting the noise by the residuals, and the mean by the noise; 0: one noise for
        all points.

    Attributes
    ----------
    data
    """

    def __init__(
        self,
        data: NoisyMeans,
        random: np.random.Generator,
        groups: int = 0,
        rounds: int = ROUNDS,
    ) -> None:
        self.data = data
        weights = data.samples.astype(np.float64)
        covariance = fit_covariance_of_many(data.points, data.means, weights, random, groups)
        process = Process(covariance, data.points, data.means, weights)
        known: Covariance | None = None
        for _ in range(rounds):
            self._noise = NoiseProcess(process, data, random, groups, known)
            known = self._noise.covariance
            variance = self._noise.variance_without
            typical = float(np.median(variance))
            weights = data.samples * typical / np.maximum(variance, LEAST_WEIGHED * typical)
            covariance = refined(covariance, data.points, data.means, weights, random, groups)
            process = Process(covariance, data.points, data.means, weights)
        self._process = process

    def mean(self, points: Floats) -> Floats:
        """Return the expected mean at points, (m, d), shape (m,)."""
        return _blockwise(self._process.mean, points)

    def deviation(self, points: Floats) -> Floats:
        """Return the standard deviation of the mean at points, (m, d), shape (m,)."""
        return _blockwise(self._process.deviation, points)

    def noise(self, points: Floats) -> Floats:
        """Return the standard deviation of one sample at points, (m, d), shape (m,)."""
        return np.sqrt(self._noise.variance(points, self.mean(points)))

    def paths(self, number: int, random: np.random.Generator) -> "Paths":
        """Draw functions from the posterior of the mean."""
        return self._process.paths(number, random)

    def held_out(self) -> tuple[Floats, Floats]:
        """Predict each mean of the data without it: expected value and standard deviation, (n,).

        The deviation is that of the mean of its samples, noise included.
        """
        return self._process.predicted_without()


class Process(GaussianProcess):
    """A Gaussian process that draws functions at many points, and predicts its own data."""

    def predicted_without(self) -> tuple[Floats, Floats]:
        """Return leave-one-out predictions and their standard deviations, (n,) [RW 5.12]."""
        return self.leave_one_out(), self._scale / np.sqrt(self._factor.inverse)

    @property
    def noise_at_points(self) -> Floats:
        """Standard deviation of the noise of each value, shape (n,)."""
        return self._scale * np.sqrt(self._noise)

    def paths(self, number: int, random: np.random.Generator) -> "Paths":
        """Draw functions from the posterior, as Wilson et al. (2020).

        A function of the prior, a sum of random waves, is moved by what it misses of the data.
        """
        lengths, variance = self._covariance.lengths, self._covariance.variance
        waves = _frequencies(len(lengths), random) / lengths[:, None]
        weights = random.normal(size=(2 * FEATURES, number)) * np.sqrt(variance / FEATURES)
        noise = random.normal(size=(len(self._points), number)) * np.sqrt(self._noise)[:, None]
        missed = self._standard[:, None] - _waves(self._points, waves) @ weights - noise
        return Paths(self, waves, weights, cho_solve((self._factor.root, True), missed))


class Paths:
    """Functions drawn from the posterior of a process, to be evaluated anywhere."""

    def __init__(self, process: Process, waves: Floats, weights: Floats, update: Floats) -> None:
        self._process = process
        self._waves, self._weights, self._update = waves, weights, update

    def __call__(self, points: Floats) -> Floats:
        """Return the n functions at points, (m, d), shape (n, m)."""
        drawn = np.empty((self._weights.shape[1], len(points)))
        for i in range(0, len(points), BLOCK):
            at = points[i : i + BLOCK]
            prior = _waves(at, self._waves) @ self._weights
            values = prior + self._process._between(at, self._process._points) @ self._update
            drawn[:, i : i + BLOCK] = values.T
        return self._process._centre + self._process._scale * drawn


def _frequencies(dimensions: int, random: np.random.Generator) -> Floats:
    """Return frequencies of a Matérn-5/2 process of unit lengths, evenly spread, (d, `FEATURES`).

    They have Student's t distribution with five degrees of freedom [RW 4.15].
    """
    even = qmc.Sobol(dimensions + 1, seed=random).random(FEATURES)
    stretch = np.sqrt(2.0 * gammaincinv(2.5, even[:, 0]) / 5.0)
    return np.asarray((ndtri(even[:, 1:]) / stretch[:, None]).T)


def _waves(points: Floats, waves: Floats) -> Floats:
    phases = points @ waves
    return np.hstack((np.cos(phases), np.sin(phases)))


class NoiseProcess:
    """Variance of one sample, as the exponential of a process.

    Its last coordinate is the emulated mean: how far grains have grown says most about how
    differently they do.

    Parameters
    ----------
    process
        Of the means, with the noise as it is known so far.
    data
        The samples.
    random
    groups
        How many of the coordinates of the data, the last ones, are groups of variables. The
        emulated mean is one more.
    near
        A covariance of it that was found with other noise; None: search for one everywhere.

    Attributes
    ----------
    covariance
    """

    def __init__(
        self,
        process: Process,
        data: NoisyMeans,
        random: np.random.Generator,
        groups: int,
        near: Covariance | None = None,
    ) -> None:
        logarithms, spread = _observed_logarithms(process, data)
        means = process.leave_one_out()
        self._lowest, self._highest = float(means.min()), float(means.max())
        points = self._with_mean(data.points, means)
        weights = NOISE_OF_ONE / spread
        if near is None:
            self.covariance = fit_covariance_of_many(
                points, logarithms, weights, random, groups + 1
            )
        else:
            self.covariance = refined(near, points, logarithms, weights, random, groups + 1)
        self._process = GaussianProcess(self.covariance, points, logarithms, weights)
        self._floor = float(logarithms.min())

    @property
    def variance_without(self) -> Floats:
        """Variance of a sample at each point of the data, as the other points tell it, (n,)."""
        return self._variance(self._process.leave_one_out())

    def variance(self, points: Floats, means: Floats) -> Floats:
        """Return it at points, (m, d), where the emulated means are these, (m,): shape (m,)."""
        at = self._with_mean(points, means)
        return self._variance(_blockwise(self._process.mean, at))

    def _variance(self, logarithms: Floats) -> Floats:
        return np.exp(np.maximum(logarithms, self._floor))

    def _with_mean(self, points: Floats, means: Floats) -> Floats:
        scaled = (means - self._lowest) / (self._highest - self._lowest or 1.0)
        return np.column_stack((points, np.clip(scaled, 0.0, 1.0)))


NOISE_OF_ONE: Final = float(polygamma(1, 0.5))
"""Variance of the logarithm of the square of a standard normal number, π²/2."""


def _observed_logarithms(process: Process, data: NoisyMeans) -> tuple[Floats, Floats]:
    """Return what the data say of the logarithm of the variance, and their own variance, (n,).

    A leave-one-out residual is due to the noise and to the process; its square is divided among
    them as their variances are.
    """
    predicted, deviation = process.predicted_without()
    own = process.noise_at_points**2 * data.samples
    share = ((data.means - predicted) / deviation) ** 2
    least = LEAST_NOISE * float(np.average(own, weights=data.samples))
    logarithms = np.log(np.maximum(own * share, least)) - float(digamma(0.5) + np.log(2.0))
    spread = np.full(len(own), NOISE_OF_ONE)
    several = (data.samples > 1) & np.isfinite(data.squares)
    freedom = data.samples[several] - 1.0
    variance = np.maximum(data.squares[several] / freedom, least)
    within = np.log(variance) - digamma(0.5 * freedom) + np.log(0.5 * freedom)
    precision = 1.0 / polygamma(1, 0.5 * freedom), 1.0 / NOISE_OF_ONE
    logarithms[several] = (precision[0] * within + precision[1] * logarithms[several]) / sum(
        precision
    )
    spread[several] = 1.0 / sum(precision)
    return logarithms, spread


def _blockwise(function: Callable[[Floats], Floats], points: Floats) -> Floats:
    """Return a function of points, (m, d), computed for some of them at a time, shape (m,)."""
    blocks = [function(points[i : i + BLOCK]) for i in range(0, len(points), BLOCK)]
    return np.concatenate(blocks) if blocks else np.empty(0)
