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
from typing import Any, ClassVar, Final, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.formatting import ROUNDING, value_with_error
from agglom_mpi.outcome import SampleSummary, summaries
from agglom_mpi.statistics import RunningMean


class ReachedMoment(NamedTuple):
    """A moment of the final radii that an objective has a target for, and what was reached.

    Attributes
    ----------
    name, target, weight
        As in the objective.
    value, error
        Of the samples, with its standard error; nan below two samples.
    miss
        Its share of the objective.
    """

    name: str
    target: float
    weight: float
    value: float
    error: float
    miss: float

    def __str__(self) -> str:
        return (
            f"{value_with_error(self.value, self.error)}, wanted {self.target:g}, adds "
            f"{self.miss:.3g} to the objective"
        )

    def as_dict(self) -> dict[str, float | None]:
        """Return all but the name as plain values; nan and inf become None."""
        numbers = {name: getattr(self, name) for name in self._fields[1:]}
        return {name: value if math.isfinite(value) else None for name, value in numbers.items()}


class ObjectiveAccumulator(Protocol):
    """Accumulates the objective of completed samples of one string, with its standard error."""

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""

    @property
    def value(self) -> float:
        """Objective of the samples so far, smaller is better; nan if there are none."""

    @property
    def standard_error(self) -> float:
        """Of the value, by the delta method; nan below two samples."""


class Objective(ABC):
    """A function of the completed samples of a string that is minimised.

    Attributes
    ----------
    least : float
        Lower bound of the objective.
    """

    least: ClassVar[float] = 0.0

    @property
    def scale(self) -> float:
        """Size of the numbers whose difference the objective is: 1 of a ratio less 1; 0 unknown."""
        return 1.0

    def rounding(self, values: ArrayLike) -> float:
        """Return the largest difference of objectives, (n,), that is rounding and no result.

        Reports take objectives that differ by less for equal; the decisions of a search do not.
        """
        sizes = np.abs(np.asarray(values, np.float64))
        return ROUNDING * max(self.scale, float(sizes[np.isfinite(sizes)].max(initial=0.0)))

    @abstractmethod
    def accumulator(self) -> ObjectiveAccumulator:
        """Return an accumulator without samples."""

    @abstractmethod
    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the objective of each sample alone, shape (n,).

        Parameters
        ----------
        rows
            Samples with the columns of `OUTCOME`, shape (n,). The objective of one that failed has
            no meaning.
        """

    @abstractmethod
    def influence_values(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return one value of each of n > 0 samples, shape (n,), whose mean is the objective.

        It is signed where the objective is a magnitude, and the standard error of the mean is that
        of the objective, by the delta method: objective plus influence function.
        """

    def of_ensemble(self, outcomes: Iterable[SampleSummary]) -> tuple[float, float]:
        """Return the objective of completed samples and its standard error.

        The error of a single one is nan; without samples they are inf and nan.
        """
        accumulator = self.accumulator()
        for outcome in outcomes:
            accumulator.add(outcome)
        value = accumulator.value
        return (math.inf, math.nan) if math.isnan(value) else (value, accumulator.standard_error)

    def reached(self, outcomes: Sequence[SampleSummary]) -> tuple[ReachedMoment, ...]:
        """Return each moment with a target of its own, as completed samples have it."""
        return ()

    def of_rows(self, rows: NDArray[np.void]) -> tuple[float, float]:
        """Return the same of rows of completed samples, (n,); see `outcome.summaries`."""
        return self.of_ensemble(summaries(rows))


class MeanAccumulator:
    """Running mean of one number of each sample.

    Parameters
    ----------
    number
        Returns it.
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
    """An objective that depends on the mean radius ratios b^f/b⁰ of the samples alone.

    Both papers' objectives are the magnitude of the ensemble mean of a per-sample deviation.
    So their standard error is that of this mean, by the delta method; at an objective near 0
    the magnitude bends, and the error is that of the signed mean.
    """

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


@dataclass(frozen=True)
class GrowthTarget(RadiusObjective):
    """Λ = |b^f/(ratio·b⁰) - 1| of the ensemble's mean radius [A 26]; ratio 2 doubles it."""

    ratio: float = 2.0

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the signed relative deviation from the target radius."""
        return ratio / self.ratio - 1.0


@dataclass(frozen=True)
class MaximumGrowth(RadiusObjective):
    """Π = |1 - b^f/b*| averaged over samples, b* = b⁰ N^{1/3} one sphere of all [B 7.1]."""

    particles: float

    def deviation(self, ratio: Ratio) -> Ratio:
        """Return Π of the samples."""
        return abs(1.0 - ratio / math.cbrt(self.particles))


def _stored_objective(outcome: SampleSummary) -> float:
    return outcome.objective


@dataclass(frozen=True)
class MeanOfFunction(Objective):
    """Mean over samples of a user's function, evaluated when each was simulated.

    The values are stored with the samples, so that a replay needs no code of the user's.
    """

    least: ClassVar[float] = -math.inf

    @property
    def scale(self) -> float:
        """Unknown: the function may compare anything."""
        return 0.0

    def accumulator(self) -> ObjectiveAccumulator:
        """Return an accumulator without samples."""
        return MeanAccumulator(_stored_objective)

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the stored value of each sample."""
        stored: NDArray[np.float64] = rows["objective"]
        return stored

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return the stored value of each sample."""
        return np.array([outcome.objective for outcome in outcomes])


MEAN_OF_FUNCTION: Final = MeanOfFunction()


def objective_of(entries: Mapping[str, Any], particles: float) -> Objective:
    """Return the objective of a campaign.

    Parameters
    ----------
    entries
        Its `objective` section as plain values, as the section or the identity of a file has it.
    particles
        N, particles of the radius b⁰ that have the volume of those at the start of a sample.

    Raises
    ------
    ValueError
        If there is no such objective.
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
