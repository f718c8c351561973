"""Searching for the set of strings that meet a target, in place of the best of them."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.statistics import probability_between

if TYPE_CHECKING:
    from agglom_mpi.emulation.gaussian_process import GaussianProcess

Floats = NDArray[np.float64]

CANDIDATES: Final = 4096
"""Minimum number of points among which a batch is drawn."""
NEIGHBOURHOOD: Final = 3.0
"""Largest magnitude of the emulated mean in the neighbourhood of the set, in tolerances."""
POINTS: Final = 1 << 12
"""Even points of the box by which the expected error is told."""
FEWEST_POINTS: Final = 8
"""Minimum number of allowed points among these; below it, `POINTS` allowed ones are drawn."""
FEWEST: Final = 50
"""Strings from which it is told."""


class SetAim(NamedTuple):
    """The set that a search looks for: signed means whose magnitude is at most a tolerance.

    Attributes
    ----------
    tolerance
    coordinates
        Returns the coordinates in which strings, (n, k), are emulated, (n, p).
    groups
        How many of them, the last ones, are groups of variables.
    """

    tolerance: float
    coordinates: Callable[[Floats], Floats]
    groups: int = 0

    def probability(self, mean: Floats, deviation: Floats) -> Floats:
        """Return the probability of normally distributed signed means to be in the set."""
        return probability_between(-self.tolerance, self.tolerance, mean, deviation)

    def batch(
        self, model: "GaussianProcess", count: int, random: np.random.Generator, space: SearchSpace
    ) -> Floats:
        """Draw points of the unit cube, (count, d): half by neighbourhood, half by doubt.

        The first half is uniform over the candidates whose emulated mean is within `NEIGHBOURHOOD`
        tolerances of the target, whatever the samples there have shown. Where the neighbourhood has
        fewer candidates than half a batch, all of them are taken. The rest of the batch is drawn
        from the other candidates, with probabilities proportional to the smaller of the
        probabilities to be in the set and out of it.

        Parameters
        ----------
        model
            Process of the signed mean over the unit cube.
        count
            Number of points; half of them, rounded down, are of the neighbourhood.
        random
            Stream of the draws.
        space
            The box. All points are allowed by its constraints.
        """
        points = space.sample_points(random, max(CANDIDATES, 2 * count))
        mean = model.mean(points)
        near = np.flatnonzero(np.abs(mean) <= NEIGHBOURHOOD * self.tolerance)
        # A search that only follows its doubt leaves a string at the edge that came out badly and
        # returns to a lucky one, so that its samples are a biased choice.
        even = random.choice(near, min(count // 2, len(near)), replace=False)
        inside = self.probability(mean, model.deviation(points))
        unsure = np.minimum(inside, 1.0 - inside) + 1e-9
        unsure[even] = 0.0
        share = unsure / unsure.sum()
        doubtful = random.choice(len(points), count - len(even), replace=False, p=share)
        return np.asarray(points[np.concatenate((even, doubtful))])

    @single_threaded
    def expected_error(
        self, strings: Floats, means: Floats, samples: NDArray[np.int64], space: SearchSpace
    ) -> float:
        """Return the expected volume that is wrongly in or out of the set, over the set's.

        Parameters
        ----------
        strings
            Shape (n, k).
        means
            Their signed means, shape (n,); nan where samples failed.
        samples
            Numbers of completed samples, shape (n,).
        space
            The box.
        """
        from scipy.stats import qmc

        from agglom_mpi.emulation.emulator import Emulator, NoisyMeans  # loads scipy, too

        known = np.isfinite(means) & (samples > 0)
        if known.sum() < FEWEST:
            return np.inf
        points, place = np.unique(self.coordinates(strings[known]), axis=0, return_inverse=True)
        weights = np.bincount(place.ravel(), samples[known])
        sums = np.bincount(place.ravel(), samples[known] * means[known])
        unknown = np.full(len(points), np.nan)
        data = NoisyMeans(points, sums / weights, weights.astype(np.int64), unknown)
        emulator = Emulator(data, np.random.default_rng(len(points)), self.groups)
        box = space.from_unit(qmc.Sobol(space.dimensions, seed=1).random(POINTS))
        if space.allowed is not None:
            box = box[space.allowed(box)]
            if len(box) < FEWEST_POINTS:
                box = space.from_unit(space.sample_points(np.random.default_rng(1), POINTS))
        at = self.coordinates(box)
        inside = self.probability(emulator.mean(at), emulator.deviation(at))
        volume = float(inside.sum())
        return float(np.minimum(inside, 1.0 - inside).sum()) / volume if volume > 0.0 else np.inf
