"""The `objective` section: what the search minimises."""

from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from agglom_mpi.config.user_function import check_call
from agglom_mpi.declaration.sections import (
    NAMED,
    FieldError,
    FieldPath,
    Section,
    raise_field_errors,
)
from agglom_mpi.declaration.units import Number, to_si
from agglom_mpi.search import objectives

MOMENTS: Final = ("mean", "spread", "skewness", "kurtosis", "second", "third", "fourth")
"""Moments of the final radii b/b0 that may have a target [A 24-25, 29]."""


class ObjectiveSection(Section):
    """Base of the objectives."""

    def build(self, particles: float) -> objectives.Objective:
        """Return the objective of samples that start with `particles` grains of the radius b0."""
        return objectives.objective_of(self.entries(), particles)


class GrowthTarget(ObjectiveSection):
    """Distance of the mean growth from a wanted one: |mean b/b0 / ratio - 1| [A 26]."""

    law: Literal["growth_target"]
    ratio: Annotated[Number, Field(ge=1)] = 2.0

    @property
    def summary(self) -> str:
        """One line on the objective."""
        return f"mean radius ratio {self.ratio:g}, |mean/{self.ratio:g} - 1| [A 26]"


class MaximumGrowth(ObjectiveSection):
    """Distance of the mean growth from one single aggregate: |1 - (b/b0) / N^(1/3)| [B 7.1]."""

    law: Literal["maximum_growth"]
    summary: ClassVar[str] = "greatest growth, |1 - mean radius ratio / N^(1/3)| [B 7.1]"


def _read_target(value: Any) -> float:
    return to_si(value, "1")  # raises for an empty entry, too


TARGET: Final = BeforeValidator(_read_target)


class Targets(Section):
    """Targets: the mean over samples of b/b0; the other moments of all their particles pooled."""

    mean: Annotated[Annotated[float, Field(ge=1)] | None, TARGET] = None
    spread: Annotated[Annotated[float, Field(ge=0)] | None, TARGET] = None
    skewness: Annotated[float | None, TARGET] = None
    kurtosis: Annotated[Annotated[float, Field(ge=1)] | None, TARGET] = None
    second: Annotated[Annotated[float, Field(ge=0)] | None, TARGET] = None
    third: Annotated[float | None, TARGET] = None
    fourth: Annotated[Annotated[float, Field(ge=0)] | None, TARGET] = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.kurtosis is not None and self.skewness is not None:
            least = 1.0 + self.skewness**2
            if self.kurtosis < least:
                message = f"is {self.kurtosis:g}; must be at least 1 + skewness^2, {least:g}"
                raise FieldError((("kurtosis",), message))
        return self


Weight = Annotated[Annotated[float, Field(gt=0)] | None, TARGET]


class Weights(Section):
    """Weights of the targets' relative misses."""

    mean: Weight = None
    spread: Weight = None
    skewness: Weight = None
    kurtosis: Weight = None
    second: Weight = None
    third: Weight = None
    fourth: Weight = None


class Moments(ObjectiveSection):
    """Sum over targets of weight |M/target - 1|, or weight |M - target| where that is 0 [A 29]."""

    law: Literal["moments"]
    targets: Annotated[Targets, Field(description="such as {mean: 2, spread: 0.4}")]
    weights: Weights = Weights()

    @property
    def summary(self) -> str:
        """One line on the objective."""
        weights = self.weighting
        targets = [
            f"{name} {target:g}" + (f" (weight {weights[name]:g})" if weights[name] != 1.0 else "")
            for name, target in self.wanted.items()
        ]
        return f"moments of the final radii, relative misses added up: {', '.join(targets)} [A 29]"

    @property
    def wanted(self) -> dict[str, float]:
        """Given targets by name."""
        entries = self.targets.__dict__
        return {name: entries[name] for name in MOMENTS if entries[name] is not None}

    @property
    def weighting(self) -> dict[str, float]:
        """Weight of each given target."""
        entries = self.weights.__dict__
        return {name: 1.0 if entries[name] is None else entries[name] for name in self.wanted}

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if not self.wanted:
            message = f"are none; give at least one of {', '.join(MOMENTS)}"
            raise FieldError((("targets",), message))
        problems: list[tuple[FieldPath, str]] = [
            (("weights", name), "is the weight of no target; leave it out, or give the target")
            for name in self.weights.model_fields_set
            if name not in self.wanted
        ]
        raise_field_errors(problems)
        return self

    def entries(self) -> dict[str, Any]:
        """Return the given targets and the weight of each."""
        return {"law": self.law, "targets": self.wanted, "weights": self.weighting}


class Function(ObjectiveSection):
    """Mean over samples of a user's function; see `config.user_function`."""

    law: Literal["function"]
    call: Annotated[
        str,
        AfterValidator(check_call),
        Field(description="module:function, of module.py beside the campaign file"),
    ]

    @property
    def summary(self) -> str:
        """One line on the objective."""
        return f"mean over samples of {self.call}"


Objective = GrowthTarget | MaximumGrowth | Moments | Function
AnyObjective = Annotated[Objective, Field(discriminator="law"), NAMED]
LAWS: Final = "growth_target, maximum_growth, moments, function"
