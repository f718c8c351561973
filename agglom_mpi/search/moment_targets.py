"""Targets on the moments of the final radii [A 24-25, 29], alone or weighted.

The mean is that over samples of their mean radius ratio, as everywhere. All others are of the
particles of all samples together, about their common mean, so their estimators are ratios: samples
differ in how many particles are left.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.objectives import Objective
from agglom_mpi.statistics import PooledMomentErrors, PooledMoments, RunningMean

CENTRAL: Final = ("second", "third", "fourth")
NORMALISED: Final = ("skewness", "kurtosis")
NO_SPREAD: Final = 1e-9
"""Spread, relative to the mean, up to which all radii are the same but for rounding: one merge
among 1e13 particles makes more."""

Central = tuple[float, float, float]


class MomentTarget(NamedTuple):
    """One moment that is wanted: its name, its value and how much a miss counts."""

    name: str
    target: float
    weight: float = 1.0

    def miss(self, moment: float) -> float:
        """Signed weighted miss, relative to the target unless that is 0."""
        if self.target == 0.0:
            return self.weight * moment
        return self.weight * (moment / self.target - 1.0)

    @property
    def slope(self) -> float:
        """Change of the miss with the moment."""
        return self.weight / (self.target or 1.0)


def spread_of(mean: float, second: float) -> float:
    """Return the standard deviation of radii, exactly 0 where they only differ by rounding."""
    spread = math.sqrt(max(second, 0.0))
    return spread if spread > NO_SPREAD * mean else 0.0


def moment(name: str, mean: float, central: Central) -> float:
    """Return a moment by its name, from the mean and the central moments 2, 3, 4.

    Radii without spread have no skewness and no kurtosis. These are inf here, as one larger
    particle among ever more equal ones makes them, so that no target is met by chance.
    """
    second, third, fourth = central
    if name == "mean":
        return mean
    if name in CENTRAL:
        return central[CENTRAL.index(name)]
    spread = spread_of(mean, second)
    if name == "spread":
        return spread
    if spread == 0.0:
        return math.inf
    return third / spread**3 if name == "skewness" else fourth / spread**4


def gradient(name: str, mean: float, central: Central) -> Mapping[str, float]:
    """Return the derivatives of a moment by the mean and the central moments, where not 0."""
    second, third, fourth = central
    if name == "mean" or name in CENTRAL:
        return {name: 1.0}
    spread = spread_of(mean, second)
    if spread == 0.0:
        return {}
    if name == "spread":
        return {"second": 0.5 / spread}
    if name == "skewness":
        return {"third": spread**-3, "second": -1.5 * third * spread**-5}
    return {"fourth": spread**-4, "second": -2.0 * fourth * spread**-6}


@dataclass(frozen=True)
class MomentTargets(Objective):
    """Sum over targets of weight·|M/target - 1|, or weight·|M - target| where the target is 0."""

    terms: tuple[MomentTarget, ...]

    def tally(self) -> "MomentAccumulator":
        """Return a tally of no samples."""
        return MomentAccumulator(self.terms)

    def worth(self, mean: float, central: Central) -> float:
        """Return the objective of radii with these moments."""
        return sum(abs(term.miss(moment(term.name, mean, central))) for term in self.terms)

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the objective of each sample alone, from its own moments."""
        columns = ("mean_radius_ratio", *(f"radius_moment_{order}" for order in (2, 3, 4)))
        samples = zip(*(rows[name].tolist() for name in columns), strict=True)
        return np.array([self.worth(mean, (m2, m3, m4)) for mean, m2, m3, m4 in samples])

    def linear(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return the objective of all, and what each sample adds to it in first order."""
        tally = self.tally()
        for outcome in outcomes:
            tally.add(outcome)
        return np.array([tally.linear(outcome) for outcome in outcomes])


class MomentAccumulator:
    """The moments of the samples so far, and how they vary from sample to sample."""

    def __init__(self, terms: tuple[MomentTarget, ...]) -> None:
        self._objective = MomentTargets(terms)
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
        return self._objective.worth(self._mean.mean, self._pooled.central)

    @property
    def standard_error(self) -> float:
        """By the delta method from what the samples' sums of powers vary.

        As for the mean alone, the error near a target is that of the signed miss. Of an objective
        of inf it is 0: two samples or more agree that there is nothing to judge.
        """
        if self._mean.count < 2:
            return math.nan
        if math.isinf(self.value):
            return 0.0
        return self._sums.standard_error(self._slopes(), self._pooled.central)

    def linear(self, outcome: SampleSummary) -> float:
        """Objective of all samples, and what this one adds to it in first order."""
        return self.value + self._sums.influence(
            _numbers(outcome), self._slopes(), self._pooled.central
        )

    def _slopes(self) -> dict[str, float]:
        """Return the derivatives of the objective by the mean and the central moments."""
        mean, central = self._mean.mean, self._pooled.central
        slopes: dict[str, float] = {}
        for term in self._objective.terms:
            sign = math.copysign(1.0, term.miss(moment(term.name, mean, central)) or 1.0)
            for name, slope in gradient(term.name, mean, central).items():
                slopes[name] = slopes.get(name, 0.0) + sign * term.slope * slope
        return slopes


def _numbers(outcome: SampleSummary) -> tuple[int, float, Central]:
    return outcome.particles, outcome.mean_radius_ratio, outcome.central_moments
