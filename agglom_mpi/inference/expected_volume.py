"""Expected volume of a posterior after one more measurement, by simulated measurements.

The volume is the share of the search box in the smallest region that has 90 % of the weight. A
truth is drawn from the posterior as it is, and the new measurement of it from the emulator, its
error and that of the measurement. All points are then weighed by this measurement too, and the
volume is averaged over many such truths (Chaloner and Verdinelli, Statist. Sci. 10, 1995, 273).

The same samples give the data and the candidate, so their noise is correlated, and with it the
errors of their emulators: what is known of the data says something of the candidate, too. The
candidate is a linear function of the numbers that are emulated already, by the correlation of the
noise, and a remainder with a noise of its own, which has an emulator of its own.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.statistics import Floats, MeanEstimate, mean_of

REGION_WEIGHT: Final = 0.9
"""Weight in the region whose volume is measured."""
SIMULATED_MEASUREMENTS: Final = 200
"""Number of simulated measurements of a quantity."""
MEASUREMENTS_AT_ONCE: Final = 50
"""Number of simulated measurements whose weights are in memory together."""


class WeightedPoints(NamedTuple):
    """Points that stand for a posterior.

    Attributes
    ----------
    weights
        Weights relative to even points of the prior, whose sum is 1, shape (n,).
    share
        Share of the box that each point stands for.
    """

    weights: Floats
    share: float

    @property
    def volume(self) -> float:
        """Share of the box in the smallest region with 90 % of the weight."""
        return float(region_volumes(self.weights[None], self.share)[0])


class Candidate(NamedTuple):
    """A quantity of q numbers that may be measured, as the emulator predicts it at n points.

    Attributes
    ----------
    means
        Expected numbers at each point, given all that is measured already, shape (n, q).
    covariances
        Covariance of the errors of these means, shape (n, q, q).
    error
        Covariance of the errors of the measurement, positive definite, shape (q, q).
    """

    means: Floats
    covariances: Floats
    error: Floats

    @property
    def roots(self) -> Floats:
        """Cholesky factors of the covariances of a measurement given each point, (n, q, q)."""
        return np.asarray(np.linalg.cholesky(self.covariances + self.error), np.float64)


def region_volumes(weights: Floats, share: float) -> Floats:
    """Return the volumes of the smallest regions with 90 % of the weight.

    Parameters
    ----------
    weights
        Sets of weights of the same n even points, each with a sum above 0, shape (r, n).
    share
        Share of the box that a point stands for.

    Returns
    -------
    array, shape (r,)
        A point that the edge of the region passes is counted by its part of the weight.
    """
    falling = -np.sort(-weights, axis=1)
    reached = np.cumsum(falling, axis=1)
    wanted = REGION_WEIGHT * reached[:, -1:]
    whole = np.sum(reached < wanted, axis=1)
    rows = np.arange(len(weights))
    below = np.where(whole > 0, reached[rows, whole - 1], 0.0)
    return share * (whole + (wanted[:, 0] - below) / falling[rows, whole])


def expected_volume(
    points: WeightedPoints,
    candidate: Candidate,
    random: np.random.Generator,
    count: int = SIMULATED_MEASUREMENTS,
) -> MeanEstimate:
    """Return the mean volume of the posterior after a measurement of a candidate, over `count`.

    Parameters
    ----------
    points
        Points of the posterior, n of them.
    candidate
        The quantity at these points.
    random
        Generator of the simulated measurements. Two candidates are compared by the same truths and
        the same noise if their generators are in the same state.
    count
        Number of simulated measurements, at least 2.
    """
    measured = simulated_measurements(points, candidate, random, count)
    volumes = np.concatenate(
        [_volumes_after(points, some) for some in logarithms_after(points, candidate, measured)]
    )
    return mean_of(volumes)


def simulated_measurements(
    points: WeightedPoints, candidate: Candidate, random: np.random.Generator, count: int
) -> Floats:
    """Return simulated measurements of a candidate, shape (count, q)."""
    truths = random.choice(len(points.weights), count, p=points.weights)
    noise = random.standard_normal((candidate.means.shape[1], count)).T
    moved = np.einsum("rij,rj->ri", candidate.roots[truths], noise)
    return np.asarray(candidate.means[truths] + moved)


def logarithms_after(
    points: WeightedPoints, candidate: Candidate, measured: Floats
) -> Iterator[Floats]:
    """Yield logarithms of the weights of points times the densities of measurements, (r, q).

    Some measurements at once, shape (some, n); ln 2π/2 for each of the q numbers is left out.
    """
    roots = candidate.roots
    for some in np.array_split(measured, -(-len(measured) // MEASUREMENTS_AT_ONCE)):
        yield _logarithms_after(points, candidate.means, roots, some)


def _volumes_after(points: WeightedPoints, logarithms: Floats) -> Floats:
    weights = np.exp(logarithms - logarithms.max(axis=1, keepdims=True))
    return region_volumes(weights, points.share)


def _logarithms_after(
    points: WeightedPoints, means: Floats, roots: Floats, measured: Floats
) -> Floats:
    """Return logarithms, (r, n), after measurements, (r, q), by roots of covariances, (n, q, q)."""
    squares = np.zeros((len(measured), len(means)))
    residuals: list[Floats] = []
    for i in range(means.shape[1]):  # solves L z = y - m for all points and measurements at once
        rest = measured[:, i, None] - means[:, i]
        for j, solved in enumerate(residuals):
            rest -= roots[:, i, j] * solved
        residuals.append(rest / roots[:, i, i])
        squares += residuals[-1] ** 2
    scale = np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(points.weights) - scale - 0.5 * squares)


class DataAtPoints(NamedTuple):
    """Measured data beside their emulators at n points.

    Attributes
    ----------
    means, deviations
        Of p numbers whose emulators have independent errors, shape (n, p).
    matrix
        The data as linear functions of these numbers, shape (r, p).
    measured, covariance
        The data and the covariance of their errors, shapes (r,) and (r, r).
    """

    means: Floats
    deviations: Floats
    matrix: Floats
    measured: Floats
    covariance: Floats

    def expected(self, linear: "LinearQuantity", error: Floats) -> Candidate:
        """Return what is expected of a quantity, given the data, if a point is the truth.

        Parameters
        ----------
        linear
            The quantity at the same points.
        error
            Covariance of the errors of its measurement, shape (q, q).
        """
        scaled = self.deviations**2
        own = np.einsum("qp,np,sp->nqs", linear.matrix, scaled, linear.matrix)
        common = np.einsum("qp,np,rp->nqr", linear.matrix, scaled, self.matrix)
        data = np.einsum("rp,np,sp->nrs", self.matrix, scaled, self.matrix) + self.covariance
        gains = np.linalg.solve(data, common.transpose(0, 2, 1)).transpose(0, 2, 1)
        surprise = self.measured - self.means @ self.matrix.T
        means = self.means @ linear.matrix.T + linear.rest
        means = means + np.einsum("nqr,nr->nq", gains, surprise)
        covariances = own - np.einsum("nqr,nsr->nqs", gains, common)
        diagonal = np.arange(means.shape[1])
        covariances[:, diagonal, diagonal] += linear.rest_deviations**2
        return Candidate(means, covariances, error)


class LinearQuantity(NamedTuple):
    """A quantity of q numbers at n points: a linear function of p emulated numbers and a rest.

    Attributes
    ----------
    matrix
        Shape (q, p).
    rest, rest_deviations
        Mean and standard deviation of what the function leaves out, shape (n, q); 0 of a function
        of the emulated numbers alone.
    """

    matrix: Floats
    rest: Floats | float = 0.0
    rest_deviations: Floats | float = 0.0


def emulated_candidate(
    samples: tuple[Floats, Floats, Floats],
    number: Floats,
    points: Floats,
    random: np.random.Generator,
    groups: int = 0,
) -> LinearQuantity:
    """Return a number of a sample, beside those that are emulated already, at points.

    Its matrix has the slopes of its noise against that of these numbers.

    Parameters
    ----------
    samples
        Coordinates of each sample, shape (m, d); its numbers that have emulators, (m, p); and means
        of these less their held-out predictions at the different points of the samples in ascending
        order, (s, p).
    number
        The candidate of each sample, shape (m,).
    points
        Where it is predicted, shape (n, d).
    random
        Stream of the subsets that covariances are fitted to.
    groups
        Number of coordinates, the last ones, that are groups of variables.
    """
    coordinates, emulated, residuals = samples
    first = Emulator(merge_samples(coordinates, number), random, groups, rounds=0)
    own = first.data.means - first.held_out()[0]
    slopes = np.asarray(np.linalg.lstsq(residuals, own, rcond=None)[0], np.float64)
    rest = number - emulated @ slopes
    emulator = Emulator(merge_samples(coordinates, rest), random, groups)
    mean, deviation = emulator.mean(points), emulator.deviation(points)
    return LinearQuantity(slopes[None], mean[:, None], deviation[:, None])
