"""Objectives of an ensemble, with their standard errors by the delta method.

Examples
--------
Three samples of a string, by the mean radius ratio that each ended with:

>>> from agglom_mpi.search.objectives import GrowthTarget
>>> from agglom_mpi.outcome import FAILED_SUMMARY
>>> ratios = 1.5, 2.5, 2.6
>>> samples = [FAILED_SUMMARY._replace(completed=True, mean_radius_ratio=r) for r in ratios]
>>> value, error = GrowthTarget(2.0).of_ensemble(samples)
>>> round(value, 3), round(error, 3)
(0.1, 0.176)
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import SampleSummary, summaries
from agglom_mpi.statistics import RunningMean


class ObjectiveAccumulator(Protocol):
    """The completed samples of one string so far, as an objective sees them."""

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""

    @property
    def value(self) -> float:
        """Objective of the samples so far, smaller is better; nan if there are none."""

    @property
    def standard_error(self) -> float:
        """Of the value, by the delta method; nan below two samples."""


class Objective(ABC):
    """A law that turns the completed samples of a string into a number to minimise.

    Attributes
    ----------
    least : float
        No objective is less.
    """

    least: ClassVar[float] = 0.0

    @abstractmethod
    def tally(self) -> ObjectiveAccumulator:
        """Return a tally of no samples."""

    @abstractmethod
    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the objective of each sample alone, shape (n,), of rows with `OUTCOME`'s columns.

        What it gives for a sample that failed means nothing.
        """

    @abstractmethod
    def linear(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return a number of each sample, shape (n,): together they are the ensemble's objective.

        Their mean is the objective, signed where it is a magnitude; the standard error of that
        mean is the objective's, by the delta method. n must be at least 1.
        """

    def of_ensemble(self, outcomes: Iterable[SampleSummary]) -> tuple[float, float]:
        """Return the objective of completed samples and its standard error.

        The error of a single one is nan, and an empty ensemble is worth inf.
        """
        tally = self.tally()
        for outcome in outcomes:
            tally.add(outcome)
        value = tally.value
        return (math.inf, math.nan) if math.isnan(value) else (value, tally.standard_error)

    def of_rows(self, rows: NDArray[np.void]) -> tuple[float, float]:
        """Return the same of rows, (n,), of completed samples; see `outcome.measured`."""
        return self.of_ensemble(summaries(rows))


class MeanAccumulator:
    """The running mean of one number of each sample.

    Parameters
    ----------
    number
        Of a sample.
    """

    def __init__(self, number: Callable[[SampleSummary], float]) -> None:
        self._number = number
        self._mean = RunningMean()

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""
        self._mean.add(self._number(outcome))

    @property
    def value(self) -> float:
        """The mean."""
        return self._mean.mean

    @property
    def standard_error(self) -> float:
        """Standard error of the mean."""
        return self._mean.standard_error


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

    def tally(self) -> "RadiusAccumulator":
        """Return a tally of no samples."""
        return RadiusAccumulator(self)

    def of_ratio(self, ratio: Ratio) -> Ratio:
        """Return the objective of single samples by their mean radius ratio, elementwise."""
        return abs(self.deviation(ratio))

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the objective of each sample alone."""
        return self.of_ratio(rows["mean_radius_ratio"])

    def linear(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return the deviations of the samples."""
        return self.deviation(np.array([outcome.mean_radius_ratio for outcome in outcomes]))


class RadiusAccumulator:
    """The running mean of the deviations; its magnitude is the objective."""

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


def _own(outcome: SampleSummary) -> float:
    return outcome.objective


@dataclass(frozen=True)
class MeanOfFunction(Objective):
    """The mean over samples of what a user's function made of each when it was simulated.

    That number is stored with the sample, so that to decide again takes no code of the user's.
    """

    least: ClassVar[float] = -math.inf

    def tally(self) -> ObjectiveAccumulator:
        """Return a tally of no samples."""
        return MeanAccumulator(_own)

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return what is stored of each sample."""
        stored: NDArray[np.float64] = rows["objective"]
        return stored

    def linear(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return what is stored of each sample."""
        return np.array([outcome.objective for outcome in outcomes])


MEAN_OF_FUNCTION: Final = MeanOfFunction()


def objective_of(entries: Mapping[str, Any], particles: int) -> Objective:
    """Return the objective that a campaign asks for.

    Parameters
    ----------
    entries
        Its `objective` section as plain values, as the section or the identity of a file has it.
    particles
        N, particles a sample starts with.
    """
    match entries["law"]:
        case "growth_target":
            return GrowthTarget(entries["ratio"])
        case "maximum_growth":
            return MaximumGrowth(particles)
        case "moments":
            from agglom_mpi.search.moment_targets import MomentTarget, MomentTargets

            weights = entries["weights"]
            terms = (MomentTarget(n, t, weights[n]) for n, t in entries["targets"].items())
            return MomentTargets(tuple(terms))
        case "function":
            return MEAN_OF_FUNCTION
    raise ValueError(f"unknown objective {entries['law']!r}")
