"""What heat do reactions in the contact release?"""

from typing import NamedTuple

from agglom_mpi.compilation import Submodel, question


class ContactAreaReaction(NamedTuple):
    """κ a^c for each sphere of the pair  [A 16] [B 6.9]."""

    heat: float


@question
def reaction_heat(model: Submodel | None, area: float) -> float:
    """Reaction heat of one sphere in J, from the contact area in m²."""


@reaction_heat.answer(None)
def _inert(model, area):  # type: ignore[no-untyped-def]
    return 0.0


@reaction_heat.answer(ContactAreaReaction)
def _contact_area(model, area):  # type: ignore[no-untyped-def]
    return model.heat * area
