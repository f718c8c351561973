"""What a string is worth: how far the grown particles are from what is wanted.

Examples
--------
Three samples of a string, by the mean radius ratio that each ended with:

>>> from agglom_mpi.search.objectives import GrowthTarget
>>> from agglom_mpi.simulation.outcome import UNFINISHED
>>> samples = [UNFINISHED._replace(completed=True, mean_radius_ratio=r) for r in (1.5, 2.5, 2.6)]
>>> value, error = GrowthTarget(2.0).of_ensemble(samples)
>>> round(value, 3), round(error, 3)
(0.1, 0.176)
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.moments import MomentTargets, Term
from agglom_mpi.search.running import RunningMean
from agglom_mpi.search.worth import MeanTally, Objective, Tally
from agglom_mpi.simulation.outcome import Measured

if TYPE_CHECKING:
    from agglom_mpi.campaign.objective import AnyObjective

Ratio = TypeVar("Ratio", float, NDArray[np.float64])


class RadiusObjective(Objective):
    """An objective that looks at nothing but the mean radius ratios b^f/b⁰ of the samples.

    Both papers' objectives are the magnitude of the ensemble mean of a per-sample deviation.
    So their standard error is that of this mean, by the delta method; at an objective near 0
    the magnitude bends, and the error is that of the signed mean.
    """

    @abstractmethod
    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the per-sample quantity whose ensemble mean is judged, elementwise."""

    def tally(self) -> "RadiusTally":
        """Return a tally of no samples."""
        return RadiusTally(self)

    def of_ratio(self, ratio: Ratio) -> Ratio:
        """Return the objective of single samples by their mean radius ratio, elementwise."""
        return abs(self.deviation(ratio))

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the objective of each sample alone."""
        return self.of_ratio(rows["mean_radius_ratio"])

    def linear(self, outcomes: Sequence[Measured]) -> NDArray[np.float64]:
        """Return the deviations of the samples."""
        return self.deviation(np.array([outcome.mean_radius_ratio for outcome in outcomes]))


class RadiusTally:
    """The running mean of the deviations; its magnitude is the objective."""

    def __init__(self, objective: RadiusObjective) -> None:
        self._objective = objective
        self._mean = RunningMean()

    def add(self, outcome: Measured) -> None:
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


@dataclass(frozen=True)
class GrowthTarget(RadiusObjective):
    """Λ = |b^f/(ratio·b⁰) - 1| of the ensemble's mean radius [A 26]; ratio 2 doubles it."""

    ratio: float = 2.0

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the signed relative miss of the wanted radius."""
        return ratio / self.ratio - 1.0


@dataclass(frozen=True)
class MaximumGrowth(RadiusObjective):
    """Π = |1 - b^f/b*| averaged over samples, b* = b⁰ N^{1/3} one sphere of all [B 7.1]."""

    particles: int

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return Π of the samples."""
        return abs(1.0 - ratio / math.cbrt(self.particles))


def _own(outcome: Measured) -> float:
    return outcome.objective


@dataclass(frozen=True)
class MeanOfFunction(Objective):
    """The mean over samples of what a user's function made of each when it was simulated.

    That number is stored with the sample, so that to decide again takes no code of the user's.
    """

    least: ClassVar[float] = -math.inf

    def tally(self) -> Tally:
        """Return a tally of no samples."""
        return MeanTally(_own)

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return what is stored of each sample."""
        stored: NDArray[np.float64] = rows["objective"]
        return stored

    def linear(self, outcomes: Sequence[Measured]) -> NDArray[np.float64]:
        """Return what is stored of each sample."""
        return np.array([outcome.objective for outcome in outcomes])


MEAN_OF_FUNCTION: Final = MeanOfFunction()


def make_objective(model: "AnyObjective", particles: int) -> Objective:
    """Return the objective that a campaign asks for.

    Parameters
    ----------
    model
        The campaign's `objective`: its `law`, and what that law needs.
    particles
        N, particles a sample starts with.
    """
    if model.law == "growth_target":
        return GrowthTarget(model.ratio)
    if model.law == "maximum_growth":
        return MaximumGrowth(particles)
    if model.law == "moments":
        wanted, weights = model.wanted, model.weighting
        return MomentTargets(tuple(Term(n, t, weights[n]) for n, t in wanted.items()))
    if model.law == "function":
        return MEAN_OF_FUNCTION
    raise ValueError(f"unknown objective {model.law!r}")
