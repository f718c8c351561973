"""Objectives: what a search minimises, with standard errors by the delta method.

An objective is a subclass of `Objective` in a module of this package: its numbers in a campaign
file, its accumulator over the samples of a string, and what the rest of the program asks it.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.declaration.components import Component
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.formatting import ROUNDING, value_with_error
from agglom_mpi.outcome import SampleSummary, summaries
from agglom_mpi.search.criteria import Criterion, NoCriterionError
from agglom_mpi.statistics import Floats, RunningMean


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
        """Standard error of the value, by the delta method; nan below two samples."""


class Objective(Component):
    """Base class of the objectives, functions of the completed samples of a string.

    Attributes
    ----------
    least
        Lower bound of the objective.
    is_magnitude
        Whether it is the magnitude of the `signed` mean, which is 0 on the target.
    has_target
        Whether it is 0 where its targets are met.
    counts_grains
        Whether it contains the number of grains itself.
    has_moments
        Whether it has targets for single moments, which `reached` returns.
    needs_data
        Whether it compares samples with the section `data`.
    rules
        Names of the stopping rules that may go with it; None: all.
    symbol
        The papers' name of it.
    """

    found_in: ClassVar[str] = "agglom_mpi.search.objectives"
    least: ClassVar[float] = 0.0
    is_magnitude: ClassVar[bool] = False
    has_target: ClassVar[bool] = False
    counts_grains: ClassVar[bool] = False
    has_moments: ClassVar[bool] = False
    needs_data: ClassVar[bool] = False
    rules: ClassVar[tuple[str, ...] | None] = None
    symbol: ClassVar[str] = ""
    _grains: float = math.nan

    def of_grains(self, grains: float) -> Self:
        """Return the objective of samples that start with `grains` grains of the radius b⁰.

        Grains of different sizes are counted by their volume.
        """
        bound = self.model_copy()
        bound.__dict__["_grains"] = grains
        return bound

    def of_string(self, string: Any) -> Self:
        """Return the objective of the samples of a string, by what its censuses refer to."""
        return self

    @property
    def wanted_growth(self) -> tuple[FieldPath, float] | None:
        """Wanted mean of b/b⁰ with its field; None if there is none."""
        return None

    @property
    def code(self) -> str | None:
        """The user's function that evaluates samples, `module:function`; None: no such function."""
        return None

    @property
    def code_of_means(self) -> str:
        """The user's function that makes the objective of the means of quantities; empty: none."""
        return ""

    @property
    def quantity_units(self) -> Mapping[str, str]:
        """SI units of the quantities that the user's function returns of a sample, by name."""
        return {}

    def with_code(self, of_means: Callable[[Mapping[str, Any]], Any] | None) -> Self:
        """Return the objective with the function `code_of_means`; None: it is not run here."""
        return self

    @property
    def tolerance_limits(self) -> tuple[float, float]:
        """Limits of a tolerance of the feasible set, both excluded; 1 of a fraction."""
        return 0.0, 1.0

    def criterion(self, tolerance: float) -> Criterion:
        """Return the criterion of the feasible set of an objective.

        Parameters
        ----------
        tolerance
            Number within `tolerance_limits`.

        Raises
        ------
        NoCriterionError
            If the objective has none.
        """
        raise NoCriterionError(f"the objective {self.name!r} has no feasible set")

    @property
    def notes(self) -> list[str]:
        """Notes on its standard errors for readers."""
        return []

    @property
    def why_infinite(self) -> str:
        """Reason for an infinite objective of samples that completed."""
        return "the objective of every string is infinite"

    @property
    def scale(self) -> float:
        """Size of the numbers whose difference the objective is: 1 of a ratio less 1; 0 unknown."""
        return 1.0

    def signed(self, objective: float, mean_radius_ratio: float) -> float:
        """Return the signed mean whose magnitude is the objective of a string, or the objective."""
        return objective

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
    def of_samples(self, rows: NDArray[np.void]) -> Floats:
        """Return the objective of each sample alone, shape (n,).

        Parameters
        ----------
        rows
            Samples with the columns of `OUTCOME`, shape (n,). The objective of one that failed has
            no meaning.
        """

    @abstractmethod
    def influence_values(self, outcomes: Sequence[SampleSummary]) -> Floats:
        """Return one value of each of n > 0 samples, shape (n,), whose mean is the objective.

        It is signed where the objective is a magnitude, and the standard error of the mean is that
        of the objective, by the delta method: objective plus influence function.
        """

    def summaries(self, rows: NDArray[np.void]) -> list[SampleSummary]:
        """Return what the objective needs of samples with the columns of `OUTCOME`, (n,)."""
        return summaries(rows)

    def of_ensemble(self, outcomes: Iterable[SampleSummary]) -> tuple[float, float]:
        """Return the objective of completed samples and its standard error.

        The error of a single one is nan; without samples they are inf and nan.
        """
        accumulator = accumulated(self.accumulator(), outcomes)
        value = accumulator.value
        return (math.inf, math.nan) if math.isnan(value) else (value, accumulator.standard_error)

    def reached(self, outcomes: Sequence[SampleSummary]) -> tuple[ReachedMoment, ...]:
        """Return each moment with a target of its own, as completed samples have it."""
        return ()

    def of_rows(self, rows: NDArray[np.void]) -> tuple[float, float]:
        """Return the same of rows of completed samples, (n,); see `outcome.summaries`."""
        return self.of_ensemble(self.summaries(rows))


Accumulator = TypeVar("Accumulator", bound=ObjectiveAccumulator)


def accumulated(accumulator: Accumulator, outcomes: Iterable[SampleSummary]) -> Accumulator:
    """Return an accumulator to which completed samples were added."""
    for outcome in outcomes:
        accumulator.add(outcome)
    return accumulator


class MeanAccumulator:
    """Running mean of one number of each sample.

    Parameters
    ----------
    number
        Returns it.

    Attributes
    ----------
    mean
        Of the samples so far.
    """

    def __init__(self, number: Callable[[SampleSummary], float]) -> None:
        self._number = number
        self.mean = RunningMean()

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""
        self.mean.add(self._number(outcome))

    @property
    def value(self) -> float:
        """The mean."""
        return self.mean.mean

    @property
    def standard_error(self) -> float:
        """Standard error of the mean."""
        return self.mean.standard_error


Ratio = TypeVar("Ratio", float, Floats)


class RadiusObjective(Objective):
    """An objective that depends on the mean radius ratios b^f/b⁰ of the samples alone.

    Both papers' objectives are the magnitude of the ensemble mean of a per-sample deviation.
    So their standard error is that of this mean, by the delta method; at an objective near 0
    the magnitude bends, and the error is that of the signed mean.
    """

    @abstractmethod
    def deviation(self, ratio: Ratio) -> Ratio:
        """Return the per-sample quantity whose ensemble mean counts, elementwise."""

    @property
    def reference(self) -> float | None:
        """The b/b⁰ whose deviation is 0, where that of others is ratio/reference - 1."""
        return None

    def accumulator(self) -> "RadiusAccumulator":
        """Return an accumulator without samples."""
        return RadiusAccumulator(self)

    def of_ratio(self, ratio: Ratio) -> Ratio:
        """Return the objective of single samples by their mean radius ratio, elementwise."""
        return abs(self.deviation(ratio))

    def of_samples(self, rows: NDArray[np.void]) -> Floats:
        """Return the objective of each sample alone."""
        return self.of_ratio(rows["mean_radius_ratio"])

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> Floats:
        """Return the deviations of the samples."""
        return self.deviation(np.array([outcome.mean_radius_ratio for outcome in outcomes]))


class RadiusAccumulator(MeanAccumulator):
    """Running mean of the deviations of an `objective`, whose magnitude is the objective."""

    def __init__(self, objective: RadiusObjective) -> None:
        super().__init__(lambda outcome: objective.deviation(outcome.mean_radius_ratio))
        self.objective = objective

    @property
    def value(self) -> float:
        """Magnitude of the mean."""
        return abs(self.mean.mean)
