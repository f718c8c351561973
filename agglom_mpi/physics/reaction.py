"""Heat of reaction of two spheres in contact."""

from typing import ClassVar, Final, Literal

from agglom_mpi.compilation.stages import formula
from agglom_mpi.declaration.laws import Group, Law
from agglom_mpi.declaration.needed import needed

REACTION: Final = Group(
    "κ/(ρbCθ)",
    "heat of reaction over heat of the grains",
    {
        "reaction_heat": 1.0,
        "density": -1.0,
        "grain_radius": -1.0,
        "heat_capacity": -1.0,
        "temperature": -1.0,
    },
)


class Reaction(Law):
    """Law of the heat that a contact sets free in each of its two spheres."""

    @needed
    def contact_heat(self, area: float) -> float:
        """Reaction heat of one sphere in J, from the contact area in m²."""
        raise NotImplementedError


class ContactAreaReaction(Reaction):
    """κ a^c for each sphere of the pair; `reaction_heat` κ in J/m²  [A 14-17] [B 6.5-6.10]."""

    law: Literal["contact_area"] = "contact_area"
    summary: ClassVar[str] = "heat per contact area [A 14-17] [B 6.5-6.10]"
    variables = ("reaction_heat",)
    groups = (REACTION,)

    def contact_heat(self, area):
        """κ a^c in J  [A 16] [B 6.9]."""
        return self.reaction_heat * area


class NoReaction(Reaction):
    """Inert grains."""

    law: Literal["none"] = "none"
    summary: ClassVar[str] = "inert grains"
    is_absent = True

    def contact_heat(self, area):
        """0."""
        return 0.0


contact_heat = formula(Reaction, Reaction.contact_heat)
