"""Other units of length, mass and time, in which a law must give the same results.

The kelvin and the mole stay as they are. Physical constants in a law's formulas are numbers in SI
units; other units are chosen so that these constants keep their values.
"""

import math
from collections.abc import Iterable
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.points import Domain, Interval, Point
from agglom_mpi.declaration.units import dimensions_of

BASES: Final = ("[length]", "[mass]", "[time]")
"""Base dimensions that are scaled."""

UNIT_NAMES: Final = ("unit_length", "unit_mass", "unit_time")
"""Names, in a point, of the logarithms to base 10 of the new units over those of SI."""

UNIT_DOMAIN: Final[Domain] = {name: Interval(-4.0, 4.0, "1", False) for name in UNIT_NAMES}


@cache
def exponents(unit: str) -> tuple[float, ...]:
    """Return the powers of length, mass and time in a unit, without other dimensions."""
    found = dimensions_of(unit)
    return tuple(found.get(base, 0.0) for base in BASES)


def factor(unit: str, logarithms: NDArray[np.float64]) -> float:
    """Return the factor of a number in a unit when it is in other units; see `other_units`."""
    return float(10.0 ** -(np.array(exponents(unit)) @ logarithms))


def other_units(point: Point, constants: Iterable[str]) -> NDArray[np.float64] | None:
    """Return the logarithms of new units over those of SI, near those of a point, shape (3,).

    Constants with the given units keep their values. None: that leaves SI alone.
    """
    wanted = np.array([point[name] for name in UNIT_NAMES])
    fixed = np.array([exponents(unit) for unit in constants]).reshape(-1, len(BASES))
    free = np.eye(len(BASES)) - np.linalg.pinv(fixed) @ fixed
    chosen = free @ wanted
    return chosen if float(np.abs(chosen).max()) > math.sqrt(np.finfo(float).eps) else None


def scaled_point(point: Point, domain: Domain, logarithms: NDArray[np.float64]) -> Point:
    """Return a point in other units; numbers that a domain does not have stay as they are."""
    return {
        name: value * factor(domain[name].unit, logarithms) if name in domain else value
        for name, value in point.items()
    }
