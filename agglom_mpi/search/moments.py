"""Moments of the final radii by their names [A 24-25, 29], and which strings meet their targets."""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.criteria import Criterion
from agglom_mpi.statistics import Central, Floats

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


GRAIN_RADIUS_RATIO: Final = 1.0
"""Radius ratio of single grains, about which sums of powers are taken."""


class MomentBands(Criterion):
    """All moments that have a target, each within a tolerance of it.

    The moments are those of `search.moments`: functions of the means over samples of the
    mean radius ratio, the particles left, and the sums of powers of their radius ratios.

    Parameters
    ----------
    targets
        Targets by name.
    tolerance
        Tolerance relative to the target, or absolute where the target is 0.
    """

    of_ratios = True

    def __init__(self, targets: Mapping[str, float], tolerance: float) -> None:
        self.quantities = tuple(targets)
        self._targets = np.array(list(targets.values()))
        self._half_widths = tolerance * np.where(self._targets == 0.0, 1.0, np.abs(self._targets))
        self._order = max((HIGHEST_POWERS.get(name, 0) for name in targets), default=0)
        wanted = ", ".join(f"{name} {target:g}" for name, target in targets.items())
        self.text = f"each moment within {tolerance:.3g} of its target ({wanted}), jointly"

    def bands(self) -> list[tuple[float, float]]:
        """Return the bounds of each moment."""
        ends = (self._targets - self._half_widths, self._targets + self._half_widths)
        return list(zip(*(end.tolist() for end in ends), strict=True))

    @property
    def scales(self) -> Floats:
        """Tolerance of each moment, shape (q,)."""
        return np.asarray(self._half_widths)

    def distance(self, compared: Floats) -> Floats:
        """Return the largest distance of a moment from its target, in units of its tolerance."""
        return np.asarray((np.abs(compared - self._targets) / self._half_widths).max(axis=-1))

    def numbers(self, rows: NDArray[np.void], particles: int) -> Floats:
        """Return the mean radius ratio, then particles and sums of powers over the first number."""
        mean = np.asarray(rows["mean_radius_ratio"], np.float64)
        if not self._order:
            return mean[:, None]
        m2, m3, m4 = (np.asarray(rows[f"radius_moment_{r}"], np.float64) for r in (2, 3, 4))
        d, share = mean - GRAIN_RADIUS_RATIO, rows["particles"] / particles
        about = [d, m2 + d**2, m3 + 3.0 * d * m2 + d**3]
        about.append(m4 + 4.0 * d * m3 + 6.0 * d**2 * m2 + d**4)
        own = [mean] if "mean" in self.quantities else []
        return np.column_stack([*own, share, *(share * power for power in about[: self._order])])

    def compared(self, means: Floats) -> Floats:
        """Return the moments with targets, (…, q)."""
        if not self._order:
            return means
        own = int("mean" in self.quantities)
        mean, share = means[..., 0], np.maximum(means[..., own], 1e-12)
        powers = [means[..., own + r] / share for r in range(1, self._order + 1)]
        powers += [np.zeros_like(share)] * (4 - len(powers))
        d, s2, s3, s4 = powers
        second = np.maximum(s2 - d**2, 0.0)
        central = (second, s3 - 3.0 * d * s2 + 2.0 * d**3)
        fourth = s4 - 4.0 * d * s3 + 6.0 * d**2 * s2 - 3.0 * d**4
        return np.stack(
            [moments_of(name, mean, (*central, fourth)) for name in self.quantities], axis=-1
        )

    def holds(self, compared: Floats) -> NDArray[np.bool_]:
        """Return which moments, (…, q), are all within their tolerances."""
        return np.asarray((np.abs(compared - self._targets) <= self._half_widths).all(axis=-1))
