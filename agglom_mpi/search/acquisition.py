"""Acquisition: where to evaluate next by a Gaussian process, and what it ranks best so far.

`SetAim` looks for the set of strings that meet a target, in place of the best of them.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.statistics import Floats, probability_between

if TYPE_CHECKING:
    from agglom_mpi.emulation.gaussian_process import GaussianProcess

CANDIDATES: Final = 1200
"""Number of points at which drawn functions are compared; a draw takes the cube of it in time."""
PROMISING: Final = 10
"""Number of best strings around which half of the candidates lie."""
STEP: Final = 0.15
"""Standard deviation of a candidate about a promising string, in units of the box."""
PERTURBATION: Final = 1e-6
"""Maximum relative displacement of a proposal towards the reference point `INSIDE`."""
INSIDE: Final = 0.381966
"""Coordinate of the reference point; chosen so that no proposal coincides with it."""
MAX_MOVES: Final = 64
"""Maximum number of moves tried until a point is allowed."""
DUPLICATES: Final = 1e-4
"""Strings that differ by less, in units of the box, are ranked as one."""
STARTS: Final = 5
"""Number of strings from which the best expected value is searched."""
MIN_DIVISOR: Final = 1e-300
"""Divisor in place of a standard deviation of 0."""
SET_CANDIDATES: Final = 4096
"""Minimum number of points among which a batch around a set is drawn."""
NEIGHBOURHOOD: Final = 3.0
"""Largest magnitude of the emulated mean in the neighbourhood of the set, in tolerances."""
ERROR_POINTS: Final = 1 << 12
"""Number of even points of the box by which the expected error of a set is estimated."""
MIN_ERROR_POINTS: Final = 8
"""Minimum number of allowed points among these; below it, `ERROR_POINTS` allowed ones are drawn."""
MIN_ERROR_STRINGS: Final = 50
"""Minimum number of strings for an expected error."""


def candidates_about(promising: Floats, random: np.random.Generator, space: SearchSpace) -> Floats:
    """Return points of the unit cube at which to compare functions, shape (`CANDIDATES`, d).

    Half are uniform, a quarter lies near a point of `promising`, shape (m, d), and a quarter is one
    of these with some components moved to the faces of the box, where optima of bounded problems
    often are. All are in the box of `space`; those that it does not allow are moved back to the
    promising point that they come from, as far as to where they are allowed.
    """
    quarter = CANDIDATES // 4
    anywhere = space.sample_points(random, 2 * quarter)
    origins = promising[random.integers(len(promising), size=(2, quarter))]
    near, moved = origins
    near = np.clip(near + STEP * random.normal(size=near.shape), 0.0, 1.0)
    faces = random.integers(2, size=moved.shape).astype(np.float64)
    moved = np.where(random.random(moved.shape) < 0.5, moved, faces)
    near, moved = map(space.towards, (near, moved), origins)
    return np.vstack((anywhere, near, moved))


def best_expected(
    model: "GaussianProcess", starts: Floats, magnitude: bool, space: SearchSpace
) -> Floats:
    """Return the point, shape (d,), with the least expected objective near the starts.

    Parameters
    ----------
    model
        Process of the objective, or of the signed mean whose magnitude is the objective.
    starts
        Points of the unit cube from which to descend, shape (m, d).
    magnitude
        Whether the objective is the magnitude of what is modelled.
    space
        The box; the point is one that it allows, as the starts are.
    """
    from scipy.optimize import minimize

    def smooth(point: Floats) -> tuple[float, Floats]:
        value, slope = model.mean_and_slope(point)
        return (value**2, 2.0 * value * slope) if magnitude else (value, slope)

    bounds = [(0.0, 1.0)] * starts.shape[1]
    ends = [minimize(smooth, at, jac=True, bounds=bounds, method="L-BFGS-B").x for at in starts]
    points = np.vstack((space.towards(np.array(ends), starts), starts))
    expected = expected_objective(model.mean(points), model.deviation(points), magnitude)
    return np.asarray(points[np.argmin(expected)])


def expected_objective(mean: Floats, deviation: Floats, magnitude: bool) -> Floats:
    """Return the expected objective of a normally distributed signed mean, elementwise.

    That of a magnitude is the mean of a folded normal distribution (Leone, Nelson and Nottingham
    1961): a zero that is hardly known has a large one.
    """
    if not magnitude:
        return mean
    from scipy.special import erf

    away = mean / np.maximum(deviation, MIN_DIVISOR)
    spread = math.sqrt(2.0 / math.pi) * deviation * np.exp(-0.5 * away**2)
    return np.asarray(spread + mean * erf(away / math.sqrt(2.0)))


def perturbed(points: Floats, random: np.random.Generator, space: SearchSpace) -> Floats:
    """Return allowed points of the unit cube, shape (n, d), moved at random by about 1e-6.

    Equal strings have equal configurations, so a corner that is proposed repeatedly would show no
    noise. Moves are random, as a moved point may be proposed again, and regular moves would meet.
    Where one leaves what is allowed, others are tried in all directions.
    """
    moved = points + PERTURBATION * random.random(points.shape) * (INSIDE - points)
    if space.allowed is None:
        return moved
    for _ in range(MAX_MOVES):
        out = ~space.allows(moved)
        if not out.any():
            return moved
        steps = PERTURBATION * random.uniform(-1.0, 1.0, points.shape)
        moved[out] = np.clip(points + steps, 0.0, 1.0)[out]
    moved = space.towards(moved, points)
    out = ~space.allows(moved)
    if out.any():  # a known string at the edge of what is allowed may be outside by its rounding
        moved[out] = space.sample_points(random, int(out.sum()))
    return moved


def duplicates_last(points: Floats, order: NDArray[np.int64]) -> list[int]:
    """Return an order of points with those that nearly equal an earlier one at the end.

    Parameters
    ----------
    points
        Points of the unit cube, shape (n, d).
    order
        Indices of points, shape (m,).
    """
    seen: set[bytes] = set()
    distinct: list[int] = []
    duplicates: list[int] = []
    for index in order.tolist():
        cell = np.rint(points[index] / DUPLICATES).tobytes()
        (duplicates if cell in seen else distinct).append(index)
        seen.add(cell)
    return distinct + duplicates


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
        points = space.sample_points(random, max(SET_CANDIDATES, 2 * count))
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
        if known.sum() < MIN_ERROR_STRINGS:
            return np.inf
        points, place = np.unique(self.coordinates(strings[known]), axis=0, return_inverse=True)
        weights = np.bincount(place.ravel(), samples[known])
        sums = np.bincount(place.ravel(), samples[known] * means[known])
        unknown = np.full(len(points), np.nan)
        data = NoisyMeans(points, sums / weights, weights.astype(np.int64), unknown)
        emulator = Emulator(data, np.random.default_rng(len(points)), self.groups)
        box = space.from_unit(qmc.Sobol(space.dimensions, seed=1).random(ERROR_POINTS))
        if space.allowed is not None:
            box = box[space.allowed(box)]
            if len(box) < MIN_ERROR_POINTS:
                box = space.from_unit(space.sample_points(np.random.default_rng(1), ERROR_POINTS))
        at = self.coordinates(box)
        inside = self.probability(emulator.mean(at), emulator.deviation(at))
        volume = float(inside.sum())
        return float(np.minimum(inside, 1.0 - inside).sum()) / volume if volume > 0.0 else np.inf
