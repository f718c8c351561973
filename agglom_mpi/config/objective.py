"""The `objective` section: what a string is worth."""

from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from agglom_mpi.config.units import Number, to_si
from agglom_mpi.config.user_function import check_call
from agglom_mpi.config.validation import NAMED, FieldError, Section, raise_field_errors
from agglom_mpi.config.yaml_source import Path
from agglom_mpi.search import objectives

MOMENTS: Final = ("mean", "spread", "skewness", "kurtosis", "second", "third", "fourth")
"""What may be wanted of the final radii b/b0 [A 24-25, 29]."""


class ObjectiveSection(Section):
    """What all objectives have."""

    def build(self, particles: int) -> objectives.Objective:
        """Return the objective of samples that start with N particles."""
        return objectives.objective_of(self.entries(), particles)


class GrowthTarget(ObjectiveSection):
    """Distance of the mean growth from a wanted one: |mean b/b0 / ratio - 1| [A 26]."""

    law: Literal["growth_target"]
    ratio: Annotated[Number, Field(ge=1)] = 2.0


class MaximumGrowth(ObjectiveSection):
    """Distance of the mean growth from one single aggregate: |1 - (b/b0) / N^(1/3)| [B 7.1]."""

    law: Literal["maximum_growth"]


def _given(value: Any) -> float:
    return to_si(value, "1")  # also refuses an entry that is empty


GIVEN: Final = BeforeValidator(_given)


class Targets(Section):
    """Wanted moments: the mean over samples; of all their particles together the others."""

    mean: Annotated[Annotated[float, Field(ge=1)] | None, GIVEN] = None
    spread: Annotated[Annotated[float, Field(ge=0)] | None, GIVEN] = None
    skewness: Annotated[float | None, GIVEN] = None
    kurtosis: Annotated[Annotated[float, Field(ge=1)] | None, GIVEN] = None
    second: Annotated[Annotated[float, Field(ge=0)] | None, GIVEN] = None
    third: Annotated[float | None, GIVEN] = None
    fourth: Annotated[Annotated[float, Field(ge=0)] | None, GIVEN] = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.kurtosis is not None and self.skewness is not None:
            least = 1.0 + self.skewness**2
            if self.kurtosis < least:
                message = f"is {self.kurtosis:g}; must be at least 1 + skewness^2, {least:g}"
                raise FieldError((("kurtosis",), message))
        return self


Weight = Annotated[Annotated[float, Field(gt=0)] | None, GIVEN]


class Weights(Section):
    """How much the miss of each target counts."""

    mean: Weight = None
    spread: Weight = None
    skewness: Weight = None
    kurtosis: Weight = None
    second: Weight = None
    third: Weight = None
    fourth: Weight = None


class Moments(ObjectiveSection):
    """Sum over targets of weight |M/target - 1|, or weight |M - target| where that is 0."""

    law: Literal["moments"]
    targets: Annotated[Targets, Field(description="such as {mean: 2, spread: 0.4}")]
    weights: Weights = Weights()

    @property
    def wanted(self) -> dict[str, float]:
        """Targets that are given, by name."""
        entries = self.targets.__dict__
        return {name: entries[name] for name in MOMENTS if entries[name] is not None}

    @property
    def weighting(self) -> dict[str, float]:
        """Weight of each of them."""
        entries = self.weights.__dict__
        return {name: 1.0 if entries[name] is None else entries[name] for name in self.wanted}

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if not self.wanted:
            message = f"are none; give at least one of {', '.join(MOMENTS)}"
            raise FieldError((("targets",), message))
        problems: list[tuple[Path, str]] = [
            (("weights", name), "is the weight of no target; leave it out, or give the target")
            for name in self.weights.model_fields_set
            if name not in self.wanted
        ]
        raise_field_errors(problems)
        return self

    def entries(self) -> dict[str, Any]:
        """Return what decides: the targets that are given, and a weight of each."""
        return {"law": self.law, "targets": self.wanted, "weights": self.weighting}


class Function(ObjectiveSection):
    """The mean over samples of what a user's function returns; see `config.user_function`."""

    law: Literal["function"]
    call: Annotated[
        str,
        AfterValidator(check_call),
        Field(description="module:function, of module.py beside the campaign file"),
    ]


Objective = GrowthTarget | MaximumGrowth | Moments | Function
AnyObjective = Annotated[Objective, Field(discriminator="law"), NAMED]
LAWS: Final = "growth_target, maximum_growth, moments, function"
