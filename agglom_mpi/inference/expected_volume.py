"""Expected volume of a posterior after one more measurement, by simulated measurements.

The volume is the share of the search box in the smallest region that has 90 % of the weight. A
truth is drawn from the posterior as it is, and the new measurement of it from the emulator, its
error and that of the measurement. All points are then weighed by this measurement too, and the
volume is averaged over many such truths (Chaloner and Verdinelli, Statist. Sci. 10, 1995, 273).
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.emulation.gaussian_process import Floats

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


class ExpectedVolume(NamedTuple):
    """Mean volume after a measurement, as a share of the box, and its Monte-Carlo error."""

    mean: float
    standard_error: float


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


def simulated_volumes(
    points: WeightedPoints,
    candidate: Candidate,
    random: np.random.Generator,
    count: int = SIMULATED_MEASUREMENTS,
) -> Floats:
    """Return the volumes after simulated measurements, shape (count,).

    Two candidates are compared by the same truths and the same noise if their random generators
    are in the same state.
    """
    q = candidate.means.shape[1]
    truths = random.choice(len(points.weights), count, p=points.weights)
    noise = random.standard_normal((q, count)).T
    roots = np.asarray(np.linalg.cholesky(candidate.covariances + candidate.error), np.float64)
    measured = candidate.means[truths] + np.einsum("rij,rj->ri", roots[truths], noise)
    found = [
        _volumes_after(points, candidate.means, roots, some)
        for some in np.array_split(measured, -(-count // MEASUREMENTS_AT_ONCE))
    ]
    return np.concatenate(found)


def expected_volume(
    points: WeightedPoints,
    candidate: Candidate,
    random: np.random.Generator,
    count: int = SIMULATED_MEASUREMENTS,
) -> ExpectedVolume:
    """Return the expected volume of the posterior after a measurement of a candidate.

    Parameters
    ----------
    points
        Points of the posterior, n of them.
    candidate
        The quantity at these points.
    random
        Generator of the simulated measurements; see `simulated_volumes`.
    count
        Number of simulated measurements, at least 2.
    """
    volumes = simulated_volumes(points, candidate, random, count)
    return ExpectedVolume(float(volumes.mean()), float(volumes.std(ddof=1) / np.sqrt(count)))


def _volumes_after(
    points: WeightedPoints, means: Floats, roots: NDArray[np.float64], measured: Floats
) -> Floats:
    """Return the volumes after measurements, (r, q); `roots` are of the covariances, (n, q, q)."""
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
        logarithms = np.log(points.weights) - scale - 0.5 * squares
    weights = np.exp(logarithms - logarithms.max(axis=1, keepdims=True))
    return region_volumes(weights, points.share)
