"""Quantities of a string that follow from its scene and variables, by name, in SI units.

Expressions may name them, and `agglom check` prints them.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.physics import scales
from agglom_mpi.physics.constants import GAS_CONSTANT
from agglom_mpi.variables import NAMES, VARIABLES, values_by_name, volume_fraction

if TYPE_CHECKING:
    from agglom_mpi.config.scene import SceneSection

Floats = NDArray[np.float64]
Value = Mapping[str, float]
"""The ten variables of one string, in SI units, by name."""

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


def units_of(used: Iterable[str]) -> dict[str, str]:
    """Return the SI units of all that expressions may name, by name.

    Parameters
    ----------
    used
        Names of the variables that the scene depends on.
    """
    units = {variable.name: variable.unit for variable in VARIABLES if variable.name in set(used)}
    units |= {quantity.name: quantity.unit for quantity in QUANTITIES}
    return units | {name: unit for name, (unit, _) in CONSTANTS.items()}


def quantity_values(
    scene: "SceneSection", names: Iterable[str], parameters: Mapping[str, Floats]
) -> dict[str, Any]:
    """Return the values of constants, and of quantities of n strings, in SI units, by name.

    Parameters
    ----------
    scene
        Section of the campaign.
    names
        What to return; other names than these are left out.
    parameters
        The ten variables in SI units, each (n,).

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
    shape = np.shape(parameters[NAMES[0]])
    for quantity in chosen:
        if quantity.elementwise:
            values[quantity.name] = np.broadcast_to(quantity.compute(scene, parameters), shape)
        else:
            values[quantity.name] = one_by_one(scene, quantity, parameters)
    return values


def one_by_one(
    scene: "SceneSection", quantity: Quantity, parameters: Mapping[str, Floats]
) -> Floats:
    """Return a quantity of n strings, each by itself, (n,); arguments as for `quantity_values`."""
    strings = np.column_stack([np.asarray(parameters[name], np.float64) for name in NAMES])
    values = [_value(quantity, scene, values_by_name(string)) for string in strings]
    return np.array(values, np.float64)


def _value(quantity: Quantity, scene: "SceneSection", row: Value) -> float:
    try:
        return float(quantity.compute(scene, row))
    except (ArithmeticError, ValueError):
        return math.nan
