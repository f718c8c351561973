"""Submodels of heat: heating at impact, reaction, fragmentation, cooling between impacts."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from agglom_mpi.campaign.parts import NAMED_OR_NONE, Part, RefusalError
from agglom_mpi.campaign.quantities import HeatTransfer, Number, Temperature

Integration = Literal["exact", "euler"]
"""The exact solution, or as published one step per time step of the engine, if it has any."""


class Heating(Part):
    """Who gets the energy an impact dissipates: the pair [A 14-17] or each its own [B 6.5-6.10]."""

    law: Literal["pair_split", "own_energy", "none"] = "pair_split"


class Reaction(Part):
    """Heat of reaction per contact area, or none."""

    law: Literal["contact_area", "none"] = "none"


class Fragmentation(Part):
    """Energy that may break an aggregate: dissipated by the pair, or its own [B 5.1-5.5]."""

    law: Literal["pair_energy", "own_energy", "none"] = "none"


class NoCooling(Part):
    """Nothing cools between impacts."""

    law: Literal["none"] = "none"


class RadiationCooling(Part):
    """Radiation and convection [B 6.19-6.21]; temperatures in K, convection in W/m^2/K."""

    law: Literal["radiation"]
    emissivity: Annotated[Number, Field(ge=0, le=1, description="0 to 1")]
    surroundings: Annotated[Temperature, Field(ge=0, description="a temperature like '300 K'")]
    convection: Annotated[HeatTransfer, Field(ge=0)] = 0.0
    ambient: Annotated[Temperature, Field(ge=0)] = 300.0
    integration: Integration = "exact"

    @model_validator(mode="after")
    def _ambient_is_given(self) -> Self:
        if self.convection > 0 and "ambient" not in self.model_fields_set:
            message = "is missing; the temperature that convection cools to, like '300 K'"
            raise RefusalError((("ambient",), message))
        return self


class QuarticCooling(Part):
    """The published law (theta - theta0)^4, bounded at the starting temperature [A 18-19]."""

    law: Literal["quartic"]
    integration: Integration = "exact"


AnyHeating = Annotated[Heating, NAMED_OR_NONE]
AnyReaction = Annotated[Reaction, NAMED_OR_NONE]
AnyFragmentation = Annotated[Fragmentation, NAMED_OR_NONE]
AnyCooling = Annotated[
    NoCooling | RadiationCooling | QuarticCooling, Field(discriminator="law"), NAMED_OR_NONE
]
