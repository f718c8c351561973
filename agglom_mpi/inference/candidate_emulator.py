"""Emulated values of a quantity that may be measured, given the data that there are.

The same samples give the data and the candidate, so their noise is correlated, and with it the
errors of their emulators: what is known of the data says something of the candidate, too. The
candidate is a linear function of the numbers that are emulated already, by the correlation of the
noise, and a remainder with a noise of its own, which has an emulator of its own.
"""

from typing import NamedTuple

import numpy as np

from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.inference.expected_volume import Candidate


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
        Mean and standard deviation of what the function leaves out, shape (n, q).
    """

    matrix: Floats
    rest: Floats
    rest_deviations: Floats

    @classmethod
    def of_data(cls, matrix: Floats, points: int) -> "LinearQuantity":
        """Return a quantity that is a function of the emulated numbers alone, at n points."""
        nothing = np.zeros((points, len(matrix)))
        return cls(matrix, nothing, nothing)


class CandidateEmulator:
    """Emulator of a number of a sample beside those that are emulated already.

    Parameters
    ----------
    coordinates
        Of each sample, shape (m, d).
    emulated
        Numbers of each sample that have emulators, shape (m, p).
    residuals
        Means of these numbers less their held-out predictions at the different points of the
        samples in ascending order, shape (s, p).
    number
        The candidate of each sample, shape (m,).
    random
        Stream of the subsets that covariances are fitted to.
    groups
        Number of coordinates, the last ones, that are groups of variables.

    Attributes
    ----------
    slopes : ndarray
        Of the candidate's noise against that of the numbers, shape (p,).
    """

    def __init__(
        self,
        coordinates: Floats,
        emulated: Floats,
        residuals: Floats,
        number: Floats,
        random: np.random.Generator,
        groups: int = 0,
    ) -> None:
        first = Emulator(merge_samples(coordinates, number), random, groups, rounds=0)
        own = first.data.means - first.held_out()[0]
        self.slopes = np.asarray(np.linalg.lstsq(residuals, own, rcond=None)[0], np.float64)
        rest = number - emulated @ self.slopes
        self._rest = Emulator(merge_samples(coordinates, rest), random, groups)

    def at(self, points: Floats) -> LinearQuantity:
        """Return the candidate at points, (n, d)."""
        mean, deviation = self._rest.mean(points), self._rest.deviation(points)
        return LinearQuantity(self.slopes[None], mean[:, None], deviation[:, None])
