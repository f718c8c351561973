"""Targets on the moments of the final radii [A 24-25, 29], alone or weighted.

The mean is that over samples of their mean radius ratio, as everywhere. All other moments are of
the particles of all samples together, about their common mean, so their estimators are ratios:
samples differ in the number of particles left.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.components import In, UnknownComponentError
from agglom_mpi.declaration.declared import Declared, FieldPath, Meaning
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.criteria import Criterion
from agglom_mpi.search.moments import MOMENTS, NORMALISED, Central, MomentBands, gradient, moment
from agglom_mpi.search.objectives.objective import Objective, ReachedMoment, accumulated
from agglom_mpi.statistics import Floats, PooledMomentErrors, PooledMoments, RunningMean

FOURTH_ORDER: Final = ("kurtosis", "fourth")
"""Moments of the fourth power of the radii."""
FOURTH_ORDER_INTERVALS: Final = (
    "few large particles decide a kurtosis or a fourth moment, and its standard error: 95 % "
    "intervals hold the true value in 90 % of cases by 30 samples, 92 % by 100, 94 % by 300"
)
"""Measured coverage of Student's intervals in the scene of [A], row 1 (`bench_coverage.py`)."""


def interval_notes(names: Iterable[str]) -> list[str]:
    """Return what is to be known of the standard errors of moments, by their names."""
    return [FOURTH_ORDER_INTERVALS] if set(names).intersection(FOURTH_ORDER) else []


class MomentTarget(NamedTuple):
    """Target of one moment: its name, its value and its weight."""

    name: str
    target: float
    weight: float = 1.0

    def deviation(self, moment: float) -> float:
        """Return the signed weighted deviation, relative to the target unless that is 0."""
        if self.target == 0.0:
            return self.weight * moment
        return self.weight * (moment / self.target - 1.0)

    @property
    def slope(self) -> float:
        """Derivative of the deviation by the moment."""
        return self.weight / (self.target or 1.0)


Anything: TypeAlias = Annotated[float | None, In("1")]
Positive: TypeAlias = Annotated[float | None, In("1", above=0)]
NotNegative: TypeAlias = Annotated[float | None, In("1", at_least=0)]
AtLeastOne: TypeAlias = Annotated[float | None, In("1", at_least=1)]


class Targets(Declared):
    """Targets: the mean over samples of b/b⁰; the other moments of all their particles pooled.

    Attributes
    ----------
    mean
        Mean over samples of b/b⁰.
    spread
        Standard deviation of b/b⁰.
    skewness
        Third central moment of b/b⁰, divided by spread³.
    kurtosis
        Fourth central moment of b/b⁰, divided by spread⁴; 3 for a normal distribution.
    second
        Second central moment (variance) of b/b⁰.
    third
        Third central moment of b/b⁰.
    fourth
        Fourth central moment of b/b⁰.
    """

    mean: AtLeastOne = None
    spread: NotNegative = None
    skewness: Anything = None
    kurtosis: AtLeastOne = None
    second: NotNegative = None
    third: Anything = None
    fourth: NotNegative = None


class Weights(Declared):
    """Weights of the targets' relative misses.

    Attributes
    ----------
    mean, spread, skewness, kurtosis, second, third, fourth
        Weight of the target; 1 unless given.
    """

    mean: Positive = None
    spread: Positive = None
    skewness: Positive = None
    kurtosis: Positive = None
    second: Positive = None
    third: Positive = None
    fourth: Positive = None


class MomentTargets(Objective):
    """Sum over targets of weight·|M/target - 1|, or weight·|M - target| where that is 0 [A 29].

    Attributes
    ----------
    targets
        Targets by name.
    weights
        Their weights, 1 by default.
    """

    has_target: ClassVar[bool] = True
    has_moments: ClassVar[bool] = True
    law: Literal["moments"] = "moments"
    example: ClassVar[str] = "{law: moments, targets: {mean: 2, spread: 0.4}}"
    targets: Annotated[Targets, Meaning("such as {mean: 2, spread: 0.4}")]
    weights: Weights = Weights()
    _order: tuple[str, ...] = MOMENTS

    @classmethod
    def recorded(cls, entries: Mapping[str, Any]) -> Self:
        """Return the objective with its terms in the order of recorded entries.

        Sums over them depend on the order by their rounding.
        """
        unknown = set(entries["targets"]) - set(MOMENTS)
        if unknown:
            raise UnknownComponentError(f"unknown moments: {', '.join(sorted(unknown))}")
        recorded = super().recorded(entries)
        recorded.__dict__["_order"] = tuple(entries["targets"])
        return recorded

    @cached_property
    def terms(self) -> tuple[MomentTarget, ...]:
        """The targets with their weights."""
        wanted, weights = self.targets.__dict__, self.weights.__dict__
        return tuple(
            MomentTarget(name, wanted[name], 1.0 if weights[name] is None else weights[name])
            for name in self._order
            if wanted[name] is not None
        )

    def entries(self) -> dict[str, Any]:
        """Return the given targets and the weight of each."""
        targets = {term.name: term.target for term in self.terms}
        weights = {term.name: term.weight for term in self.terms}
        return {"law": self.law, "targets": targets, "weights": weights}

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield moments that no radii have, no target at all, and weights without a target."""
        given = self.targets.model_dump()
        wanted = {name: given[name] for name in MOMENTS if given[name] is not None}
        if not wanted:
            yield ("targets",), f"are none; give at least one of {', '.join(MOMENTS)}"
            return
        if "kurtosis" in wanted and "skewness" in wanted:
            least = 1.0 + wanted["skewness"] ** 2
            if wanted["kurtosis"] < least:
                message = f"is {wanted['kurtosis']:g}; must be at least 1 + skewness^2, {least:g}"
                yield ("targets", "kurtosis"), message
        for name in MOMENTS:
            if name in self.weights.model_fields_set and name not in wanted:
                yield (
                    ("weights", name),
                    "is the weight of no target; leave it out, or give the target",
                )

    @property
    def summary(self) -> str:
        """One line on the objective."""
        targets = [
            f"{name} {target:g}" + (f" (weight {weight:g})" if weight != 1.0 else "")
            for name, target, weight in self.terms
        ]
        return f"moments of the final radii, relative misses added up: {', '.join(targets)} [A 29]"

    @property
    def wanted_growth(self) -> tuple[FieldPath, float] | None:
        """The target of the mean with its field; None if there is none."""
        mean = self.targets.mean
        return None if mean is None else (("targets", "mean"), mean)

    @property
    def tolerance_limits(self) -> tuple[float, float]:
        """0 and 1; where all targets are 0, so that nothing is relative, no upper limit."""
        return (0.0, 1.0 if any(term.target for term in self.terms) else math.inf)

    def criterion(self, tolerance: float) -> Criterion:
        """Return the criterion that all moments are within a tolerance of their targets."""
        return MomentBands({term.name: term.target for term in self.terms}, tolerance)

    @property
    def notes(self) -> list[str]:
        """Notes on the errors of its moments."""
        return interval_notes(term.name for term in self.terms)

    @property
    def why_infinite(self) -> str:
        """Reason for an infinite objective of samples that completed."""
        wanted = [term.name for term in self.terms]
        names = [name for name in NORMALISED if name in wanted]
        if not names:
            return super().why_infinite
        return f"particles of equal radii have no {' and no '.join(names)}"

    @property
    def scale(self) -> float:
        """Sum of the weights: each deviation is of moments of the size of their targets, or 1."""
        return sum(abs(term.weight) for term in self.terms)

    def accumulator(self) -> "MomentAccumulator":
        """Return an accumulator without samples."""
        return MomentAccumulator(self)

    def of_moments(self, mean: float, central: Central) -> float:
        """Return the objective of radii with these moments."""
        return sum(abs(term.deviation(moment(term.name, mean, central))) for term in self.terms)

    def of_samples(self, rows: NDArray[np.void]) -> Floats:
        """Return the objective of each sample alone, from its own moments."""
        columns = ("mean_radius_ratio", *(f"radius_moment_{order}" for order in (2, 3, 4)))
        samples = zip(*(rows[name].tolist() for name in columns), strict=True)
        return np.array([self.of_moments(mean, (m2, m3, m4)) for mean, m2, m3, m4 in samples])

    def reached(self, outcomes: Sequence[SampleSummary]) -> tuple[ReachedMoment, ...]:
        """Return each target with the moment of all samples together and its standard error.

        See `FOURTH_ORDER_INTERVALS` on that of a kurtosis.
        """
        return accumulated(self.accumulator(), outcomes).reached if outcomes else ()

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> Floats:
        """Return the objective of all samples plus the first-order influence of each."""
        accumulator = accumulated(self.accumulator(), outcomes)
        return np.array([accumulator.influence_value(outcome) for outcome in outcomes])


class MomentAccumulator:
    """Moments of the samples so far, and their covariance between samples."""

    def __init__(self, objective: MomentTargets) -> None:
        self._objective = objective
        self._mean = RunningMean()
        self._pooled = PooledMoments()
        self._sums = PooledMomentErrors()

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""
        self._mean.add(outcome.mean_radius_ratio)
        self._pooled.add(outcome.particles, outcome.mean_radius_ratio, outcome.central_moments)
        self._sums.add(*_numbers(outcome))

    @property
    def value(self) -> float:
        """The objective; inf where a skewness or kurtosis is wanted of radii without spread."""
        if not self._mean.count:
            return math.nan
        return self._objective.of_moments(self._mean.mean, self._pooled.central)

    @property
    def standard_error(self) -> float:
        """Standard error by the delta method, from the covariance of the samples' sums of powers.

        As for the mean alone, the error near a target is that of the signed deviation. It is 0
        where the objective is inf, as all samples have radii without spread.
        """
        if self._mean.count < 2:
            return math.nan
        if math.isinf(self.value):
            return 0.0
        return self._sums.standard_error(self._slopes(), self._pooled.central)

    @property
    def reached(self) -> tuple[ReachedMoment, ...]:
        """Each target with its moment so far, and the standard error of that."""
        mean, central, found = self._mean.mean, self._pooled.central, []
        for term in self._objective.terms:
            value, error = moment(term.name, mean, central), math.nan
            if self._mean.count > 1 and math.isfinite(value):
                error = self._sums.standard_error(gradient(term.name, mean, central), central)
            found.append(ReachedMoment(*term, value, error, abs(term.deviation(value))))
        return tuple(found)

    def influence_value(self, outcome: SampleSummary) -> float:
        """Return the objective of all samples plus the first-order influence of this one."""
        return self.value + self._sums.influence(
            _numbers(outcome), self._slopes(), self._pooled.central
        )

    def _slopes(self) -> dict[str, float]:
        """Return the derivatives of the objective by the mean and the central moments."""
        mean, central = self._mean.mean, self._pooled.central
        slopes: dict[str, float] = {}
        for term in self._objective.terms:
            sign = math.copysign(1.0, term.deviation(moment(term.name, mean, central)) or 1.0)
            for name, slope in gradient(term.name, mean, central).items():
                slopes[name] = slopes.get(name, 0.0) + sign * term.slope * slope
        return slopes


def _numbers(outcome: SampleSummary) -> tuple[int, float, Central]:
    return outcome.particles, outcome.mean_radius_ratio, outcome.central_moments
