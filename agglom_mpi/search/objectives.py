"""What a string is worth: how far the grown particles are from what is wanted."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from agglom_mpi.campaign.plan import AnyObjective

Ratio = TypeVar("Ratio", float, NDArray[np.float64])


class Objective(ABC):
    """A law that turns mean radius ratios b^f/b⁰ of samples into a number to minimise.

    Both papers' objectives are the magnitude of the ensemble mean of a per-sample deviation.
    So their standard error is that of this mean, by the delta method; at an objective near 0
    the magnitude bends, and the error is that of the signed mean.
    """

    @abstractmethod
    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the per-sample quantity whose ensemble mean is judged, elementwise."""

    def of_sample(self, ratio: Ratio) -> Ratio:
        """Return the objective of single samples, elementwise."""
        return abs(self.deviation(ratio))

    def of_ensemble(self, ratios: NDArray[np.float64]) -> tuple[float, float]:
        """Return the objective of an ensemble and its standard error.

        Parameters
        ----------
        ratios
            Mean radius ratios of the samples, shape (E,). The error of a single one is nan, and
            an empty ensemble is worth inf.
        """
        if ratios.size == 0:
            return math.inf, math.nan
        deviations = self.deviation(ratios)
        value = abs(float(np.mean(deviations)))
        if ratios.size == 1:
            return value, math.nan
        return value, float(np.std(deviations, ddof=1)) / math.sqrt(ratios.size)


@dataclass(frozen=True)
class GrowthTarget(Objective):
    """Λ = |b^f/(ratio·b⁰) - 1| of the ensemble's mean radius [A 26]; ratio 2 doubles it."""

    ratio: float = 2.0

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the signed relative miss of the wanted radius."""
        return ratio / self.ratio - 1.0


@dataclass(frozen=True)
class MaximumGrowth(Objective):
    """Π = |1 - b^f/b*| averaged over samples, b* = b⁰ N^{1/3} one sphere of all [B 7.1]."""

    particles: int

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return Π of the samples."""
        return abs(1.0 - ratio / math.cbrt(self.particles))


def make_objective(model: "AnyObjective", particles: int) -> Objective:
    """Return the objective that a campaign asks for.

    Parameters
    ----------
    model
        The campaign's `objective`: its `law`, and the `ratio` of a growth target.
    particles
        N, particles a sample starts with.
    """
    if model.law == "growth_target":
        return GrowthTarget(model.ratio)
    if model.law == "maximum_growth":
        return MaximumGrowth(particles)
    raise ValueError(f"unknown objective {model.law!r}")
