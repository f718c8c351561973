"""Stopping rules of an ensemble, and races that end the sampling of hopeless strings.

A rule is one expression of two successive states of an ensemble, `StoppingRule.holds`. The search
evaluates it for one string after each sample, studies for many sequences of samples at once.

Strings race in rounds (Maron and Moore 1994). When every string of a generation that needs samples
has r of them, the intervals of all strings are compared, and those that are out are judged by what
they have; then r is doubled. Rounds, not arrivals, decide: the ranks play no part.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.statistics import t_95, t_quantile

Floats = NDArray[np.float64]
Number = TypeVar("Number", float, Floats)


class EnsembleState(NamedTuple, Generic[Number]):
    """Statistics of the completed samples so far: of one ensemble, or of many after each sample.

    Attributes
    ----------
    samples
        Number of completed samples; of many ensembles 1, 2, … n, shape (n, 1).
    mean_radius_ratio
        Mean of b^f/b⁰ over samples; this and what follows has shape (n, ensembles) if of many.
    objective
        Objective of the samples.
    standard_error
        Standard error of the objective; nan for one sample.
    central_moments
        Moments 2, 3, 4 of b/b⁰ about its mean, over the particles of all samples [A 24]; None where
        the rule does not need them.
    """

    samples: Any
    mean_radius_ratio: Number
    objective: Number
    standard_error: Number
    central_moments: tuple[Number, Number, Number] | None


class StoppingRule(ABC):
    """A test that is made after each completed sample but the first.

    Attributes
    ----------
    order
        Highest moment of the radii that the rule compares; 1 is the mean.
    min_samples
        Samples from which a study evaluates the rule; a campaign sets its own.
    """

    order: int = 1
    min_samples: int = 2

    @property
    def needs_moments(self) -> bool:
        """Whether `EnsembleState.central_moments` must be given."""
        return self.order > 1

    @property
    @abstractmethod
    def label(self) -> str:
        """The rule with its tolerance, for legends."""

    @property
    def relative_to(self) -> Literal["mean_radius", "objective"] | None:
        """What the tolerance is a share of; None if it is absolute, in units of the objective."""
        return None

    @abstractmethod
    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Return whether the sample between two states was the last one needed, elementwise."""

    def satisfied(self, before: EnsembleState[float], after: EnsembleState[float]) -> bool:
        """Return whether the sample between two states of one ensemble was the last one needed."""
        return bool(self.holds(before, after))

    def satisfied_paths(self, states: EnsembleState[Floats]) -> NDArray[np.bool_]:
        """Return where `satisfied` is true after each sample, shape (n, ensembles).

        The first row is False: one sample satisfies no rule.
        """
        satisfied = np.zeros(states.objective.shape, dtype=bool)
        with np.errstate(invalid="ignore", over="ignore"):  # inf - inf is nan, and settled
            satisfied[1:] = self.holds(
                _rows(states, slice(None, -1)), _rows(states, slice(1, None))
            )
        return satisfied


def _rows(states: EnsembleState[Floats], rows: slice) -> EnsembleState[Floats]:
    central = states.central_moments
    return EnsembleState(
        states.samples[rows],
        states.mean_radius_ratio[rows],
        states.objective[rows],
        states.standard_error[rows],
        None if central is None else (central[0][rows], central[1][rows], central[2][rows]),
    )


def _settled(before: Any, after: Any, tolerance: float) -> Any:
    """Return whether a quantity changed by at most a share of itself, elementwise."""
    # Not a strict inequality, as [A 25, 27] print it: a quantity that stays at 0 has settled, and
    # so has an objective that stays at inf.
    return (before == after) | (abs(after - before) <= tolerance * abs(after))


def _share(tolerance: float) -> str:
    return f"{tolerance:g}".replace("e-0", "e-")


@dataclass(frozen=True)
class SuccessiveDifference(StoppingRule):
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
    quantity: Literal["mean_radius", "objective"] = "objective"

    def __post_init__(self) -> None:
        if self.quantity not in ("mean_radius", "objective"):
            raise ValueError(f"unknown quantity {self.quantity!r}")

    @property
    def label(self) -> str:
        """The rule with its tolerance."""
        return f"{self.quantity.replace('_', ' ')} within {_share(self.tolerance)}"

    @property
    def relative_to(self) -> Literal["mean_radius", "objective"]:
        """The quantity that is compared."""
        return self.quantity

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Compare the running means."""
        if self.quantity == "mean_radius":
            return _settled(before.mean_radius_ratio, after.mean_radius_ratio, self.tolerance)
        return _settled(before.objective, after.objective, self.tolerance)


@dataclass(frozen=True)
class Moments(StoppingRule):
    """One sample more changes no moment of the radii by more than a share of itself [A 25].

    Parameters
    ----------
    tolerance
        Largest relative change of each moment.
    order
        Moments 1 … order are compared, order at most 4: the mean over samples first, then the
        central moments pooled over the particles of all samples.
    """

    tolerance: float
    order: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.order <= 4:
            raise ValueError("the order of the moments must be 1 to 4")

    @property
    def label(self) -> str:
        """The rule with its tolerance."""
        return f"{self.order} moments within {_share(self.tolerance)}"

    @property
    def relative_to(self) -> Literal["mean_radius"]:
        """The first moment; each of the others is compared with itself."""
        return "mean_radius"

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Compare the moments up to the order."""
        settled = _settled(before.mean_radius_ratio, after.mean_radius_ratio, self.tolerance)
        for moment in range(self.order - 1):
            assert before.central_moments is not None
            assert after.central_moments is not None
            first, second = before.central_moments[moment], after.central_moments[moment]
            settled = settled & _settled(first, second, self.tolerance)
        return settled


@dataclass(frozen=True)
class StandardError(StoppingRule):
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

    def __post_init__(self) -> None:
        if self.min_samples < 3:
            raise ValueError("a standard error needs at least 3 samples")

    @property
    def label(self) -> str:
        """The rule with its tolerance."""
        return f"half-width ≤ {_share(self.tolerance)}"

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Compare the half-width with the tolerance."""
        half_width = _t_95_of(after.samples) * after.standard_error
        return (after.samples >= self.min_samples) & (half_width <= self.tolerance)


def _t_95_of(samples: Any) -> Any:
    """Return t of the 95 % interval of a mean over each number of samples, at least 2."""
    if isinstance(samples, np.ndarray):
        factors = [t_95(int(number) - 1) for number in samples.ravel()]
        return np.array(factors).reshape(samples.shape)
    return t_95(samples - 1)


class FixedNumber(StoppingRule):
    """As many samples as the ensemble may have at most, whatever they give."""

    @property
    def label(self) -> str:
        """Description of the rule."""
        return "a fixed number of samples"

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Return False: the largest number of samples ends the ensemble."""
        return False


STUDIED_RULES: Final[tuple[tuple[str, Callable[[float], StoppingRule]], ...]] = (
    ("successive difference, mean radius", partial(SuccessiveDifference, quantity="mean_radius")),
    ("successive difference, objective", SuccessiveDifference),
    *((f"moments 1 to {order}", partial(Moments, order=order)) for order in (2, 3, 4)),
    ("standard error", StandardError),
)
"""Rules whose tolerance `agglom accuracy` varies: name, and the rule of a tolerance."""

COMPARED_RULES: Final[tuple[tuple[str, StoppingRule], ...]] = (
    ("mean radius within 1e-5 [A 27]", SuccessiveDifference(1e-5, "mean_radius")),
    ("objective within 5e-4 [B 8.1]", SuccessiveDifference(5e-4, "objective")),
    ("four moments within 1e-3 [A 25]", Moments(1e-3, 4)),
    ("half-width ≤ 0.01", StandardError(0.01)),
)
"""Rules that the figure of a campaign's ensembles compares: the papers' own with their tolerances,
and two that look at more."""


FEWEST_SAMPLES: Final = 2
"""Samples that an interval needs."""


class RaceEntry(NamedTuple):
    """Objective of a string so far, its standard error, and the samples that they rest on."""

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

    def samples(self, round_number: int) -> int:
        """Return the samples that each string has when a round, counted from 0, is held."""
        return self.first << round_number

    def dropped(
        self, round_number: int, running: dict[int, RaceEntry], others: list[RaceEntry]
    ) -> list[int]:
        """Return the running strings that are out, in the order of `running`.

        A string is out if its objective lies above that of K others, wherever in their intervals
        the true objectives are. If all intervals hold, none that belongs among the best K is
        dropped. Its own and those K intervals all hold with the wanted confidence, over all rounds,
        if each fails with a probability of (1 - confidence) / 2^(round + 1) / (K + 1) at most
        (Bonferroni).

        Parameters
        ----------
        round_number
            Counted from 0.
        running
            Strings that still get samples, by number.
        others
            Parents, and strings of this generation that have enough.
        """
        risk = (1.0 - self.confidence) / 2.0 ** (round_number + 1) / (self.kept + 1)
        coverage = 1.0 - 2.0 * risk
        ends = {string: _interval(entry, coverage) for string, entry in running.items()}
        uppers = [_interval(entry, coverage)[1] for entry in others]
        uppers = sorted(uppers + [upper for _, upper in ends.values()])
        if len(uppers) <= self.kept:
            return []
        # A string's own upper end is never below its lower one, so it need not be left out.
        threshold = uppers[self.kept - 1]
        return [string for string, (lower, _) in ends.items() if lower > threshold]


def _interval(entry: RaceEntry, coverage: float) -> tuple[float, float]:
    """Return the t interval of an objective; (-inf, inf) where its error is not known."""
    if entry.samples < FEWEST_SAMPLES or not math.isfinite(entry.standard_error):
        return -math.inf, math.inf
    half = t_quantile(entry.samples - 1, coverage) * entry.standard_error
    return entry.objective - half, entry.objective + half
