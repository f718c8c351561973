"""Stopping rules of an ensemble: each a test, and the limits on the samples of a string.

A rule is one expression of two successive states of an ensemble, `StoppingRule.holds`. The search
evaluates it for one string after each sample, studies for many sequences of samples at once.
"""

import math
from collections.abc import Iterator
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    Literal,
    NamedTuple,
    TypeVar,
)

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.components import Component, In, Whole
from agglom_mpi.declaration.declared import LATER, NONE, FieldPath, Flag
from agglom_mpi.declaration.needed import needed
from agglom_mpi.formatting import pluralise
from agglom_mpi.judge import HALF_WIDTH, MEAN_RADIUS, NOTHING, OBJECTIVE, has_settled
from agglom_mpi.search.racing import Racing
from agglom_mpi.statistics import Floats, t_95

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


class StoppingRule(Component):
    """Base class of the stopping rules: a test after each completed sample but the first.

    Attributes
    ----------
    is_adaptive
        Whether the samples decide how many there are.
    is_published
        Whether the papers end their ensembles by it.
    common_configurations
        Whether sample k of all strings starts from the same random numbers.
    """

    named_by: ClassVar[str] = "rule"
    found_in: ClassVar[str] = "agglom_mpi.search"
    is_adaptive: ClassVar[bool] = True
    is_published: ClassVar[bool] = False
    common_configurations: Annotated[Flag, LATER] = False

    if TYPE_CHECKING:  # fields of most rules, which cannot hide attributes of their base class

        @property
        def min_samples(self) -> int:
            """Minimum number of completed samples of a string."""

        @property
        def max_samples(self) -> int:
            """Maximum number of samples of a string, failed ones included."""

        @property
        def tolerance(self) -> float:
            """What the test compares with."""

        @property
        def racing(self) -> Racing | None:
            """When strings are dropped that will not be kept; None: never."""

    @classmethod
    def as_mapping(cls, entry: Any) -> Any:
        """Return the entry: a rule has no short form."""
        return entry

    @property
    def highest_moment(self) -> int:
        """Order of the highest moment of the radii that is compared; 1 is the mean."""
        return 1

    @property
    def needs_moments(self) -> bool:
        """Whether `EnsembleState.central_moments` must be given."""
        return self.highest_moment > 1

    @property
    @needed
    def label(self) -> str:
        """The rule with its tolerance, for legends."""
        raise NotImplementedError

    @property
    def relative_to(self) -> Literal["mean_radius", "objective"] | None:
        """Quantity that the tolerance is relative to; None: it is in units of the objective."""
        return None

    @property
    def compares(self) -> int | None:
        """What a compiled judge of the rule compares, from `judge`; None: there is none."""
        return None

    @needed
    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Return whether the sample between two states was the last one needed, elementwise."""
        raise NotImplementedError

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
                rows_of(states, slice(None, -1)), rows_of(states, slice(1, None))
            )
        return satisfied


def rows_of(states: EnsembleState[Floats], rows: slice) -> EnsembleState[Floats]:
    """Return some of the states of many ensembles, by their rows."""
    central = states.central_moments
    return EnsembleState(
        states.samples[rows],
        states.mean_radius_ratio[rows],
        states.objective[rows],
        states.standard_error[rows],
        None if central is None else (central[0][rows], central[1][rows], central[2][rows]),
    )


def _share(tolerance: float) -> str:
    return f"{tolerance:g}".replace("e-0", "e-")


class AdaptiveRule(StoppingRule):
    """Base class of rules with a tolerance and limits on the samples of a string.

    Attributes
    ----------
    tolerance
        Number that the test compares with.
    max_samples
        Most samples of a string, whatever the test says.
    min_samples
        Fewest samples of a string.
    racing
        Whether strings that will not be parents are given up early; for the genetic search.
    """

    tolerance: Annotated[float, In("1", above=0, meaning="a small number like 1e-3")]
    max_samples: Annotated[
        int, Whole(at_least=2, at_most=10**6, meaning="the most samples of a string")
    ]
    min_samples: Annotated[int, Whole(at_least=2)] = 2
    racing: Annotated[Racing | None, NONE, LATER] = None

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield limits that are out of order."""
        if self.min_samples > self.max_samples:
            message = f"is {self.min_samples}; must be at most max_samples, {self.max_samples}"
            yield ("min_samples",), message


class SuccessiveDifference(AdaptiveRule):
    """One more sample changes the mean by less than a relative `tolerance` [A 27] [B 8.1].

    As published. It also stops by luck, when one sample happens to lie near the mean: the
    standard error must be read next to what it accepts.

    Attributes
    ----------
    tolerance
        Maximum relative change.
    quantity
        `mean_radius` [A 27] or `objective` [B 8.1] of the samples so far.
    """

    is_published: ClassVar[bool] = True
    rule: Literal["successive_difference"] = "successive_difference"
    example: ClassVar[str] = "{rule: successive_difference, tolerance: 1e-4, max_samples: 100}"
    quantity: Literal["mean_radius", "objective"] = "objective"

    @property
    def summary(self) -> str:
        """One line on the rule."""
        radius = self.quantity == "mean_radius"
        quantity, source = ("mean radius", "[A 27]") if radius else ("objective", "[B 8.1]")
        what = f"until one more sample changes the {quantity} by less than"
        return f"{what} {self.tolerance:g} of itself {source}"

    @property
    def label(self) -> str:
        """The rule with its tolerance."""
        return f"{self.quantity.replace('_', ' ')} within {_share(self.tolerance)}"

    @property
    def relative_to(self) -> Literal["mean_radius", "objective"]:
        """The quantity that is compared."""
        return self.quantity

    @property
    def compares(self) -> int:
        """The running mean of the quantity."""
        return MEAN_RADIUS if self.quantity == "mean_radius" else OBJECTIVE

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Compare the running means."""
        if self.quantity == "mean_radius":
            return has_settled(before.mean_radius_ratio, after.mean_radius_ratio, self.tolerance)
        return has_settled(before.objective, after.objective, self.tolerance)


class Moments(AdaptiveRule):
    """One more sample changes no moment by more than a relative `tolerance` [A 25, 27].

    Attributes
    ----------
    tolerance
        Maximum relative change of each moment.
    order
        Moments 1 … order are compared: the mean over samples first, then the central moments pooled
        over the particles of all samples.
    """

    is_published: ClassVar[bool] = True
    rule: Literal["moments"] = "moments"
    relative_to: ClassVar[Literal["mean_radius"]] = "mean_radius"  # the others to themselves
    example: ClassVar[str] = "{rule: moments, tolerance: 1e-2, max_samples: 100}"
    order: Annotated[int, Whole(at_least=1, at_most=4)] = 4

    @property
    def highest_moment(self) -> int:
        """Order of the highest moment that is compared."""
        return self.order

    @property
    def summary(self) -> str:
        """One line on the rule."""
        what = f"until one more sample changes no moment up to {self.order} by more than"
        return f"{what} {self.tolerance:g} of itself [A 25, 27]"

    @property
    def label(self) -> str:
        """The rule with its tolerance."""
        return f"{self.order} moments within {_share(self.tolerance)}"

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Compare the moments up to the order."""
        settled = has_settled(before.mean_radius_ratio, after.mean_radius_ratio, self.tolerance)
        for moment in range(self.order - 1):
            assert before.central_moments is not None
            assert after.central_moments is not None
            first, second = before.central_moments[moment], after.central_moments[moment]
            settled = settled & has_settled(first, second, self.tolerance)
        return settled


class StandardError(AdaptiveRule):
    """The half-width of the 95 % interval of the objective is at most `tolerance`.

    Attributes
    ----------
    tolerance
        Maximum half-width, absolute, in units of the objective.
    min_samples
        Minimum number of completed samples: the error of two or three is often small by luck.
    """

    rule: Literal["standard_error"] = "standard_error"
    example: ClassVar[str] = "{rule: standard_error, tolerance: 0.02, max_samples: 100}"
    min_samples: Annotated[int, Whole(at_least=3)] = 5

    @property
    def summary(self) -> str:
        """One line on the rule."""
        return f"until half the 95 % interval of the objective is at most {self.tolerance:g}"

    @property
    def label(self) -> str:
        """The rule with its tolerance."""
        return f"half-width ≤ {_share(self.tolerance)}"

    @property
    def compares(self) -> int:
        """Half the interval of the objective."""
        return HALF_WIDTH

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
    """The same number of samples for every string.

    Attributes
    ----------
    samples
        Samples of every string.
    """

    is_adaptive: ClassVar[bool] = False
    rule: Literal["fixed"] = "fixed"
    example: ClassVar[str] = "{rule: fixed, samples: 3}"
    min_samples: ClassVar[int] = 1  # the others may fail
    tolerance: ClassVar[float] = math.nan
    racing: ClassVar[None] = None
    label: ClassVar[str] = "a fixed number of samples"
    compares: ClassVar[int] = NOTHING
    samples: Annotated[int, Whole(at_least=1, at_most=10**6, meaning="a number of samples")]

    @property
    def max_samples(self) -> int:
        """Number of samples."""
        return self.samples

    @property
    def summary(self) -> str:
        """One line on the rule."""
        return f"{pluralise(self.samples, 'sample')} of every string"

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Return False: the number of samples ends the ensemble."""
        return False
