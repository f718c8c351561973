"""The ten search variables of the papers: their names, units, symbols and order."""

from math import pi
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt


class Variable(NamedTuple):
    """One component of a parameter string: name, SI unit, symbol and meaning."""

    name: str
    unit: str
    symbol: str
    meaning: str


VARIABLES: Final = (
    Variable("relative_speed", "m/s", "v0", "scale of the starting velocities [A 28] [B 7.3]"),
    Variable("size_ratio", "1", "l", "grain diameter over grain spacing (s in [A], L in [B])"),
    Variable("density", "kg/m^3", "rho", "density of the grains"),
    Variable("hardness", "Pa", "H0", "base hardness, its limit at high temperature"),
    Variable("heat_capacity", "J/kg/K", "C", "heat capacity per unit mass"),
    Variable("friction", "1", "mu0", "base coefficient of friction"),
    Variable("temperature", "K", "theta0", "starting temperature"),
    Variable("activation_energy", "J/mol", "U", "activation energy of softening (U, Omega)"),
    Variable("reaction_heat", "J/m^2", "kappa", "reaction heat per contact area (kappa, alpha)"),
    Variable("surface_energy", "J/m^2", "gamma", "energy per area of new surface"),
)
"""All search variables; a parameter string is a float64 vector in this order."""

NAMES: Final = tuple(variable.name for variable in VARIABLES)
COUNT: Final = len(VARIABLES)


def values_by_name(string: npt.ArrayLike) -> dict[str, float]:
    """Return the ten variables of one string, (10,), by name."""
    return dict(zip(NAMES, np.asarray(string, np.float64).tolist(), strict=True))


def columns_by_name(strings: npt.ArrayLike) -> dict[str, npt.NDArray[np.float64]]:
    """Return the ten variables of n strings, (n, 10), by name, each (n,)."""
    return dict(zip(NAMES, np.asarray(strings, np.float64).T, strict=True))


VOLUME_FRACTION: Final = Variable(
    "volume_fraction", "1", "phi", "share of the box that the grains fill at the start"
)
"""What may be given in place of the size ratio."""


def volume_fraction(size_ratio: float, third_moment: float = 1.0) -> float:
    """Return the share of the box that the grains fill, (pi/6) size_ratio^3 <b^3>/<b>^3.

    The last factor, 1 of equal grains, is the `third_moment` of the law of their sizes.
    """
    return pi / 6.0 * size_ratio**3 * third_moment


def size_ratio(fraction: float, third_moment: float = 1.0) -> float:
    """Return the size ratio of grains that fill a share of the box, as `volume_fraction`."""
    return float((6.0 * fraction / (pi * third_moment)) ** (1.0 / 3.0))
