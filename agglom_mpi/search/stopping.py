"""When an ensemble is large enough: the papers' two rules, and one by standard error."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol

from agglom_mpi.search.student import t_95

if TYPE_CHECKING:
    from agglom_mpi.campaign.plan import AnyEnsemble


class Snapshot(NamedTuple):
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


class Rule(Protocol):
    """A test that is made after each completed sample but the first."""

    @property
    def needs_moments(self) -> bool:
        """Whether snapshots must have their central moments."""

    def satisfied(self, before: Snapshot, after: Snapshot) -> bool:
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

    def satisfied(self, before: Snapshot, after: Snapshot) -> bool:
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

    def satisfied(self, before: Snapshot, after: Snapshot) -> bool:
        """Compare the moments up to the order."""
        return all(
            _settled(*pair, self.tolerance)
            for pair in zip(self._watched(before), self._watched(after), strict=True)
        )

    def _watched(self, snapshot: Snapshot) -> tuple[float, ...]:
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

    def satisfied(self, before: Snapshot, after: Snapshot) -> bool:
        """Compare the half-width with the tolerance."""
        if after.samples < self.min_samples:
            return False
        return t_95(after.samples - 1) * after.standard_error <= self.tolerance


class FixedNumber:
    """As many samples as the ensemble may have at most, whatever they give."""

    needs_moments: ClassVar[bool] = False

    def satisfied(self, before: Snapshot, after: Snapshot) -> bool:
        """Leave the end to the largest number of samples."""
        return False


def make_rule(model: "AnyEnsemble") -> Rule:
    """Return the stopping rule that a campaign's `ensemble` asks for."""
    if model.rule == "successive_difference":
        return SuccessiveDifference(model.tolerance, model.quantity)
    if model.rule == "moments":
        return Moments(model.tolerance, model.order)
    if model.rule == "standard_error":
        return StandardError(model.tolerance, model.min_samples)
    if model.rule == "fixed":
        return FixedNumber()
    raise ValueError(f"unknown stopping rule {model.rule!r}")
