"""Joint emulator of several numbers of a sample, with their correlated noise."""

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.statistics import Floats

NORMAL_POINTS: Final = 256
"""Number of normally distributed points that a function of several numbers is averaged over."""
MAX_POINTS_PER_BLOCK: Final = 1024
"""Maximum number of points whose probabilities are computed together."""

JointFunctions: TypeAlias = Callable[[Floats], Floats]
"""Functions drawn from the posterior of the quantities: their values at points, (m, p)."""


class JointEmulator:
    """Emulator of k numbers of a sample, and of q quantities that are functions of their means.

    The noise of several numbers of a sample is correlated. The numbers are mixed to k others with
    uncorrelated noise, by the covariance of the residuals of a first emulation; each of these is
    emulated by a process of its own.

    Parameters
    ----------
    quantities
        Returns the quantities, (…, q), of the means of the numbers, (…, k).
    points
        Coordinates of each sample, shape (n, p).
    numbers
        Numbers of each sample, shape (n, k); k may be 0.
    random
        Stream of the subsets that covariances are fitted to.
    groups
        Number of coordinates, the last ones, that are groups of variables.

    Attributes
    ----------
    mixing : ndarray
        Numbers of a sample are this matrix, (k, k), times the mixed ones.
    processes : list of Emulator
        Of the mixed numbers; all have the same points.
    """

    def __init__(
        self,
        quantities: Callable[[Floats], Floats],
        points: Floats,
        numbers: Floats,
        random: np.random.Generator,
        groups: int = 0,
    ) -> None:
        self._quantities = quantities
        k = numbers.shape[1]
        self.mixing = np.eye(k)
        if k > 1:
            scales = numbers.std(axis=0)
            scales[scales == 0.0] = 1.0
            first = [
                Emulator(merge_samples(points, n), random, groups, rounds=0)
                for n in (numbers / scales).T
            ]
            residuals = np.array([e.data.means - e.held_out()[0] for e in first])
            noise = residuals @ residuals.T / residuals.shape[1] + 1e-9 * np.eye(k)
            self.mixing = scales[:, None] * np.linalg.cholesky(noise)
        mixed = np.linalg.solve(self.mixing, numbers.T)
        self.processes = [Emulator(merge_samples(points, n), random, groups) for n in mixed]
        # One number is the quantity itself.
        self._is_single = k == 1
        self._normal = np.empty((0, 1))
        if k > 1:  # evenly spread
            from scipy.stats import qmc  # takes half a second to load

            self._normal = np.asarray(ndtri(qmc.Sobol(k, seed=1).random(NORMAL_POINTS)))

    @property
    def held_out(self) -> list[tuple[Floats, Floats, Floats]]:
        """Data of each process, their held-out predictions, and the deviations of these, (n,)."""
        return [(e.data.means, *e.held_out()) for e in self.processes]

    def mean(self, points: Floats) -> Floats:
        """Return the expected quantities at points, (m, p), shape (m, q)."""
        if self._is_single:
            return self.processes[0].mean(points)[:, None]
        return self._spread_quantities(points).mean(axis=0)

    def deviation(self, points: Floats) -> Floats:
        """Return the standard deviations of the quantities at points, (m, p), shape (m, q)."""
        if self._is_single:
            return self.processes[0].deviation(points)[:, None]
        return self._spread_quantities(points).std(axis=0)

    def mean_only(self, points: Floats) -> Floats:
        """Return the quantities of the expected numbers at points, (m, p), shape (m, q)."""
        mixed = np.column_stack([e.mean(points) for e in self.processes])
        return self._quantities(mixed @ self.mixing.T)

    def mixed(self, points: Floats) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of the mixed numbers at points, (m, k) each."""
        if not self.processes:
            return np.empty((len(points), 0)), np.empty((len(points), 0))
        found = [e.mean_and_deviation(points) for e in self.processes]
        means, deviations = zip(*found, strict=True)
        return np.column_stack(means), np.column_stack(deviations)

    def noise(self, points: Floats) -> Floats:
        """Return the standard deviation of each number of one sample at points, shape (m, k)."""
        own = np.column_stack([e.noise(points) for e in self.processes])
        return np.sqrt(own**2 @ (self.mixing**2).T)

    def probability(
        self, points: Floats, condition: Callable[[Floats], NDArray[np.bool_]]
    ) -> Floats:
        """Return the probability that the quantities at points satisfy a condition, shape (m,).

        Parameters
        ----------
        points
            Shape (m, p).
        condition
            Returns which quantities, (…, q), satisfy it, shape (…).
        """
        found = [
            condition(self._spread_quantities(some)).mean(axis=0)
            for some in np.array_split(points, -(-len(points) // MAX_POINTS_PER_BLOCK) or 1)
        ]
        return np.concatenate(found)

    def draw(self, number: int, random: np.random.Generator) -> JointFunctions:
        """Draw n joint functions of the quantities from the posterior: (m, p) → (n, m, q)."""
        functions = [e.draw(number, random) for e in self.processes]

        def drawn(points: Floats) -> Floats:
            numbers = np.stack([function(points) for function in functions], axis=-1)
            return self._quantities(numbers @ self.mixing.T)

        return drawn

    def _spread_quantities(self, points: Floats) -> Floats:
        """Return normally distributed quantities at points, (`NORMAL_POINTS`, m, q)."""
        means, deviations = self.mixed(points)
        numbers = means + self._normal[:, None, :] * deviations
        return self._quantities(numbers @ self.mixing.T)
