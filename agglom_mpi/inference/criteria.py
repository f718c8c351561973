"""What makes a string a member of a feasible set: which numbers of its samples, and their bounds.

A criterion states which numbers of a sample are emulated, which quantities follow from the means of
these, and which quantities make a member. `objective_criteria` states which objective has which.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.emulation.joint_emulator import JointEmulator, JointFunctions
from agglom_mpi.search.moment_targets import CENTRAL
from agglom_mpi.statistics import probability_between

DRAWN_FUNCTIONS: Final = 256
"""Number of functions drawn jointly for the error of the volume and for the maximum."""

GRAIN_RADIUS_RATIO: Final = 1.0
"""Radius ratio of single grains, about which sums of powers are taken."""


HIGHEST_POWERS: Final[Mapping[str, int]] = {
    "spread": 2,
    "second": 2,
    "skewness": 3,
    "third": 3,
    "kurtosis": 4,
    "fourth": 4,
}
"""Highest power of the radii that a moment needs; others need the mean alone."""


class Criterion(ABC):
    """Which emulated means make a string a member of the set.

    Attributes
    ----------
    quantities : tuple of str
        Names of the quantities that are compared, as `mean` and `deviation` of a set return them.
    text : str
        Description of a member, for a person.
    is_band : bool
        Whether the bounds are those of the one emulated number.
    maximum : tuple of float, or None
        Mean and standard deviation of the maximum of the quantity over the box, where members are
        those near it.
    """

    quantities: tuple[str, ...] = ("mean_radius_ratio",)
    text: str = ""
    is_band: ClassVar[bool] = False
    maximum: tuple[float, float] | None = None

    def with_emulator(
        self,
        emulator: JointEmulator,
        near_best: Callable[[], Floats],
        random: np.random.Generator,
    ) -> "Criterion":
        """Return the criterion with what it takes from the emulated quantities.

        Parameters
        ----------
        emulator
        near_best
            Returns points, (m, p), among which the emulated quantities are nearest to members.
        random
            Stream of draws.
        """
        return self

    @abstractmethod
    def bands(self) -> list[tuple[float, float]]:
        """Return the bounds of each quantity in the set, inf where there is none."""

    def bounds(self) -> tuple[float, float]:
        """Return the bounds of the first quantity in the set, inf where there is none."""
        return self.bands()[0]

    @property
    def half_width(self) -> float:
        """Half of the range of the one quantity in the set; nan where it has no scale."""
        return math.nan

    @property
    def scales(self) -> Floats:
        """Size by which changes of each quantity are compared with those of others, shape (q,)."""
        return np.ones(1)

    @abstractmethod
    def distance(self, compared: Floats) -> Floats:
        """Return the distances of quantities, (…, q), from those of members, shape (…).

        Members, too, are ordered by their distances. The unit is the criterion's own.
        """

    @abstractmethod
    def numbers(self, rows: NDArray[np.void], particles: int) -> Floats:
        """Return the k numbers of each sample whose means are emulated, shape (n, k)."""

    def compared(self, means: Floats) -> Floats:
        """Return the quantities, (…, q), of the means of the numbers, (…, k)."""
        return means

    @abstractmethod
    def holds(self, compared: Floats) -> NDArray[np.bool_]:
        """Return which quantities, (…, q), make a member, shape (…)."""

    def probability(self, emulator: JointEmulator, points: Floats) -> Floats:
        """Return the probability that the quantities at points, (m, p), make a member, (m,)."""
        return emulator.probability(points, self.holds)

    def drawn_members(
        self, emulator: JointEmulator, points: Floats, random: np.random.Generator
    ) -> NDArray[np.bool_]:
        """Return which points, (m, p), are members by drawn functions, (`DRAWN_FUNCTIONS`, m)."""
        return self.holds(emulator.draw(DRAWN_FUNCTIONS, random)(points))


class Band(Criterion):
    """One number between two bounds.

    Parameters
    ----------
    column
        Column of the samples that holds the number.
    lower, upper
        The bounds.
    text
        As for `Criterion`.
    """

    is_band = True

    def __init__(self, column: str, lower: float, upper: float, text: str) -> None:
        self.quantities = (column,)
        self.lower, self.upper, self.text = lower, upper, text

    def numbers(self, rows: NDArray[np.void], particles: int) -> Floats:
        """Return the column."""
        return np.asarray(rows[self.quantities[0]], np.float64)[:, None]

    def bands(self) -> list[tuple[float, float]]:
        """Return the bounds."""
        return [(self.lower, self.upper)]

    @property
    def half_width(self) -> float:
        """Half of the distance of the bounds; nan where one of them is infinite."""
        half = 0.5 * (self.upper - self.lower)
        return half if math.isfinite(half) else math.nan

    def holds(self, compared: Floats) -> NDArray[np.bool_]:
        """Return which values lie between the bounds."""
        value = compared[..., 0]
        return np.asarray((value >= self.lower) & (value <= self.upper))

    def distance(self, compared: Floats) -> Floats:
        """Return the distance of values beyond the nearer bound, negative between the bounds."""
        value = compared[..., 0]
        return np.asarray(np.maximum(self.lower - value, value - self.upper))

    def probability(self, emulator: JointEmulator, points: Floats) -> Floats:
        """Return the probability of normally distributed values to lie between the bounds."""
        mean, deviation = emulator.mean(points), emulator.deviation(points)
        return probability_between(self.lower, self.upper, mean[:, 0], deviation[:, 0])


class NearMaximum(Band):
    """Mean growth of at least a share of its maximum over the box.

    The maximum is known once there is an emulator: `with_emulator` draws functions, and finds the
    maximum of each where the expected mean is largest.

    Parameters
    ----------
    tolerance
        One minus the share.
    """

    def __init__(self, tolerance: float) -> None:
        text = f"mean b/b0 at least {1.0 - tolerance:.4g} of its maximum over the box"
        super().__init__("mean_radius_ratio", -math.inf, math.inf, text)
        self.tolerance = tolerance
        self.share = 1.0 - tolerance

    def with_emulator(
        self,
        emulator: JointEmulator,
        near_best: Callable[[], Floats],
        random: np.random.Generator,
    ) -> "NearDrawnMaximum":
        """Return the criterion with drawn functions and their maxima."""
        functions = emulator.draw(DRAWN_FUNCTIONS, random)
        maxima = functions(near_best())[..., 0].max(axis=1)
        return NearDrawnMaximum(self.tolerance, functions, maxima)

    def distance(self, compared: Floats) -> Floats:
        """Return the negative of the mean growth."""
        return np.asarray(-compared[..., 0])


class NearDrawnMaximum(NearMaximum):
    """Mean growth near its maximum over the box, which is uncertain, too.

    Parameters
    ----------
    tolerance
        One minus the minimum share of the maximum.
    functions
        n functions drawn from the posterior of the mean growth.
    maxima
        Maximum of each over the box, shape (n,).
    """

    def __init__(self, tolerance: float, functions: JointFunctions, maxima: Floats) -> None:
        super().__init__(tolerance)
        self._functions, self._maxima = functions, maxima
        mean = float(maxima.mean())
        self.maximum, self.lower = (mean, float(maxima.std())), self.share * mean
        self._half_width = (1.0 - self.share) * mean

    @property
    def half_width(self) -> float:
        """Distance of the bound from the mean maximum."""
        return self._half_width

    def probability(self, emulator: JointEmulator, points: Floats) -> Floats:
        """Return the share of the drawn functions that are near their own maximum, (m,)."""
        return np.asarray(self._near_own_maximum(points).mean(axis=0))

    def drawn_members(
        self, emulator: JointEmulator, points: Floats, random: np.random.Generator
    ) -> NDArray[np.bool_]:
        """Return where the drawn functions are near their own maximum, (n, m)."""
        return self._near_own_maximum(points)

    def _near_own_maximum(self, points: Floats) -> NDArray[np.bool_]:
        bounds = self.share * self._maxima
        return np.asarray(self._functions(points)[..., 0] >= bounds[:, None])


class MomentBands(Criterion):
    """All moments that have a target, each within a tolerance of it.

    The moments are those of `search.moment_targets`: functions of the means over samples of the
    mean radius ratio, the particles left, and the sums of powers of their radius ratios.

    Parameters
    ----------
    targets
        Targets by name.
    tolerance
        Tolerance relative to the target, or absolute where the target is 0.
    """

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
            [_moment(name, mean, (*central, fourth)) for name in self.quantities], axis=-1
        )

    def holds(self, compared: Floats) -> NDArray[np.bool_]:
        """Return which moments, (…, q), are all within their tolerances."""
        return np.asarray((np.abs(compared - self._targets) <= self._half_widths).all(axis=-1))


def _moment(name: str, mean: Floats, central: tuple[Floats, Floats, Floats]) -> Floats:
    """Return a moment by its name, elementwise; `moment_targets.moment` is that of numbers."""
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
