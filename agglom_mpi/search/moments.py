"""Moments of the final radii by their names [A 24-25, 29], of numbers and elementwise."""

import math
from collections.abc import Mapping
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Central: TypeAlias = tuple[float, float, float]

MOMENTS: Final = ("mean", "spread", "skewness", "kurtosis", "second", "third", "fourth")
"""Moments of the final radii b/b⁰ that may have a target."""
CENTRAL: Final = ("second", "third", "fourth")
NORMALISED: Final = ("skewness", "kurtosis")
NO_SPREAD: Final = 1e-9
"""Spread relative to the mean up to which radii are equal except for rounding: one merge among 1e13
particles makes more."""
HIGHEST_POWERS: Final[Mapping[str, int]] = {
    "spread": 2,
    "second": 2,
    "skewness": 3,
    "third": 3,
    "kurtosis": 4,
    "fourth": 4,
}
"""Highest power of the radii that a moment needs; others need the mean alone."""


def spread_of(mean: float, second: float) -> float:
    """Return the standard deviation of radii, exactly 0 where they differ by rounding alone."""
    spread = math.sqrt(max(second, 0.0))
    return spread if spread > NO_SPREAD * mean else 0.0


def moment(name: str, mean: float, central: Central) -> float:
    """Return a moment by its name, from the mean and the central moments 2, 3, 4.

    Radii without spread have no skewness and no kurtosis. These are inf here, the limit of one
    larger particle among ever more equal ones, so that no target is met by chance.
    """
    second, third, fourth = central
    if name == "mean":
        return mean
    if name in CENTRAL:
        return central[CENTRAL.index(name)]
    spread = spread_of(mean, second)
    if name == "spread":
        return spread
    if spread == 0.0:
        return math.inf
    return third / spread**3 if name == "skewness" else fourth / spread**4


def gradient(name: str, mean: float, central: Central) -> Mapping[str, float]:
    """Return the derivatives of a moment by the mean and the central moments, where not 0."""
    second, third, fourth = central
    if name == "mean" or name in CENTRAL:
        return {name: 1.0}
    spread = spread_of(mean, second)
    if spread == 0.0:
        return {}
    if name == "spread":
        return {"second": 0.5 / spread}
    if name == "skewness":
        return {"third": spread**-3, "second": -1.5 * third * spread**-5}
    return {"fourth": spread**-4, "second": -2.0 * fourth * spread**-6}


def moments_of(name: str, mean: Floats, central: tuple[Floats, Floats, Floats]) -> Floats:
    """Return a moment by its name, elementwise; `moment` is that of numbers."""
    second, third, fourth = central
    if name == "mean":
        return mean
    if name in CENTRAL:
        return central[CENTRAL.index(name)]
    spread = np.sqrt(second)
    if name == "spread":
        return spread
    with np.errstate(divide="ignore", invalid="ignore"):
        value = third / spread**3 if name == "skewness" else fourth / spread**4
    return np.where(spread > 0.0, value, math.inf)
