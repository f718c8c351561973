"""Dimensions of quantities as powers of the base dimensions, which pint knows of units."""

import math
from collections.abc import Mapping
from fractions import Fraction
from functools import cache
from typing import Final

from agglom_mpi.declaration.units import KINDS, dimensions_of

Dimension = tuple[tuple[str, Fraction], ...]
"""Base dimensions with their powers other than 0, in alphabetical order."""

PURE: Final[Dimension] = ()
"""The dimension of a pure number."""

MAX_DENOMINATOR: Final = 1000
"""Largest denominator of a simple power, so that the cube of a third power is the first."""

BASE_UNITS: Final = {
    "[mass]": "kg",
    "[length]": "m",
    "[time]": "s",
    "[current]": "A",
    "[temperature]": "K",
    "[substance]": "mol",
    "[luminosity]": "cd",
}
"""SI units of the base dimensions, in the order in which they are written."""

FURTHER_KINDS: Final = {
    "W/m^3": "power per volume",
    "J/kg": "energy per mass",
    "kg/s": "mass per time",
    "kg/m^2/s": "mass flux",
    "1/m": "inverse length",
    "1/m^3": "number per volume",
    "m^2/s": "diffusivity",
    "Pa*s": "viscosity",
    "W/m/K": "thermal conductivity",
    "J/K": "heat capacity",
}
"""Names of more dimensions than `units.KINDS` has, by SI unit."""


def _dimension(powers: Mapping[str, Fraction]) -> Dimension:
    return tuple(sorted((name, power) for name, power in powers.items() if power != 0))


def dimension_of(unit: str) -> Dimension:
    """Return the dimension of a unit; raise a ValueError if there is no such unit."""
    powers = dimensions_of(unit).items()
    return _dimension({name: _fraction(power) for name, power in powers})


def _fraction(power: float) -> Fraction:
    """Return a power as a fraction: a simple one only if it is the same in float64."""
    simple = Fraction(power).limit_denominator(MAX_DENOMINATOR)
    return simple if math.isclose(simple, power, rel_tol=1e-14) else Fraction(repr(float(power)))


def product(left: Dimension, right: Dimension) -> Dimension:
    """Return the dimension of a product."""
    powers = dict(left)
    for name, power in right:
        powers[name] = powers.get(name, Fraction(0)) + power
    return _dimension(powers)


def power(dimension: Dimension, exponent: float) -> Dimension:
    """Return the dimension of a power."""
    return _dimension({name: each * _fraction(exponent) for name, each in dimension})


@cache
def _known() -> dict[Dimension, tuple[str, str]]:
    """Return unit and kind by dimension; the first of several with the same."""
    known: dict[Dimension, tuple[str, str]] = {}
    for unit, kind in (KINDS | FURTHER_KINDS).items():
        known.setdefault(dimension_of(unit), (unit, kind))
    return known


def kind_of(dimension: Dimension) -> str:
    """Return the name of a dimension for a message: `pressure`, or its unit."""
    if dimension in _known():
        return _known()[dimension][1]
    return f"a quantity in {unit_of(dimension)}"


def unit_of(dimension: Dimension) -> str:
    """Return the SI unit of a dimension in ASCII: `Pa`, `kg/m/s^3`."""
    if dimension in _known():
        return _known()[dimension][0]
    powers = dict(dimension)
    order = [*BASE_UNITS, *(name for name in powers if name not in BASE_UNITS)]
    factors = [
        (BASE_UNITS.get(name, name.strip("[]")), powers[name]) for name in order if name in powers
    ]
    above = [_factor(unit, power) for unit, power in factors if power > 0]
    below = [_factor(unit, -power) for unit, power in factors if power < 0]
    return "/".join(["*".join(above) or "1", *below])


def _factor(unit: str, power: Fraction) -> str:
    if power == 1:
        return unit
    return f"{unit}^{power}" if power.denominator == 1 else f"{unit}^({power})"
