"""Where to look next, and what is best so far, by a model of what is known."""

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from agglom_mpi.search.gaussian_process import GaussianProcess

CANDIDATES: Final = 1200
"""Points at which functions are compared; the time of a draw grows with the cube."""

PROMISING: Final = 10
"""Strings around which half of the candidates lie."""

STEP: Final = 0.15
"""Standard deviation of a candidate about a promising string, in units of the box."""

NUDGE: Final = 1e-6
"""Share of the way to a point within the box that a string is moved at most."""

INSIDE: Final = 0.381966
"""Where that point is, by each component: nowhere that anybody would ask for twice."""

DUPLICATES: Final = 1e-4
"""Strings that differ by less, in units of the box, are ranked as one."""

POLISHED: Final = 5
"""Strings from which the best expected value is looked for."""

SMALLEST: Final = 1e-300
"""What a deviation is divided by at least."""


def candidates_about(
    promising: NDArray[np.float64], random: np.random.Generator
) -> NDArray[np.float64]:
    """Points of the unit cube at which to compare functions, shape (`CANDIDATES`, d).

    Half are anywhere, a quarter near a promising point, and a quarter is one of those with some
    components moved to the faces of the box, where optima of bounded problems often are.
    """
    quarter, dimensions = CANDIDATES // 4, promising.shape[1]
    anywhere = random.random((2 * quarter, dimensions))
    near, moved = promising[random.integers(len(promising), size=(2, quarter))]
    near = np.clip(near + STEP * random.normal(size=near.shape), 0.0, 1.0)
    faces = random.integers(2, size=moved.shape).astype(np.float64)
    moved = np.where(random.random(moved.shape) < 0.5, moved, faces)
    return np.vstack((anywhere, near, moved))


def best_expected(
    model: "GaussianProcess", starts: NDArray[np.float64], magnitude: bool
) -> NDArray[np.float64]:
    """Find the point near one of the starts, shape (m, d), that is expected to be best: (d,).

    Of a magnitude it is the one that comes nearest to a zero and is best known there.
    """
    from scipy.optimize import minimize

    def smooth(point: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        value, slope = model.mean_and_slope(point)
        return (value**2, 2.0 * value * slope) if magnitude else (value, slope)

    bounds = [(0.0, 1.0)] * starts.shape[1]
    ends = [minimize(smooth, at, jac=True, bounds=bounds, method="L-BFGS-B").x for at in starts]
    points = np.vstack((ends, starts))
    expected = expected_objective(model.mean(points), model.deviation(points), magnitude)
    return np.asarray(points[np.argmin(expected)])


def expected_objective(
    mean: NDArray[np.float64], deviation: NDArray[np.float64], magnitude: bool
) -> NDArray[np.float64]:
    """Return the expected objective of a normally distributed signed mean, elementwise.

    That of a magnitude is the mean of a folded normal distribution (Leone, Nelson and Nottingham
    1961): a zero that is hardly known is worth little.
    """
    if not magnitude:
        return mean
    from scipy.special import erf

    away = mean / np.maximum(deviation, SMALLEST)
    spread = math.sqrt(2.0 / math.pi) * deviation * np.exp(-0.5 * away**2)
    return np.asarray(spread + mean * erf(away / math.sqrt(2.0)))


def nudged(points: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Move points of the unit cube so little that nothing but bits change.

    Equal strings have equal configurations, and a corner that is proposed again and again would
    show no noise. Points move by chance, as a moved one may be proposed again, and moves that add
    up in a regular way would meet.
    """
    return points + NUDGE * random.random(points.shape) * (INSIDE - points)


def duplicates_last(points: NDArray[np.float64], order: NDArray[np.int64]) -> list[int]:
    """Put points, in an order of their places, that are nearly equal to earlier ones at the end."""
    seen: set[bytes] = set()
    distinct: list[int] = []
    twins: list[int] = []
    for place in order.tolist():
        cell = np.rint(points[place] / DUPLICATES).tobytes()
        (twins if cell in seen else distinct).append(place)
        seen.add(cell)
    return distinct + twins
