"""Criteria of membership in a feasible set: numbers of the samples, and their bounds.

A criterion states which numbers of a sample are emulated, which quantities follow from the means of
these, and which quantities make a member. `Objective.criterion` returns that of an objective.
"""

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.errors import UserError
from agglom_mpi.statistics import Floats, probability_between

if TYPE_CHECKING:
    from agglom_mpi.emulation.joint_emulator import JointEmulator, JointFunctions

DRAWN_FUNCTIONS: Final = 256
"""Number of functions drawn jointly for the error of the volume and for the maximum."""


class NoCriterionError(UserError, ValueError):
    """An objective that has no criterion."""


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
    of_ratios : bool
        Whether the emulated numbers are known to be ratios, which have no dimension.
    maximum : tuple of float, or None
        Mean and standard deviation of the maximum of the quantity over the box, where members are
        those near it.
    """

    quantities: tuple[str, ...] = ("mean_radius_ratio",)
    text: str = ""
    is_band: ClassVar[bool] = False
    of_ratios: bool = False
    maximum: tuple[float, float] | None = None

    def with_emulator(
        self,
        emulator: "JointEmulator",
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

    def probability(self, emulator: "JointEmulator", points: Floats) -> Floats:
        """Return the probability that the quantities at points, (m, p), make a member, (m,)."""
        return emulator.probability(points, self.holds)

    def drawn_members(
        self, emulator: "JointEmulator", points: Floats, random: np.random.Generator
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
        self.quantities, self.of_ratios = (column,), column == "mean_radius_ratio"
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

    def probability(self, emulator: "JointEmulator", points: Floats) -> Floats:
        """Return the probability of normally distributed values to lie between the bounds."""
        mean, deviation = emulator.mean(points), emulator.deviation(points)
        return probability_between(self.lower, self.upper, mean[:, 0], deviation[:, 0])


def band_text(lower: float, upper: float) -> str:
    """Return `LOWER to UPPER` with four digits, or with as many as distinguish them."""
    texts = ((f"{lower:.{digits}g}", f"{upper:.{digits}g}") for digits in range(4, 18))
    return " to ".join(next((pair for pair in texts if pair[0] != pair[1]), (f"{lower:g}",) * 2))


class NearMaximum(Band):
    """Mean growth of at least a share of its maximum over the box.

    The maximum is uncertain, too. It is known once there is an emulator: `with_emulator` draws
    functions from the posterior of the mean growth, and finds the maximum of each where the
    expected mean is largest.

    Parameters
    ----------
    tolerance
        One minus the share.
    """

    def __init__(self, tolerance: float) -> None:
        text = f"mean b/b0 at least {1.0 - tolerance:.4g} of its maximum over the box"
        super().__init__("mean_radius_ratio", -math.inf, math.inf, text)
        self.share = 1.0 - tolerance
        self._functions: JointFunctions | None = None
        self._maxima = np.empty(0)

    def with_emulator(
        self,
        emulator: "JointEmulator",
        near_best: Callable[[], Floats],
        random: np.random.Generator,
    ) -> "NearMaximum":
        """Return the criterion with drawn functions and their maxima."""
        drawn = copy.copy(self)
        drawn._functions = emulator.draw(DRAWN_FUNCTIONS, random)
        drawn._maxima = maxima = drawn._functions(near_best())[..., 0].max(axis=1)
        mean = float(maxima.mean())
        drawn.maximum, drawn.lower = (mean, float(maxima.std())), self.share * mean
        return drawn

    @property
    def half_width(self) -> float:
        """Distance of the bound from the mean maximum; nan before that is known."""
        return math.nan if self.maximum is None else (1.0 - self.share) * self.maximum[0]

    def distance(self, compared: Floats) -> Floats:
        """Return the negative of the mean growth."""
        return np.asarray(-compared[..., 0])

    def probability(self, emulator: "JointEmulator", points: Floats) -> Floats:
        """Return the share of the drawn functions that are near their own maximum, (m,)."""
        return np.asarray(self.drawn_members(emulator, points).mean(axis=0))

    def drawn_members(
        self,
        emulator: "JointEmulator",
        points: Floats,
        random: np.random.Generator | None = None,
    ) -> NDArray[np.bool_]:
        """Return where the drawn functions are near their own maximum, (n, m)."""
        assert self._functions is not None
        bounds = self.share * self._maxima
        return np.asarray(self._functions(points)[..., 0] >= bounds[:, None])
