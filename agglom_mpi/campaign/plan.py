"""Everything but the scene and the variables: objective, search, ensemble, stopping, output."""

from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, model_validator

from agglom_mpi.campaign.parts import NAMED, Flag, Line, Part, RefusalError, WholeNumber, refuse
from agglom_mpi.campaign.quantities import Number, Time
from agglom_mpi.campaign.source import Path


def _none(value: Any) -> Any:
    return None if value == "none" else value


NONE = BeforeValidator(_none)
"""Reads the word `none` as an absent part."""


class GrowthTarget(Part):
    """Distance of the mean growth from a wanted one: |mean b/b0 / ratio - 1| [A 26]."""

    law: Literal["growth_target"]
    ratio: Annotated[Number, Field(ge=1)] = 2.0


class MaximumGrowth(Part):
    """Distance of the mean growth from one single aggregate: |1 - (b/b0) / N^(1/3)| [B 7.1]."""

    law: Literal["maximum_growth"]


Objective = GrowthTarget | MaximumGrowth
AnyObjective = Annotated[Objective, Field(discriminator="law"), NAMED]


class Rescale(Part):
    """Every so many generations, shrink the search box around the best string by a factor."""

    every: Annotated[WholeNumber, Field(ge=1, description="a number of generations")]
    factor: Annotated[Number, Field(gt=0, lt=1, description="between 0 and 1")]


class Search(Part):
    """The genetic algorithm [A 22] [B section 7]."""

    method: Literal["genetic"] = "genetic"
    population: Annotated[WholeNumber, Field(ge=4, le=10**5)] = 20
    parents: Annotated[WholeNumber, Field(ge=2, multiple_of=2)] = 6
    blend: tuple[Number, Number] = (0.0, 1.0)
    rescale: Annotated[Rescale | None, NONE] = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems: list[tuple[Path, str]] = []
        if 2 * self.parents > self.population:
            message = (
                f"is {self.parents}; parents and as many offspring must fit into the population "
                f"of {self.population}, so at most {self.population // 4 * 2}"
            )
            problems.append((("parents",), message))
        lower, upper = self.blend
        if lower >= upper:
            message = f"is [{lower:g}, {upper:g}]; the lower end must be less than the upper"
            problems.append((("blend",), message))
        refuse(problems)
        return self


class _Samples(Part):
    """What every rule needs: a tolerance and the limits of a string's samples."""

    tolerance: Annotated[Number, Field(gt=0, description="a small number like 1e-3")]
    max_samples: Annotated[
        WholeNumber, Field(ge=2, le=10**6, description="the most samples of a string")
    ]
    min_samples: Annotated[WholeNumber, Field(ge=2)] = 2

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_samples > self.max_samples:
            message = f"is {self.min_samples}; must be at most max_samples, {self.max_samples}"
            raise RefusalError((("min_samples",), message))
        return self


class SuccessiveDifference(_Samples):
    """Stop when one more sample changes the running mean by less [A 27] [B 8.1]."""

    rule: Literal["successive_difference"]
    quantity: Literal["mean_radius", "objective"] = "objective"


class Moments(_Samples):
    """The same for the moments 1 to `order` of the radii [A 25, 27]."""

    rule: Literal["moments"]
    order: Annotated[WholeNumber, Field(ge=1, le=4)] = 4


class StandardError(_Samples):
    """Stop when half the 95 % t interval of the objective is at most the tolerance."""

    rule: Literal["standard_error"]
    min_samples: Annotated[WholeNumber, Field(ge=3)] = 5


Ensemble = SuccessiveDifference | Moments | StandardError
AnyEnsemble = Annotated[Ensemble, Field(discriminator="rule")]


class Target(Part):
    """Stop when the mean objective of the best `top` strings is `objective` or less."""

    top: Annotated[WholeNumber, Field(ge=1, description="a number of strings")]
    objective: Annotated[Number, Field(ge=0, description="like 5e-4")]


class Stopping(Part):
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


class FramesOfBest(Part):
    """Pictures of the first samples of the best strings, taken when the search is over."""

    count: Annotated[WholeNumber, Field(ge=1, le=10**5, description="pictures of each sample")]
    strings: Annotated[WholeNumber, Field(ge=1, description="so many of the best")] = 6
    samples: Annotated[WholeNumber, Field(ge=1, description="so many of each string")] = 1


class Output(Part):
    """Where the database is written, and what is kept beside a row for each sample."""

    file: Annotated[Line, Field(min_length=1)] | None = None
    final_particles: Flag = False
    frames: Annotated[FramesOfBest | None, NONE] = None
