"""Laws of the grains' sizes at the start: drawing, moments, points that stand for a law.

All of them are for radii b over their mean ⟨b⟩ = b⁰, so that the mean is 1.
"""

import math
from statistics import NormalDist
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


class LognormalSizes(NamedTuple):
    """ln b is normal with the standard deviation `log_spread`."""

    log_spread: float


class UniformSizes(NamedTuple):
    """b is uniform from `smallest` to `largest`."""

    smallest: float
    largest: float


class ListedSizes(NamedTuple):
    """b is one of `ratios`, shape (n,), all as likely."""

    ratios: npt.NDArray[np.float64]


SizeLaw: TypeAlias = LognormalSizes | UniformSizes | ListedSizes | None
"""A law of sizes; None: all grains are equal."""

POINTS: Final = 64
"""Radii that stand for a law where pairs of sizes are summed over."""


def draw_radii(law: SizeLaw, random: np.random.Generator, count: int) -> Floats:
    """Return b/b⁰ of `count` grains, shape (count,), the largest first; equal grains draw nothing.

    The largest are placed first, which jams less.
    """
    match law:
        case LognormalSizes():
            spread = law.log_spread
            ratios = np.exp(spread * random.standard_normal(count) - 0.5 * spread**2)
        case UniformSizes():
            ratios = random.uniform(law.smallest, law.largest, count)
        case ListedSizes():
            if law.ratios.min() == law.ratios.max():
                return np.ones(count)
            ratios = law.ratios[random.integers(len(law.ratios), size=count)]
        case None:
            return np.ones(count)
    return np.sort(ratios)[::-1].copy()


def third_moment(law: SizeLaw) -> float:
    """Return ⟨b³⟩/⟨b⟩³: the mean volume over that of the mean radius."""
    match law:
        case LognormalSizes():
            return math.exp(3.0 * law.log_spread**2)
        case UniformSizes():
            return 1.0 + (0.5 * (law.largest - law.smallest)) ** 2
        case ListedSizes():
            return float(np.mean(law.ratios**3))
    return 1.0


def size_classes(law: SizeLaw) -> tuple[Floats, Floats]:
    """Return radii b/b⁰ that stand for a law, and the share of the grains of each, (n,) each.

    Those of a list are exact; of other laws, the middles of `POINTS` classes as likely.
    """
    middles = (np.arange(POINTS) + 0.5) / POINTS
    match law:
        case ListedSizes():
            ratios, counts = np.unique(law.ratios, return_counts=True)
            if len(ratios) <= POINTS:
                return ratios, counts / len(law.ratios)
            return np.quantile(law.ratios, middles), np.full(POINTS, 1.0 / POINTS)
        case LognormalSizes():
            normal, spread = NormalDist(), law.log_spread
            points = np.array([normal.inv_cdf(share) for share in middles.tolist()])
            return np.exp(spread * points - 0.5 * spread**2), np.full(POINTS, 1.0 / POINTS)
        case UniformSizes():
            ratios = law.smallest + middles * (law.largest - law.smallest)
            return ratios, np.full(POINTS, 1.0 / POINTS)
    return np.ones(1), np.ones(1)
