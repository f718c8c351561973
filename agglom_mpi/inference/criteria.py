"""What makes a string compatible with the question of its campaign: a criterion an objective.

Each says which numbers of a sample are emulated, and which of their means make a member.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.arguments import read_amount, read_fraction, shown
from agglom_mpi.search.moment_targets import CENTRAL
from agglom_mpi.statistics import probability_between

Floats = NDArray[np.float64]

ORIGIN: Final = 1.0
"""Radius ratio about which sums of powers are taken: that of single grains."""


class Criterion(ABC):
    """Which emulated means make a string a member of the set.

    Attributes
    ----------
    quantities : tuple of str
        Names of what is compared, as `mean` and `deviation` return it.
    text : str
        What a member is, for a person.
    """

    quantities: tuple[str, ...] = ("mean_radius_ratio",)
    text: str = ""

    def bounds(self, maximum: float = math.nan) -> tuple[float, float]:
        """Return the bounds of the first quantity in the set, inf where there is none.

        Parameters
        ----------
        maximum
            Of that quantity over the box, where the criterion is relative to it.
        """
        return -math.inf, math.inf

    def bands(self, maximum: float = math.nan) -> list[tuple[float, float]]:
        """Return the bounds of each quantity in the set; argument as for `bounds`."""
        return [self.bounds(maximum)]

    @abstractmethod
    def distance(self, compared: Floats) -> Floats:
        """Return how far values, (..., q), are from those of members, shape (...).

        It is less the nearer they are, also among members; its unit is the criterion's own.
        """

    @abstractmethod
    def numbers(self, rows: NDArray[np.void], particles: int) -> Floats:
        """Return the k numbers of each sample whose means are emulated, shape (n, k)."""

    def compared(self, means: Floats) -> Floats:
        """Return what is compared, (..., q), of the means of the numbers, (..., k)."""
        return means

    @abstractmethod
    def holds(self, compared: Floats) -> NDArray[np.bool_]:
        """Return which values, (..., q), make a member, shape (...)."""


class Band(Criterion):
    """One number between two bounds.

    Parameters
    ----------
    column
        Of the samples.
    lower, upper
        The bounds.
    text
    """

    def __init__(self, column: str, lower: float, upper: float, text: str) -> None:
        self.quantities = (column,)
        self.lower, self.upper, self.text = lower, upper, text

    def numbers(self, rows: NDArray[np.void], particles: int) -> Floats:
        """Return the column."""
        return np.asarray(rows[self.quantities[0]], np.float64)[:, None]

    def holds(self, compared: Floats) -> NDArray[np.bool_]:
        """Return which values lie between the bounds."""
        value = compared[..., 0]
        return np.asarray((value >= self.lower) & (value <= self.upper))

    def distance(self, compared: Floats) -> Floats:
        """Return by how much the value is beyond the nearer bound, negative between them."""
        value = compared[..., 0]
        return np.asarray(np.maximum(self.lower - value, value - self.upper))

    def bounds(self, maximum: float = math.nan) -> tuple[float, float]:
        """Return the bounds."""
        return self.lower, self.upper

    def probability(self, mean: Floats, deviation: Floats) -> Floats:
        """Return the probability of normally distributed values to lie between the bounds."""
        return probability_between(self.lower, self.upper, mean, deviation)


class NearMaximum(Band):
    """The mean growth within a share of its maximum over the box, which is uncertain too."""

    def __init__(self, tolerance: float) -> None:
        text = f"mean b/b0 at least {1.0 - tolerance:.4g} of its maximum over the box"
        super().__init__("mean_radius_ratio", -math.inf, math.inf, text)
        self.share = 1.0 - tolerance

    def distance(self, compared: Floats) -> Floats:
        """Return the negative of the mean growth."""
        return np.asarray(-compared[..., 0])

    def bounds(self, maximum: float = math.nan) -> tuple[float, float]:
        """Return the share of the maximum, and inf."""
        return self.share * maximum, math.inf


class MomentBands(Criterion):
    """Every moment that has a target within a tolerance of it.

    The moments are those of `search.moment_targets`: functions of the means over samples of the
    mean radius ratio, the particles left, and the sums of powers of their radius ratios.

    Parameters
    ----------
    targets
        Targets by name.
    tolerance
        Relative to the target, or absolute where the target is 0.
    """

    highest: ClassVar[Mapping[str, int]] = {
        "spread": 2,
        "second": 2,
        "skewness": 3,
        "third": 3,
        "kurtosis": 4,
        "fourth": 4,
    }

    def __init__(self, targets: Mapping[str, float], tolerance: float) -> None:
        self.quantities = tuple(targets)
        self._targets = np.array(list(targets.values()))
        self.half_widths = tolerance * np.where(self._targets == 0.0, 1.0, np.abs(self._targets))
        self._order = max((self.highest.get(name, 0) for name in targets), default=0)
        wanted = ", ".join(f"{name} {target:g}" for name, target in targets.items())
        self.text = f"each moment within {tolerance:.3g} of its target ({wanted}), jointly"

    def bounds(self, maximum: float = math.nan) -> tuple[float, float]:
        """Return those of the first moment."""
        return self.bands()[0]

    def bands(self, maximum: float = math.nan) -> list[tuple[float, float]]:
        """Return those of each moment."""
        ends = (self._targets - self.half_widths, self._targets + self.half_widths)
        return list(zip(*(end.tolist() for end in ends), strict=True))

    def distance(self, compared: Floats) -> Floats:
        """Return the largest distance of a moment from its target, in units of its tolerance."""
        return np.asarray((np.abs(compared - self._targets) / self.half_widths).max(axis=-1))

    def numbers(self, rows: NDArray[np.void], particles: int) -> Floats:
        """Return the mean radius ratio, then particles and sums of powers over the first number."""
        mean = np.asarray(rows["mean_radius_ratio"], np.float64)
        if not self._order:
            return mean[:, None]
        m2, m3, m4 = (np.asarray(rows[f"radius_moment_{r}"], np.float64) for r in (2, 3, 4))
        d, share = mean - ORIGIN, rows["particles"] / particles
        about = [d, m2 + d**2, m3 + 3.0 * d * m2 + d**3]
        about.append(m4 + 4.0 * d * m3 + 6.0 * d**2 * m2 + d**4)
        own = [mean] if "mean" in self.quantities else []
        return np.column_stack([*own, share, *(share * power for power in about[: self._order])])

    def compared(self, means: Floats) -> Floats:
        """Return the moments with targets, (..., q)."""
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
        """Return which strings have all moments within the tolerance."""
        return np.asarray((np.abs(compared - self._targets) <= self.half_widths).all(axis=-1))


def _moment(name: str, mean: Floats, central: tuple[Floats, Floats, Floats]) -> Floats:
    """Return a moment by its name, elementwise, as `moment_targets.moment` for numbers."""
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


def read_tolerance(objective: Mapping[str, Any], tolerance: float | str) -> float:
    """Return the tolerance of an objective, given as a number or a text such as `5%`.

    It is a fraction between 0 and 1, unless it is no fraction of anything: of moments whose targets
    are all 0 it is positive, of a function any number.

    Raises
    ------
    ValueError
        If it is something else.
    """
    if objective["law"] == "function":
        return read_amount(tolerance).value
    targets = objective.get("targets", {})
    if targets and not any(targets.values()):
        value = read_amount(tolerance).value
        if value <= 0.0:
            raise ValueError(f"is {shown(tolerance)}; must be greater than 0")
        return value
    return read_fraction(tolerance)


def criterion_of(objective: Mapping[str, Any], tolerance: float) -> Criterion:
    """Return the criterion of an objective.

    Parameters
    ----------
    objective
        Section of the campaign as plain values.
    tolerance
        Relative to the target or to the maximum; of a function, its largest value.
    """
    match objective["law"]:
        case "growth_target":
            ratio = float(objective["ratio"])
            lower, upper = ratio * (1.0 - tolerance), ratio * (1.0 + tolerance)
            text = f"mean b/b0 {_ends(lower, upper)}"
            return Band("mean_radius_ratio", lower, upper, text)
        case "maximum_growth":
            return NearMaximum(tolerance)
        case "moments":
            return MomentBands(objective["targets"], tolerance)
    text = f"mean value of the function at most {tolerance:.4g}"
    return Band("objective", -math.inf, tolerance, text)


def _ends(lower: float, upper: float) -> str:
    """Return `LOWER to UPPER`, to four digits or as many as tell them apart."""
    texts = ((f"{lower:.{digits}g}", f"{upper:.{digits}g}") for digits in range(4, 18))
    return " to ".join(next((pair for pair in texts if pair[0] != pair[1]), (f"{lower:g}",) * 2))
