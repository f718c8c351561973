"""How large is the surface over which two colliding spheres touch?"""

import math
from typing import NamedTuple

from agglom_mpi.compilation import stage


class ContactArea(NamedTuple):
    """a^c = (a₀ + (a_f − a₀)(1 − e))·πb², with 0 ≤ a₀ ≤ a_f  [A 11] [B 4.12]."""

    initial: float
    final: float


@stage
def area_fraction(model: ContactArea, deficit: float) -> float:
    """Contact area over the cross section of the smaller sphere, at 1 − e = `deficit`."""
    return model.initial + (model.final - model.initial) * deficit


@stage
def area_slope(model: ContactArea, radius: float) -> float:
    """Change of the contact area with the deficit 1 − e, m²."""
    return (model.final - model.initial) * math.pi * radius * radius


@stage
def contact_area(model: ContactArea, deficit: float, radius: float) -> float:
    """Contact area in m² of spheres whose smaller radius is `radius` in m."""
    return area_fraction(model, deficit) * math.pi * radius * radius
