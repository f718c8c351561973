"""Quantities of a string that follow from its scene and variables, by name, in SI units.

Expressions may name them, and `agglom check` prints them. Columns of a table of strings are those
that its campaign's author asked for: the volume fraction where the file gives it in place of the
size ratio, the half-width of the box where it gives the size of the grains, derived quantities.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.physics import scales
from agglom_mpi.physics.constants import GAS_CONSTANT
from agglom_mpi.variables import TEN, VariableTable, volume_fraction

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.config.scene import SceneSection
    from agglom_mpi.config.string_scenes import StringScene, StringScenes

Floats = NDArray[np.float64]
Value = Mapping[str, float]
"""The variables of one string, in SI units, by name."""

CONSTANTS: Final = {"pi": ("1", math.pi), "gas_constant": ("J/mol/K", GAS_CONSTANT)}
"""Constants that expressions may name: unit and value."""


class Quantity(NamedTuple):
    """A quantity of one string: name, SI unit, meaning, and what it is.

    `compute` takes the scene and the variables by name, and raises a ValueError where the scene has
    no such string. Where it is `elementwise` it takes arrays, too.
    """

    name: str
    unit: str
    meaning: str
    compute: "Callable[[SceneSection, Any], Any]"
    elementwise: bool = True


QUANTITIES: Final = (
    Quantity(
        "grain_diameter",
        "m",
        "diameter of the grains, their mean",
        lambda scene, value: 2.0 * scales.grain_radius(scene, value),
    ),
    Quantity("grain_radius", "m", "radius of the grains b0, their mean", scales.grain_radius),
    Quantity("grain_mass", "kg", "mass of a grain of the radius b0", scales.grain_mass, False),
    Quantity("half_width", "m", "half the edge of the box D", scales.half_width),
    Quantity("particles", "1", "number of grains N", lambda scene, value: scene.particles),
    Quantity(
        "volume_fraction",
        "1",
        "share of the box that the grains fill at the start",
        lambda scene, value: volume_fraction(value["size_ratio"], scene.third_moment),
    ),
    Quantity("number_density", "1/m^3", "grains per volume at the start", scales.number_density),
    Quantity(
        "mean_free_path", "m", "mean free path of elastic grains at the start", scales.free_path
    ),
    Quantity("end_time", "s", "end time", scales.end_time, False),
    Quantity(
        "expected_collisions",
        "1",
        "collisions of a grain until the end time, were all elastic, by Enskog's theory",
        scales.expected_collisions,
        False,
    ),
)
"""Quantities that every scene has."""

BY_NAME: Final = {quantity.name: quantity for quantity in QUANTITIES}


def units_of(used: Iterable[str], table: VariableTable = TEN) -> dict[str, str]:
    """Return the SI units of all that expressions may name, by name.

    Parameters
    ----------
    used
        Names of the variables that the scene depends on.
    table
        The variables of the campaign.
    """
    units = {quantity.name: quantity.unit for quantity in QUANTITIES}
    units = {name: table[name].unit for name in table.names if name in set(used)} | units
    return units | {name: unit for name, (unit, _) in CONSTANTS.items()}


def quantity_values(
    scenes: "StringScenes", names: Iterable[str], parameters: Mapping[str, Floats]
) -> dict[str, Any]:
    """Return the values of constants, and of quantities of n strings, in SI units, by name.

    Parameters
    ----------
    scenes
        Of the campaign.
    names
        What to return; other names than these are left out.
    parameters
        The variables in SI units, each (n,).

    Returns
    -------
    dict
        Numbers or arrays, (n,); nan for a string that cannot be simulated.
    """
    wanted = set(names)
    values: dict[str, Any] = {n: value for n, (_, value) in CONSTANTS.items() if n in wanted}
    chosen = [quantity for quantity in QUANTITIES if quantity.name in wanted]
    if not chosen:
        return values
    alike = {
        quantity.name for quantity in chosen if quantity.elementwise and not scenes.lengths_differ
    }
    rows = scenes.rows(parameters) if len(alike) < len(chosen) else []
    shape = np.shape(next(iter(parameters.values())))
    for quantity in chosen:
        if quantity.name in alike:
            found = quantity.compute(scenes.section, parameters)
            values[quantity.name] = np.broadcast_to(found, shape)
        else:
            values[quantity.name] = one_by_one(rows, quantity)
    return values


def one_by_one(rows: "Sequence[StringScene | None]", quantity: Quantity) -> Floats:
    """Return a quantity of the scenes of n strings, each by itself, (n,).

    It is nan for a string that cannot be simulated; None stands for one without a scene.
    """
    found = np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        with suppress(ArithmeticError, ValueError):
            found[i] = np.nan if row is None else quantity.compute(row.section, row.values)
    return found


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
