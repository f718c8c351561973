"""The emulated numbers of a campaign: one process each, with their joint noise."""

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.emulation.emulator import Emulator, merged

if TYPE_CHECKING:
    from agglom_mpi.emulation.emulator import NoisyMeans
    from agglom_mpi.inference.criteria import Criterion

Floats = NDArray[np.float64]

DRAWS: Final = 256
"""Number of normally distributed points that a function of several numbers is averaged over."""


class SetEmulator:
    """Emulator of the k numbers of a criterion, and of what is compared.

    The noise of several numbers of a sample is correlated. They are turned into k numbers whose
    noise is not, by the covariance of the residuals of a first emulation; each of these is a
    process of its own.

    Parameters
    ----------
    criterion
        Which numbers they are.
    points
        Coordinates of each sample, shape (n, p).
    numbers
        The numbers of each sample, shape (n, k).
    random
    groups
        How many of the coordinates, the last ones, are groups of variables.
    """

    def __init__(
        self,
        criterion: "Criterion",
        points: Floats,
        numbers: Floats,
        random: np.random.Generator,
        groups: int = 0,
    ) -> None:
        self.criterion = criterion
        k = numbers.shape[1]
        self._mixing = np.eye(k)
        if k > 1:
            scales = numbers.std(axis=0)
            scales[scales == 0.0] = 1.0
            first = [
                Emulator(merged(points, n), random, groups, rounds=0) for n in (numbers / scales).T
            ]
            residuals = np.array([e.data.means - e.held_out()[0] for e in first])
            noise = residuals @ residuals.T / residuals.shape[1] + 1e-9 * np.eye(k)
            self._mixing = scales[:, None] * np.linalg.cholesky(noise)
        mixed = np.linalg.solve(self._mixing, numbers.T)
        self._emulators = [Emulator(merged(points, n), random, groups) for n in mixed]
        self._normal = _normal_points(k) if k > 1 else np.empty((0, 1))

    @property
    def data(self) -> "NoisyMeans":
        """Samples of the first process."""
        return self._emulators[0].data

    @property
    def single(self) -> bool:
        """Whether one number is emulated, which is what is compared."""
        return len(self._emulators) == 1

    @property
    def held_out(self) -> list[tuple[Floats, Floats, Floats]]:
        """Of each process its data, their predictions without each, and the deviations of these."""
        return [(e.data.means, *e.held_out()) for e in self._emulators]

    def mean(self, points: Floats) -> Floats:
        """Return the expected value of what is compared at points, (m, p), shape (m, q)."""
        if self.single:
            return self._emulators[0].mean(points)[:, None]
        return self._draws(points).mean(axis=0)

    def deviation(self, points: Floats) -> Floats:
        """Return the standard deviations of what is compared at points, (m, p), shape (m, q)."""
        if self.single:
            return self._emulators[0].deviation(points)[:, None]
        return self._draws(points).std(axis=0)

    def mean_only(self, points: Floats) -> Floats:
        """Return what is compared, of the expected numbers, at points, (m, p), shape (m, q)."""
        means = np.column_stack([e.mean(points) for e in self._emulators])
        return self.criterion.compared(means @ self._mixing.T)

    def first_mean(self, points: Floats) -> Floats:
        """Return the expected value of the first process at points, (m, p), shape (m,)."""
        return self._emulators[0].mean(points)

    def noise(self, points: Floats) -> Floats:
        """Return the standard deviation of each number of one sample at points, shape (m, k)."""
        own = np.column_stack([e.noise(points) for e in self._emulators])
        return np.sqrt(own**2 @ (self._mixing**2).T)

    def probability(self, points: Floats) -> Floats:
        """Return the probability that what is compared makes a member at points, shape (m,)."""
        found = [
            self.criterion.holds(self._draws(some)).mean(axis=0)
            for some in np.array_split(points, -(-len(points) // 1024) or 1)
        ]
        return np.concatenate(found)

    def paths(self, number: int, random: np.random.Generator) -> "ComparedPaths":
        """Draw joint functions of what is compared."""
        return ComparedPaths(self, number, random)

    def _draws(self, points: Floats) -> Floats:
        """Return values of what is compared, normally distributed, (`DRAWS`, m, q)."""
        means = np.column_stack([e.mean(points) for e in self._emulators])
        spread = np.column_stack([e.deviation(points) for e in self._emulators])
        numbers = means + self._normal[:, None, :] * spread
        return self.criterion.compared(numbers @ self._mixing.T)


class ComparedPaths:
    """Joint functions, drawn from the posterior, of what is compared."""

    def __init__(self, emulator: SetEmulator, number: int, random: np.random.Generator) -> None:
        self._emulator = emulator
        self._paths = [e.paths(number, random) for e in emulator._emulators]

    def __call__(self, points: Floats) -> Floats:
        """Return the n functions at points, (m, p), shape (n, m, q)."""
        numbers = np.stack([paths(points) for paths in self._paths], axis=-1)
        return self._emulator.criterion.compared(numbers @ self._emulator._mixing.T)


def _normal_points(k: int) -> Floats:
    """Return evenly spread points of k standard normal numbers, shape (`DRAWS`, k)."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    return np.asarray(ndtri(qmc.Sobol(k, seed=1).random(DRAWS)))
