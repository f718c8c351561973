"""The variables of a campaign: their names, units, symbols and order in a parameter string."""

from collections.abc import Iterable
from math import isfinite, pi
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

MAX_VARIABLE_NAME: Final = 64
"""Maximum length of the name of a variable in bytes, for which campaign files have room."""


class Limits(NamedTuple):
    """Limits of a number in its SI unit; None where there is none."""

    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    below: float | None = None

    def broken_by(self, number: float) -> str:
        """Return which limit a number breaks: `greater than 0`; empty if it breaks none."""
        if not isfinite(number):
            return "a finite number"
        if self.above is not None and not number > self.above:
            return f"greater than {self.above:g}"
        if self.at_least is not None and not number >= self.at_least:
            return f"at least {self.at_least:g}"
        if self.at_most is not None and not number <= self.at_most:
            return f"at most {self.at_most:g}"
        if self.below is not None and not number < self.below:
            return f"less than {self.below:g}"
        return ""


class Variable(NamedTuple):
    """One component of a parameter string: name, SI unit, symbol and meaning.

    `limits` are those of a number of the scene; None for the variables of the papers.
    """

    name: str
    unit: str
    symbol: str
    meaning: str
    limits: Limits | None = None


PAPER_VARIABLES: Final = (
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
"""The ten search variables of the papers, with which every parameter string begins."""


class VariableTable:
    """The variables of a campaign; a parameter string is a float64 vector in their order.

    Those of the papers come first, then further ones in the order of their names: numbers of the
    scene by their paths, such as `restitution.value`.

    Parameters
    ----------
    further
        Variables beside those of the papers, in any order.

    Attributes
    ----------
    variables
        All of them, in their order.
    names
        Their names.
    """

    def __init__(self, further: Iterable[Variable] = ()) -> None:
        own = sorted(further, key=lambda variable: variable.name)
        self.variables = (*PAPER_VARIABLES, *own)
        self.names = tuple(variable.name for variable in self.variables)
        self._places = {name: place for place, name in enumerate(self.names)}
        if len(self._places) < len(self.names):
            raise ValueError("two variables have one name")

    @property
    def count(self) -> int:
        """Number of variables k, the length of a string."""
        return len(self.variables)

    @property
    def further(self) -> tuple[Variable, ...]:
        """The variables beside those of the papers."""
        return self.variables[len(PAPER_VARIABLES) :]

    @property
    def further_names(self) -> tuple[str, ...]:
        """Names of the variables beside those of the papers."""
        return self.names[len(PAPER_VARIABLES) :]

    def has_numbers_of(self, section: str) -> bool:
        """Return whether a number of a section of the scene, such as `sizes`, is a variable."""
        return any(name.split(".")[0] == section for name in self.further_names)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __getitem__(self, name: str) -> Variable:
        return self.variables[self._places[name]]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, VariableTable) and self.variables == other.variables

    def __hash__(self) -> int:
        return hash(self.variables)

    def index(self, name: str) -> int:
        """Return the place of a variable in a string; raises KeyError if there is none."""
        return self._places[name]

    def values_by_name(self, string: npt.ArrayLike) -> dict[str, float]:
        """Return the variables of one string, (k,), by name."""
        return dict(zip(self.names, np.asarray(string, np.float64).tolist(), strict=True))

    def columns_by_name(self, strings: npt.ArrayLike) -> dict[str, npt.NDArray[np.float64]]:
        """Return the variables of n strings, (n, k), by name, each (n,)."""
        return dict(zip(self.names, np.asarray(strings, np.float64).T, strict=True))

    def of_other(
        self, strings: npt.NDArray[np.float64], other: "VariableTable"
    ) -> npt.NDArray[np.float64]:
        """Return strings of another table, (n, l), as those of this one, (n, k).

        A variable that the other table lacks is nan.
        """
        if other == self:
            return strings
        found = np.full((len(strings), self.count), np.nan)
        for place, name in enumerate(self.names):
            if name in other:
                found[:, place] = strings[:, other.index(name)]
        return found


TEN: Final = VariableTable()
"""The table of a campaign that names only the variables of the papers."""


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
