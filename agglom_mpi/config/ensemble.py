"""How much to simulate and what to keep: ensemble, stopping, output."""

from typing import Annotated, Any, Final, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, TypeAdapter, model_validator

from agglom_mpi.config.search import Search
from agglom_mpi.config.units import Number, Time
from agglom_mpi.config.validation import LATER, FieldError, Flag, Line, Section, WholeNumber
from agglom_mpi.search import stopping


def _none(value: Any) -> Any:
    return None if value == "none" else value


NONE = BeforeValidator(_none)
"""Reads the word `none` as an absent part."""


class Racing(Section):
    """Stop sampling a string that will not be among the kept parents."""

    confidence: Annotated[Number, Field(gt=0.5, lt=1, description="like 0.95")] = 0.95
    first: Annotated[WholeNumber, Field(ge=2, le=10**4)] = 5

    def build(self, kept: int) -> stopping.Race:
        """Return the race for so many places among the kept strings."""
        return stopping.Race(kept, self.confidence, self.first)


class _Ensemble(Section):
    """What every rule has: whether all strings start from the same random configurations."""

    common_configurations: Annotated[Flag, LATER] = False


class _Samples(_Ensemble):
    """What rules need that stop: a tolerance and the limits of a string's samples."""

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
    """Stop when one more sample changes the running mean by less [A 27] [B 8.1]."""

    rule: Literal["successive_difference"]
    quantity: Literal["mean_radius", "objective"] = "objective"

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.SuccessiveDifference(self.tolerance, self.quantity)


class Moments(_Samples):
    """The same for the moments 1 to `order` of the radii [A 25, 27]."""

    rule: Literal["moments"]
    order: Annotated[WholeNumber, Field(ge=1, le=4)] = 4

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.Moments(self.tolerance, self.order)


class StandardError(_Samples):
    """Stop when half the 95 % t interval of the objective is at most the tolerance."""

    rule: Literal["standard_error"]
    min_samples: Annotated[WholeNumber, Field(ge=3)] = 5

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.StandardError(self.tolerance, self.min_samples)


class FixedNumber(_Ensemble):
    """The same number of samples for every string."""

    rule: Literal["fixed"]
    samples: Annotated[WholeNumber, Field(ge=1, le=10**6, description="a number of samples")]

    def build(self) -> stopping.StoppingRule:
        """Return the stopping rule."""
        return stopping.FixedNumber()

    @property
    def racing(self) -> None:
        """There is nothing to stop."""

    @property
    def min_samples(self) -> int:
        """Fewest completed samples: some may fail."""
        return 1

    @property
    def max_samples(self) -> int:
        """Most samples."""
        return self.samples


AdaptiveEnsemble = SuccessiveDifference | Moments | StandardError
Ensemble = AdaptiveEnsemble | FixedNumber
AnyEnsemble = Annotated[Ensemble, Field(discriminator="rule")]
ENSEMBLE: Final[TypeAdapter[Ensemble]] = TypeAdapter(AnyEnsemble)
"""Reads the `ensemble` section alone."""


class Target(Section):
    """Stop when the mean objective of the best `top` strings is `objective` or less."""

    top: Annotated[WholeNumber, Field(ge=1, description="a number of strings")]
    objective: Annotated[Number, Field(description="like 5e-4")]


class Stopping(Section):
    """What ends the campaign."""

    generations: Annotated[WholeNumber, Field(ge=1, le=10**6, description="the most generations")]
    target: Annotated[Target | None, NONE] = None
    max_failures: Annotated[WholeNumber, Field(ge=1)] = 100
    max_seconds: Annotated[Annotated[Time, Field(gt=0)] | None, NONE] = None


class Plan(NamedTuple):
    """How to search: the sections that a scene alone does without."""

    search: Search
    ensemble: Ensemble
    stopping: Stopping


class FinalAnswer(Section):
    """When the search is over, the best strings are estimated again on fresh configurations."""

    strings: Annotated[WholeNumber, Field(ge=1, le=10**5, description="so many of the best")] = 6
    samples: Annotated[
        WholeNumber, Field(ge=2, le=10**6, description="fresh samples of each string")
    ] = 100


class FramesOfBest(Section):
    """Pictures of the first samples of the best strings, taken when the search is over."""

    count: Annotated[WholeNumber, Field(ge=1, le=10**5, description="pictures of each sample")]
    strings: Annotated[WholeNumber, Field(ge=1, description="so many of the best")] = 6
    samples: Annotated[WholeNumber, Field(ge=1, description="so many of each string")] = 1


class Output(Section):
    """Where the database is written, and what is kept beside a row for each sample."""

    file: Annotated[Line, Field(min_length=1)] | None = None
    final_particles: Flag = False
    frames: Annotated[FramesOfBest | None, NONE] = None
