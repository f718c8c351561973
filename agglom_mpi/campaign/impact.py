"""Submodels of one impact: restitution, duration, contact area, hardness, friction, solver."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from agglom_mpi.campaign.parts import NAMED, NAMED_OR_NONE, Part, RefusalError, WholeNumber
from agglom_mpi.campaign.quantities import Number, Time


class PressureRestitution(Part):
    """Restitution falls with the contact pressure over the hardness [A 6] [B 3.1, 4.13]."""

    law: Literal["pressure"] = "pressure"


class ConstantRestitution(Part):
    """One restitution for every impact; 0 bonds every contact.

    An impact less than `contact_time` (s) after the last one of either partner is elastic, which
    ends inelastic collapse (the TC model, Luding & McNamara 1998); 0: no impact is.
    """

    law: Literal["constant"]
    value: Annotated[Number, Field(ge=0, le=1, description="the restitution, 0 to 1")]
    contact_time: Annotated[Time, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _bounces(self) -> Self:
        if self.value == 0 and self.contact_time > 0:
            message = f"is {self.contact_time:g} s; must be 0 with value 0, where nothing bounces"
            raise RefusalError((("contact_time",), message))
        return self


class MeanSpeedDuration(Part):
    """The contact lasts as long as the mean speed needs for `length_ratio` radii [A 12]."""

    law: Literal["mean_speed"]
    length_ratio: Annotated[Number, Field(gt=0)] = 1e-6


class CompressionRecoveryDuration(Part):
    """Compression at the approach speed, then recovery, over `length_ratio` radii [B 4.10]."""

    law: Literal["compression_recovery"] = "compression_recovery"
    length_ratio: Annotated[Number, Field(gt=0)] = 1.0


class ContactArea(Part):
    """Contact area over that of the smaller sphere's disc, at e = 1 and e = 0 [A 11] [B 4.12]."""

    initial: Annotated[Number, Field(ge=0)] = 0.0
    final: Annotated[Number, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _grows(self) -> Self:
        if self.initial > self.final:
            message = f"is {self.initial:g}; must be at most final, which is {self.final:g}"
            raise RefusalError((("initial",), message))
        return self


class Hardness(Part):
    """Hardness: falling with temperature (arrhenius) or constant."""

    law: Literal["arrhenius", "constant"]


class Friction(Part):
    """Friction coefficient: times 1 - e [A 7], constant [B], or no friction."""

    law: Literal["restitution_scaled", "constant", "none"] = "none"


class RootSolver(Part):
    """The impact's equation e = G(e) solved with a bracketed root finder that cannot fail."""

    law: Literal["root"] = "root"


class IterationSolver(Part):
    """The published fixed-point iteration, which ends in a cycle for most impacts."""

    law: Literal["iteration"]
    tolerance: Annotated[Number, Field(gt=0)] = 1e-6
    cap: Annotated[WholeNumber, Field(ge=1)] = 100


AnyRestitution = Annotated[
    PressureRestitution | ConstantRestitution, Field(discriminator="law"), NAMED
]
AnyDuration = Annotated[
    MeanSpeedDuration | CompressionRecoveryDuration, Field(discriminator="law"), NAMED
]
AnyHardness = Annotated[Hardness, NAMED]
AnyFriction = Annotated[Friction, NAMED_OR_NONE]
AnySolver = Annotated[RootSolver | IterationSolver, Field(discriminator="law"), NAMED]
