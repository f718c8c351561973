"""Objectives of the mean growth of the grains, those of both papers.

Examples
--------
Three samples of a string, by the mean radius ratio that each ended with:

>>> from agglom_mpi.search.growth_objectives import GrowthTarget
>>> from agglom_mpi.outcome import FAILED_SUMMARY
>>> ratios = 1.5, 2.5, 2.6
>>> samples = [FAILED_SUMMARY._replace(completed=True, mean_radius_ratio=r) for r in ratios]
>>> value, error = GrowthTarget(ratio=2.0).of_ensemble(samples)
>>> round(value, 3), round(error, 3)
(0.1, 0.176)
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.sections import FieldPath
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.objectives import Objective
from agglom_mpi.statistics import RunningMean

Ratio = TypeVar("Ratio", float, NDArray[np.float64])


class RadiusObjective(Objective):
    """An objective that depends on the mean radius ratios b^f/b⁰ of the samples alone.

    Both papers' objectives are the magnitude of the ensemble mean of a per-sample deviation.
    So their standard error is that of this mean, by the delta method; at an objective near 0
    the magnitude bends, and the error is that of the signed mean.
    """

    @property
    def by_mean_radius(self) -> Self:
        """The objective itself."""
        return self

    @abstractmethod
    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the per-sample quantity whose ensemble mean counts, elementwise."""

    def accumulator(self) -> "RadiusAccumulator":
        """Return an accumulator without samples."""
        return RadiusAccumulator(self)

    def of_ratio(self, ratio: Ratio) -> Ratio:
        """Return the objective of single samples by their mean radius ratio, elementwise."""
        return abs(self.deviation(ratio))

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the objective of each sample alone."""
        return self.of_ratio(rows["mean_radius_ratio"])

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return the deviations of the samples."""
        return self.deviation(np.array([outcome.mean_radius_ratio for outcome in outcomes]))


class RadiusAccumulator:
    """Running mean of the deviations, whose magnitude is the objective."""

    def __init__(self, objective: RadiusObjective) -> None:
        self._objective = objective
        self._mean = RunningMean()

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""
        self._mean.add(self._objective.deviation(outcome.mean_radius_ratio))

    @property
    def value(self) -> float:
        """Magnitude of the mean."""
        return abs(self._mean.mean)

    @property
    def standard_error(self) -> float:
        """Standard error of the mean."""
        return self._mean.standard_error


class GrowthTarget(RadiusObjective):
    """Distance of the mean growth from a wanted one: Λ = |mean b/b⁰ / ratio - 1| [A 26].

    Attributes
    ----------
    ratio
        Wanted mean of b/b⁰; 2 doubles the radius.
    """

    is_magnitude: ClassVar[bool] = True
    has_target: ClassVar[bool] = True
    symbol: ClassVar[str] = "Λ"
    law: Literal["growth_target"] = "growth_target"
    ratio: Annotated[float, In("1", at_least=1)] = 2.0

    @property
    def summary(self) -> str:
        """One line on the objective."""
        return f"mean radius ratio {self.ratio:g}, |mean/{self.ratio:g} - 1| [A 26]"

    @property
    def wanted_growth(self) -> tuple[FieldPath, float]:
        """The wanted mean of b/b⁰ with its field."""
        return ("ratio",), self.ratio

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the signed relative deviation from the target radius."""
        return ratio / self.ratio - 1.0

    def signed(self, objective: float, mean_radius_ratio: float) -> float:
        """Return the signed relative deviation of a string from the target radius."""
        return self.deviation(mean_radius_ratio)


class MaximumGrowth(RadiusObjective):
    """Distance of the mean growth from one single aggregate: Π = |1 - b/b*| [B 7.1].

    It is averaged over samples; b* = b⁰ N^{1/3} is the radius of one sphere of all grains.
    """

    symbol: ClassVar[str] = "Π"
    law: Literal["maximum_growth"] = "maximum_growth"

    @property
    def summary(self) -> str:
        """One line on the objective."""
        return "greatest growth, |1 - mean radius ratio / N^(1/3)| [B 7.1]"

    @property
    def wanted_growth(self) -> tuple[FieldPath, float]:
        """That of a single aggregate, which no field of its own states."""
        return (), self._grains ** (1.0 / 3.0)

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return Π of the samples."""
        return abs(1.0 - ratio / math.cbrt(self._grains))
