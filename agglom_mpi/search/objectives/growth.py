"""Objectives of the mean growth of the grains, those of both papers.

Examples
--------
Three samples of a string, by the mean radius ratio that each ended with:

>>> from agglom_mpi.search.objectives.growth import GrowthTarget
>>> from agglom_mpi.outcome import FAILED_SUMMARY
>>> ratios = 1.5, 2.5, 2.6
>>> samples = [FAILED_SUMMARY._replace(completed=True, mean_radius_ratio=r) for r in ratios]
>>> value, error = GrowthTarget(ratio=2.0).of_ensemble(samples)
>>> round(value, 3), round(error, 3)
(0.1, 0.176)
"""

import math
from typing import Annotated, ClassVar, Literal

from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.search.criteria import Band, Criterion, NearMaximum, band_text
from agglom_mpi.search.objectives.objective import RadiusObjective, Ratio


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

    @property
    def reference(self) -> float:
        """The wanted mean of b/b⁰."""
        return self.ratio

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the signed relative deviation from the target radius."""
        return ratio / self.ratio - 1.0

    def criterion(self, tolerance: float) -> Criterion:
        """Return the criterion of a mean growth within a relative tolerance of the target."""
        lower, upper = self.ratio * (1.0 - tolerance), self.ratio * (1.0 + tolerance)
        text = f"mean b/b0 {band_text(lower, upper)}"
        return Band("mean_radius_ratio", lower, upper, text)

    def signed(self, objective: float, mean_radius_ratio: float) -> float:
        """Return the signed relative deviation of a string from the target radius."""
        return self.deviation(mean_radius_ratio)


class MaximumGrowth(RadiusObjective):
    """Distance of the mean growth from one single aggregate: Π = |1 - b/b*| [B 7.1].

    It is averaged over samples; b* = b⁰ N^{1/3} is the radius of one sphere of all grains.
    """

    counts_grains: ClassVar[bool] = True
    symbol: ClassVar[str] = "Π"
    law: Literal["maximum_growth"] = "maximum_growth"

    @property
    def summary(self) -> str:
        """One line on the objective."""
        return "greatest growth, |1 - mean radius ratio / N^(1/3)| [B 7.1]"

    @property
    def wanted_growth(self) -> tuple[FieldPath, float]:
        """Growth of a single aggregate of all grains; no field states it."""
        return (), self._grains ** (1.0 / 3.0)

    def criterion(self, tolerance: float) -> Criterion:
        """Return the criterion that the mean growth is near its maximum over the box."""
        return NearMaximum(tolerance)

    @property
    def reference(self) -> float:
        """b/b⁰ of a single aggregate of all grains."""
        return math.cbrt(self._grains)

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return Π of the samples."""
        return abs(1.0 - ratio / math.cbrt(self._grains))
