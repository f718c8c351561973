"""Acquisition: where to evaluate next by a Gaussian process, and what it ranks best so far."""

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.space import SearchSpace

if TYPE_CHECKING:
    from agglom_mpi.emulation.gaussian_process import GaussianProcess

CANDIDATES: Final = 1200
"""Number of points at which drawn functions are compared; a draw takes the cube of it in time."""

PROMISING: Final = 10
"""Number of best strings around which half of the candidates lie."""

STEP: Final = 0.15
"""Standard deviation of a candidate about a promising string, in units of the box."""

PERTURBATION: Final = 1e-6
"""Largest share of the way to `INSIDE` by which a string is moved."""

INSIDE: Final = 0.381966
"""Every component of that point in the unit cube: no value that a search proposes twice."""

MOVES: Final = 64
"""Moves at most that are tried until a point is allowed."""

DUPLICATES: Final = 1e-4
"""Strings that differ by less, in units of the box, are ranked as one."""

STARTS: Final = 5
"""Number of strings from which the best expected value is searched."""

SMALLEST: Final = 1e-300
"""Least divisor for a standard deviation of 0."""


def candidates_about(
    promising: NDArray[np.float64], random: np.random.Generator, space: SearchSpace
) -> NDArray[np.float64]:
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
    model: "GaussianProcess", starts: NDArray[np.float64], magnitude: bool, space: SearchSpace
) -> NDArray[np.float64]:
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

    def smooth(point: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        value, slope = model.mean_and_slope(point)
        return (value**2, 2.0 * value * slope) if magnitude else (value, slope)

    bounds = [(0.0, 1.0)] * starts.shape[1]
    ends = [minimize(smooth, at, jac=True, bounds=bounds, method="L-BFGS-B").x for at in starts]
    points = np.vstack((space.towards(np.array(ends), starts), starts))
    expected = expected_objective(model.mean(points), model.deviation(points), magnitude)
    return np.asarray(points[np.argmin(expected)])


def expected_objective(
    mean: NDArray[np.float64], deviation: NDArray[np.float64], magnitude: bool
) -> NDArray[np.float64]:
    """Return the expected objective of a normally distributed signed mean, elementwise.

    That of a magnitude is the mean of a folded normal distribution (Leone, Nelson and Nottingham
    1961): a zero that is hardly known has a large one.
    """
    if not magnitude:
        return mean
    from scipy.special import erf

    away = mean / np.maximum(deviation, SMALLEST)
    spread = math.sqrt(2.0 / math.pi) * deviation * np.exp(-0.5 * away**2)
    return np.asarray(spread + mean * erf(away / math.sqrt(2.0)))


def perturbed(
    points: NDArray[np.float64], random: np.random.Generator, space: SearchSpace
) -> NDArray[np.float64]:
    """Return allowed points of the unit cube, shape (n, d), moved at random by about 1e-6.

    Equal strings have equal configurations, so a corner that is proposed repeatedly would show no
    noise. Moves are random, as a moved point may be proposed again, and regular moves would meet.
    Where one leaves what is allowed, others are tried in all directions.
    """
    moved = points + PERTURBATION * random.random(points.shape) * (INSIDE - points)
    if space.allowed is None:
        return moved
    for _ in range(MOVES):
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


def duplicates_last(points: NDArray[np.float64], order: NDArray[np.int64]) -> list[int]:
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
