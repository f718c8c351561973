"""Stopping rules of an ensemble, and races that end hopeless ones.

Strings race in rounds (Maron and Moore 1994). When every string of a generation that needs samples
has r of them, the intervals of all strings are compared, and those that are out are judged by what
they have; then r is doubled. Rounds, not arrivals, decide: the ranks play no part.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, Protocol

from agglom_mpi.statistics import t_95, t_quantile


class EnsembleState(NamedTuple):
    """What the completed samples of a string amount to so far."""

    samples: int
    mean_radius_ratio: float
    """Mean of b^f/b⁰ over samples."""
    objective: float
    standard_error: float
    """Of the objective; nan for one sample."""
    central_moments: tuple[float, float, float] | None
    """Moments 2, 3, 4 of b/b⁰ about its mean, over the particles of all samples [A 24]; None where
    the rule does not need them."""


class StoppingRule(Protocol):
    """A test that is made after each completed sample but the first."""

    @property
    def needs_moments(self) -> bool:
        """Whether snapshots must have their central moments."""

    def satisfied(self, before: EnsembleState, after: EnsembleState) -> bool:
        """Tell whether the sample between the two snapshots was the last one needed."""


def _settled(before: float, after: float, tolerance: float) -> bool:
    # Not a strict inequality, as [A 25, 27] print it: a quantity that stays at 0 has settled, and
    # so has an objective that stays at inf.
    return before == after or abs(after - before) <= tolerance * abs(after)


@dataclass(frozen=True)
class SuccessiveDifference:
    """One sample more changes the mean by less than a share of itself [A 27] [B 8.1].

    As published. It also stops by luck, when one sample happens to lie near the mean: the
    standard error must be read next to what it accepts.

    Parameters
    ----------
    tolerance
        Largest relative change.
    quantity
        `mean_radius` [A 27] or `objective` [B 8.1] of the samples so far.
    """

    tolerance: float
    quantity: str = "objective"
    needs_moments: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.quantity not in ("mean_radius", "objective"):
            raise ValueError(f"unknown quantity {self.quantity!r}")

    def satisfied(self, before: EnsembleState, after: EnsembleState) -> bool:
        """Compare the running means."""
        if self.quantity == "mean_radius":
            return _settled(before.mean_radius_ratio, after.mean_radius_ratio, self.tolerance)
        return _settled(before.objective, after.objective, self.tolerance)


@dataclass(frozen=True)
class Moments:
    """One sample more changes no moment of the radii by more than a share of itself [A 25].

    Parameters
    ----------
    tolerance
        Largest relative change of each moment.
    order
        Moments 1 … order are watched, order at most 4: the mean over samples first, then the
        central moments pooled over the particles of all samples.
    """

    tolerance: float
    order: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.order <= 4:
            raise ValueError("the order of the moments must be 1 to 4")

    @property
    def needs_moments(self) -> bool:
        """The mean alone is there without."""
        return self.order > 1

    def satisfied(self, before: EnsembleState, after: EnsembleState) -> bool:
        """Compare the moments up to the order."""
        return all(
            _settled(*pair, self.tolerance)
            for pair in zip(self._watched(before), self._watched(after), strict=True)
        )

    def _watched(self, snapshot: EnsembleState) -> tuple[float, ...]:
        central = snapshot.central_moments or ()
        return (snapshot.mean_radius_ratio, *central)[: self.order]


@dataclass(frozen=True)
class StandardError:
    """The 95 % t interval of the objective is narrow enough.

    Parameters
    ----------
    tolerance
        Largest half-width, absolute, in units of the objective.
    min_samples
        Fewest completed samples, at least 3: the error of two or three is often small by luck.
    """

    tolerance: float
    min_samples: int = 5
    needs_moments: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.min_samples < 3:
            raise ValueError("a standard error needs at least 3 samples")

    def satisfied(self, before: EnsembleState, after: EnsembleState) -> bool:
        """Compare the half-width with the tolerance."""
        if after.samples < self.min_samples:
            return False
        return t_95(after.samples - 1) * after.standard_error <= self.tolerance


class FixedNumber:
    """As many samples as the ensemble may have at most, whatever they give."""

    needs_moments: ClassVar[bool] = False

    def satisfied(self, before: EnsembleState, after: EnsembleState) -> bool:
        """Leave the end to the largest number of samples."""
        return False


FEWEST: Final = 2
"""Samples that an interval needs."""


class RaceEntry(NamedTuple):
    """What is known of a string: its objective, the standard error, and samples they rest on."""

    objective: float
    standard_error: float
    samples: int


class Race(NamedTuple):
    """Rules of the race.

    Attributes
    ----------
    kept
        Strings that the search keeps, K.
    confidence
        Least probability that a string which belongs among the best K is not dropped.
    first
        Samples of each string before the first round.
    """

    kept: int
    confidence: float
    first: int

    def samples(self, race: int) -> int:
        """Return the number of samples that round `race`, from 0, is held at."""
        return self.first << race

    def dropped(
        self, race: int, running: dict[int, RaceEntry], others: list[RaceEntry]
    ) -> list[int]:
        """Return those running strings that are out.

        One is out if its objective lies above that of K others, whatever of their intervals is
        true. If all intervals hold, none that belongs among the best K is dropped. Its own and
        those K intervals all hold with the wanted confidence, over all rounds, if each fails with a
        probability of (1 - confidence) / 2^(round + 1) / (K + 1) at most (Bonferroni).

        Parameters
        ----------
        race
            Number of the round, from 0.
        running
            Strings that still get samples, by number.
        others
            Parents, and strings of this generation that have enough.
        """
        risk = (1.0 - self.confidence) / 2.0 ** (race + 1) / (self.kept + 1)
        coverage = 1.0 - 2.0 * risk
        ends = {string: _interval(standing, coverage) for string, standing in running.items()}
        uppers = [_interval(standing, coverage)[1] for standing in others]
        uppers = sorted(uppers + [upper for _, upper in ends.values()])
        if len(uppers) <= self.kept:
            return []
        # A string's own upper end is never below its lower one, so it need not be left out.
        threshold = uppers[self.kept - 1]
        return [string for string, (lower, _) in ends.items() if lower > threshold]


def _interval(standing: RaceEntry, coverage: float) -> tuple[float, float]:
    """Confidence interval of an objective; all numbers where nothing is known of its error."""
    if standing.samples < FEWEST or not math.isfinite(standing.standard_error):
        return -math.inf, math.inf
    half = t_quantile(standing.samples - 1, coverage) * standing.standard_error
    return standing.objective - half, standing.objective + half
