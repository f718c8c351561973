"""Columns that follow from the variables of a string: what its campaign's author asked for.

They are the volume fraction where the file gives it in place of the size ratio, the half-width of
the box where it gives the size of the grains, and the derived quantities.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.quantities import BY_NAME, quantity_values

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

Floats = NDArray[np.float64]


class DerivedColumn(NamedTuple):
    """A column of n strings that follows from their variables, in SI units.

    Attributes
    ----------
    name, unit
    values
        Shape (n,).
    own
        Whether it is a derived quantity of the file.
    """

    name: str
    unit: str
    values: Floats
    own: bool


def columns_of(campaign: "Campaign", strings: Floats) -> list[DerivedColumn]:
    """Return the derived columns of strings, (n, k), of a campaign."""
    implied = ["volume_fraction"] if campaign.variables.by_volume_fraction else []
    implied += [] if campaign.scene.diameter is None else ["half_width"]
    parameters = campaign.variables.columns_by_name(strings)
    values = quantity_values(campaign.scenes, implied, parameters)
    columns = [DerivedColumn(n, BY_NAME[n].unit, values[n], False) for n in implied]
    own = campaign.derived_values(strings)
    return columns + [
        DerivedColumn(each.name, each.unit, own[each.name], True)
        for each in campaign.relations.derived
    ]
