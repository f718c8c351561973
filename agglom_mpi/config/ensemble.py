"""The sections `ensemble`, `stopping`, `final` and `output`."""

from typing import Annotated, Final, Literal, NamedTuple, Self

from pydantic import Field, TypeAdapter, model_validator

from agglom_mpi.declaration.sections import (
    LATER,
    NONE,
    FieldError,
    Flag,
    Line,
    Section,
    WholeNumber,
)
from agglom_mpi.declaration.units import Number, Time
from agglom_mpi.formatting import pluralise
from agglom_mpi.search import stopping
from agglom_mpi.search.method import SearchMethod


class Racing(Section):
    """Stop sampling strings that will not be among the kept parents, by a race."""

    confidence: Annotated[Number, Field(gt=0.5, lt=1, description="like 0.95")] = 0.95
    first: Annotated[WholeNumber, Field(ge=2, le=10**4)] = 5

    def build(self, kept: int) -> stopping.Race:
        """Return the race for `kept` places."""
        return stopping.Race(kept, self.confidence, self.first)


class _Ensemble(Section):
    """Base of all rules; `common_configurations`: sample k of all strings has one random start."""

    common_configurations: Annotated[Flag, LATER] = False


class _Samples(_Ensemble):
    """Base of rules with a tolerance and limits on the samples of a string."""

    tolerance: Annotated[Number, Field(gt=0, description="a small number like 1e-3")]
    max_samples: Annotated[
        WholeNumber, Field(ge=2, le=10**6, description="the most samples of a string")
    ]
    min_samples: Annotated[WholeNumber, Field(ge=2)] = 2
    racing: Annotated[Racing | None, NONE, LATER] = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_samples > self.max_samples:
            message = f"is {self.min_samples}; must be at most max_samples, {self.max_samples}"
            raise FieldError((("min_samples",), message))
        return self


class SuccessiveDifference(_Samples):
    """Stop when one more sample hardly changes the running mean [A 27] [B 8.1]."""

    rule: Literal["successive_difference"]
    quantity: Literal["mean_radius", "objective"] = "objective"

    @property
    def summary(self) -> str:
        """One line on the rule."""
        radius = self.quantity == "mean_radius"
        quantity, source = ("mean radius", "[A 27]") if radius else ("objective", "[B 8.1]")
        what = f"until one more sample changes the {quantity} by less than"
        return f"{what} {self.tolerance:g} of itself {source}"

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.SuccessiveDifference(self.tolerance, self.quantity)


class Moments(_Samples):
    """Stop when one more sample hardly changes moments 1 to `order` of the radii [A 25, 27]."""

    rule: Literal["moments"]
    order: Annotated[WholeNumber, Field(ge=1, le=4)] = 4

    @property
    def summary(self) -> str:
        """One line on the rule."""
        what = f"until one more sample changes no moment up to {self.order} by more than"
        return f"{what} {self.tolerance:g} of itself [A 25, 27]"

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.Moments(self.tolerance, self.order)


class StandardError(_Samples):
    """Stop when half the 95 % t interval of the objective is at most the tolerance."""

    rule: Literal["standard_error"]
    min_samples: Annotated[WholeNumber, Field(ge=3)] = 5

    @property
    def summary(self) -> str:
        """One line on the rule."""
        return f"until half the 95 % interval of the objective is at most {self.tolerance:g}"

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.StandardError(self.tolerance, self.min_samples)


class FixedNumber(_Ensemble):
    """The same number of samples for every string."""

    rule: Literal["fixed"]
    samples: Annotated[WholeNumber, Field(ge=1, le=10**6, description="a number of samples")]

    @property
    def summary(self) -> str:
        """One line on the rule."""
        return f"{pluralise(self.samples, 'sample')} of every string"

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.FixedNumber()

    @property
    def racing(self) -> None:
        """None: all strings get the same number."""

    @property
    def min_samples(self) -> int:
        """Smallest number of completed samples, 1: the others may fail."""
        return 1

    @property
    def max_samples(self) -> int:
        """Largest number of samples."""
        return self.samples


AdaptiveEnsemble = SuccessiveDifference | Moments | StandardError
Ensemble = AdaptiveEnsemble | FixedNumber
AnyEnsemble = Annotated[Ensemble, Field(discriminator="rule")]
ENSEMBLE: Final[TypeAdapter[Ensemble]] = TypeAdapter(AnyEnsemble)
"""Validator of the `ensemble` section alone."""


class Target(Section):
    """Stop when the mean objective of the best `top` strings is `objective` or less."""

    top: Annotated[WholeNumber, Field(ge=1, description="a number of strings")]
    objective: Annotated[Number, Field(description="like 5e-4")]


class Stopping(Section):
    """Section `stopping`: what ends the campaign."""

    generations: Annotated[WholeNumber, Field(ge=1, le=10**6, description="the most generations")]
    target: Annotated[Target | None, NONE] = None
    expected_error: Annotated[Annotated[Number, Field(gt=0, lt=1)] | None, NONE] = None
    max_failures: Annotated[WholeNumber, Field(ge=1)] = 100
    max_seconds: Annotated[Annotated[Time, Field(gt=0)] | None, NONE] = None


class Plan(NamedTuple):
    """The sections of a search, which a scene alone does not have."""

    search: SearchMethod
    ensemble: Ensemble
    stopping: Stopping


class FinalAnswer(Section):
    """Section `final`: re-estimation of the best strings on fresh samples after the search."""

    strings: Annotated[WholeNumber, Field(ge=1, le=10**5, description="number of best strings")] = 6
    samples: Annotated[
        WholeNumber, Field(ge=2, le=10**6, description="fresh samples of each string")
    ] = 100


class FramesOfBest(Section):
    """Frames of the first samples of the best strings, recorded after the search."""

    count: Annotated[WholeNumber, Field(ge=1, le=10**5, description="frames of each sample")]
    strings: Annotated[WholeNumber, Field(ge=1, description="number of best strings")] = 6
    samples: Annotated[WholeNumber, Field(ge=1, description="samples of each string")] = 1


class Output(Section):
    """Section `output`: name of the campaign file, and what it stores beside rows of samples."""

    file: Annotated[Line, Field(min_length=1)] | None = None
    final_particles: Flag = False
    frames: Annotated[FramesOfBest | None, NONE] = None
