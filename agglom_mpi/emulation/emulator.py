"""Emulator: a Gaussian process of a mean whose noise depends on the point.

The noise of one sample is a second process, of the logarithm of its variance. Its data are the
squared leave-one-out residuals of the first process (Kersting et al. 2007) and, where a point has
several samples, the variance of these. Both data are noisy themselves, like the logarithm of a
variance with that many degrees of freedom. [RW] is Rasmussen and Williams 2006.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, gammaincinv, ndtri, polygamma

from agglom_mpi.emulation.gaussian_process import Covariance, GaussianProcess
from agglom_mpi.emulation.likelihood_fit import LargeFit
from agglom_mpi.statistics import Floats

NOISE_ROUNDS: Final = 2
"""Number of times that the noise and then the mean are fitted again."""
MIN_RELATIVE_NOISE: Final = 1e-3
"""Lower bound of the noise variance relative to its mean; the noise is zero where no grain grows.
"""
MIN_RELATIVE_WEIGHING: Final = 0.5
"""Lower bound of the variance that a sample is weighed by, relative to the median variance.

Strings in which nothing grows would otherwise make the process as smooth elsewhere as they are.
"""
FREQUENCY_COUNT: Final = 2048
"""Number of random frequencies of the functions drawn from the prior."""
MAX_POINTS_AT_ONCE: Final = 2048
"""Maximum number of points that are evaluated together."""
LOG_SQUARE_VARIANCE: Final = float(polygamma(1, 0.5))
"""Variance of the logarithm of the square of a standard normal number, π²/2."""


class NoisyMeans(NamedTuple):
    """Means of samples at n different points.

    Attributes
    ----------
    points
        Shape (n, d).
    means
        Mean of the samples at each point, shape (n,).
    samples
        Number of samples at each point, shape (n,).
    squares
        Sum of the squared deviations of the samples from their mean, shape (n,); nan if unknown.
    """

    points: Floats
    means: Floats
    samples: NDArray[np.int64]
    squares: Floats


def merge_samples(points: Floats, values: Floats) -> NoisyMeans:
    """Return the means of samples, values (n,) at points (n, d), those at equal points together."""
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
        Means of samples at two points or more.
    random
        Stream of the subsets that covariances are fitted to.
    groups
        Number of coordinates, the last ones, that are groups of variables.
    rounds
        Number of times that the noise is fitted to the residuals, and the mean again by that
        noise; 0: one noise for all points.

    Attributes
    ----------
    data : NoisyMeans
    process : GaussianProcess
        Of the mean.
    """

    def __init__(
        self,
        data: NoisyMeans,
        random: np.random.Generator,
        groups: int = 0,
        rounds: int = NOISE_ROUNDS,
    ) -> None:
        self.data = data
        weights = data.samples.astype(np.float64)
        fit = LargeFit(data.points, data.means, weights, random, groups)
        covariance = fit.fitted()
        process = GaussianProcess(covariance, data.points, data.means, weights)
        known: Covariance | None = None
        for _ in range(rounds):
            self._noise = NoiseProcess(process, data, random, groups, known)
            known = self._noise.covariance
            variance = self._noise.variance_without
            typical = float(np.median(variance))
            weights = data.samples * typical / np.maximum(variance, MIN_RELATIVE_WEIGHING * typical)
            covariance = fit._replace(weights=weights).refined(covariance)
            process = GaussianProcess(covariance, data.points, data.means, weights)
        self.process = process

    def mean(self, points: Floats) -> Floats:
        """Return the expected mean at points, (m, d), shape (m,)."""
        return _blockwise(self.process.mean, points)

    def deviation(self, points: Floats) -> Floats:
        """Return the standard deviation of the mean at points, (m, d), shape (m,)."""
        return _blockwise(self.process.deviation, points)

    def mean_and_deviation(self, points: Floats) -> tuple[Floats, Floats]:
        """Return `mean` and `deviation` at points, (m, d), each of shape (m,)."""
        starts = range(0, len(points), MAX_POINTS_AT_ONCE)
        blocks = [
            self.process.mean_and_deviation(points[i : i + MAX_POINTS_AT_ONCE]) for i in starts
        ]
        if not blocks:
            return np.empty(0), np.empty(0)
        means, deviations = zip(*blocks, strict=True)
        return np.concatenate(means), np.concatenate(deviations)

    def noise(self, points: Floats) -> Floats:
        """Return the standard deviation of one sample at points, (m, d), shape (m,)."""
        return np.sqrt(self._noise.variance(points, self.mean(points)))

    def draw(self, number: int, random: np.random.Generator) -> "DrawnFunctions":
        """Draw functions from the posterior of the mean."""
        return DrawnFunctions(self.process, number, random)

    def held_out(self) -> tuple[Floats, Floats]:
        """Return the prediction of each mean from all the others, and its deviation, each (n,).

        The deviation includes the noise of the samples.
        """
        return self.process.leave_one_out(), self.process.leave_one_out_deviation()


class DrawnFunctions:
    """Functions drawn from the posterior of a process, to be evaluated anywhere.

    A function of the prior, a sum of random waves, is moved by what it misses of the data (Wilson
    et al. 2020).

    Parameters
    ----------
    process
    number
        Number of functions.
    random
        Stream of the draws.
    """

    def __init__(self, process: GaussianProcess, number: int, random: np.random.Generator) -> None:
        variance, lengths, _ = process.covariance
        self._process = process
        self._frequencies = _unit_frequencies(len(lengths), random) / lengths[:, None]
        amplitude = np.sqrt(variance / FREQUENCY_COUNT)
        self._weights = random.normal(size=(2 * FREQUENCY_COUNT, number)) * amplitude
        self._update = process.drawn_update(self._prior(process.points), random)

    def __call__(self, points: Floats) -> Floats:
        """Return the n functions at points, (m, d), shape (n, m)."""
        drawn = np.empty((self._weights.shape[1], len(points)))
        for i in range(0, len(points), MAX_POINTS_AT_ONCE):
            at = points[i : i + MAX_POINTS_AT_ONCE]
            values = self._process.updated(self._prior(at), at, self._update)
            drawn[:, i : i + MAX_POINTS_AT_ONCE] = values.T
        return drawn

    def _prior(self, points: Floats) -> Floats:
        phases = points @ self._frequencies
        return np.asarray(np.hstack((np.cos(phases), np.sin(phases))) @ self._weights)


def _unit_frequencies(dimensions: int, random: np.random.Generator) -> Floats:
    """Return evenly spread frequencies of a Matérn-5/2 process, (d, `FREQUENCY_COUNT`).

    They have Student's t distribution with five degrees of freedom [RW 4.15], for unit lengths.
    """
    from scipy.stats import qmc  # takes half a second to load

    even = qmc.Sobol(dimensions + 1, seed=random).random(FREQUENCY_COUNT)
    stretch = np.sqrt(2.0 * gammaincinv(2.5, even[:, 0]) / 5.0)
    return np.asarray((ndtri(even[:, 1:]) / stretch[:, None]).T)


class NoiseProcess:
    """Variance of one sample, as the exponential of a process.

    Its last coordinate is the emulated mean: how far grains have grown says most about how
    differently they do.

    Parameters
    ----------
    process
        Process of the means, with the noise as it is known so far.
    data
        Means of samples.
    random
        Stream of the subsets that its covariance is fitted to.
    groups
        Number of coordinates of the data, the last ones, that are groups of variables. The emulated
        mean is one more.
    near
        Covariance found with other noise, near which the fit starts; None: there is none yet.

    Attributes
    ----------
    covariance : Covariance
    """

    def __init__(
        self,
        process: GaussianProcess,
        data: NoisyMeans,
        random: np.random.Generator,
        groups: int,
        near: Covariance | None = None,
    ) -> None:
        logarithms, spread = _observed_logarithms(process, data)
        means = process.leave_one_out()
        self._lowest, self._highest = float(means.min()), float(means.max())
        points = self._with_mean(data.points, means)
        weights = LOG_SQUARE_VARIANCE / spread
        fit = LargeFit(points, logarithms, weights, random, groups + 1)
        self.covariance = fit.fitted() if near is None else fit.refined(near)
        self._process = GaussianProcess(self.covariance, points, logarithms, weights)
        self._floor = float(logarithms.min())

    @property
    def variance_without(self) -> Floats:
        """Variance of one sample at each point of the data, by all the other points, (n,)."""
        return self._variance(self._process.leave_one_out())

    def variance(self, points: Floats, means: Floats) -> Floats:
        """Return the variance of one sample at points, (m, d), with emulated means (m,): (m,)."""
        at = self._with_mean(points, means)
        return self._variance(_blockwise(self._process.mean, at))

    def _variance(self, logarithms: Floats) -> Floats:
        return np.exp(np.maximum(logarithms, self._floor))

    def _with_mean(self, points: Floats, means: Floats) -> Floats:
        scaled = (means - self._lowest) / (self._highest - self._lowest or 1.0)
        return np.column_stack((points, np.clip(scaled, 0.0, 1.0)))


def _observed_logarithms(process: GaussianProcess, data: NoisyMeans) -> tuple[Floats, Floats]:
    """Return estimates of the logarithm of the variance, and the variances of these, each (n,).

    A leave-one-out residual is due to the noise and to the process; its square is divided between
    them in proportion to their variances.
    """
    predicted, deviation = process.leave_one_out(), process.leave_one_out_deviation()
    own = process.noise_at_points**2 * data.samples
    share = ((data.means - predicted) / deviation) ** 2
    least = MIN_RELATIVE_NOISE * float(np.average(own, weights=data.samples))
    logarithms = np.log(np.maximum(own * share, least)) - float(digamma(0.5) + np.log(2.0))
    spread = np.full(len(own), LOG_SQUARE_VARIANCE)
    several = (data.samples > 1) & np.isfinite(data.squares)
    freedom = data.samples[several] - 1.0
    variance = np.maximum(data.squares[several] / freedom, least)
    within = np.log(variance) - digamma(0.5 * freedom) + np.log(0.5 * freedom)
    precision = 1.0 / polygamma(1, 0.5 * freedom), 1.0 / LOG_SQUARE_VARIANCE
    logarithms[several] = (precision[0] * within + precision[1] * logarithms[several]) / sum(
        precision
    )
    spread[several] = 1.0 / sum(precision)
    return logarithms, spread


def _blockwise(function: Callable[[Floats], Floats], points: Floats) -> Floats:
    """Return the values of a function at points, (m, d), computed in blocks, shape (m,)."""
    starts = range(0, len(points), MAX_POINTS_AT_ONCE)
    blocks = [function(points[i : i + MAX_POINTS_AT_ONCE]) for i in starts]
    return np.concatenate(blocks) if blocks else np.empty(0)
