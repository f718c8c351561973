"""The variables of a campaign: names, units, ranges, and their order in a parameter string."""

import copy
from collections.abc import Iterable, Mapping
from math import isfinite, isnan, nan, pi
from typing import Any, Final, NamedTuple, Self

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
        if isinstance(number, float) and not isfinite(number):
            return "a finite number"
        if self.above is not None and not number > self.above:
            return f"greater than {_plain(self.above)}"
        if self.at_least is not None and not number >= self.at_least:
            return f"at least {_plain(self.at_least)}"
        if self.at_most is not None and not number <= self.at_most:
            return f"at most {_plain(self.at_most)}"
        if self.below is not None and not number < self.below:
            return f"less than {_plain(self.below)}"
        return ""


def _plain(limit: float) -> str:
    return f"{limit:g}" if isinstance(limit, float) else str(limit)


class Variable(NamedTuple):
    """One component of a parameter string, with the range that a campaign gives it.

    Attributes
    ----------
    name
        Name; of a number of the scene its path, such as `restitution.value`.
    unit, symbol, meaning
        SI unit, symbol and meaning.
    limits
        Limits of a number of the scene; None for the variables of the papers.
    lower, upper
        Ends of its range in SI units, equal where it is fixed; nan without one.
    scale
        How the range is searched: `log` by its logarithm, `cubic` by its cube, or linearly.
    cubes
        Of a volume fraction that strings hold as a size ratio, the `third_moment` of the law of
        sizes; None for all others.
    column
        Its place in a string of the campaign.
    """

    name: str
    unit: str
    symbol: str
    meaning: str
    limits: Limits | None = None
    lower: float = nan
    upper: float = nan
    scale: str = ""
    cubes: float | None = None
    column: int = 0

    @property
    def place(self) -> tuple[str | int, ...]:
        """Where a number of the scene stands: fields of the scene and of laws, place in a list."""
        return place_of(self.name)

    @property
    def section(self) -> str:
        """Section of the scene that a number of the scene stands in, such as `sizes`."""
        return str(self.place[0])

    @property
    def is_used(self) -> bool:
        """Whether it has a range or a value: the scene depends on it."""
        return not isnan(self.lower)

    @property
    def is_searched(self) -> bool:
        """Whether its range has two ends."""
        return self.lower < self.upper

    @property
    def logarithmic(self) -> bool:
        """Whether it is searched by its logarithm."""
        return self.scale == LOGARITHMIC

    @property
    def cubic(self) -> bool:
        """Whether it is searched by its cube."""
        return self.scale == CUBIC

    @property
    def power(self) -> float:
        """Power of the component of a string that it is, but for a factor: 3 or 1."""
        return 1.0 if self.cubes is None else 3.0

    def values(self, strings: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return its values at strings, (n, k), shape (n,)."""
        return self.of_components(strings[:, self.column])

    def of_components(self, components: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return its values for values of the component of a string, (n,)."""
        if self.cubes is None:
            return components
        return np.array([volume_fraction(each, self.cubes) for each in components.tolist()])

    def components(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the values of the component of a string for its values, (n,)."""
        if self.cubes is None:
            return values
        return np.array([size_ratio(value, self.cubes) for value in values.tolist()])


LOGARITHMIC: Final = "log"
CUBIC: Final = "cubic"
"""Scales of a range beside the linear one."""


def place_of(path: str) -> tuple[str | int, ...]:
    """Return the keys of a path of the scene: `velocities.mean.1` -> velocities, mean, 1."""
    return tuple(int(key) if key.isdecimal() else key for key in path.split("."))


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
    scene by their paths, such as `restitution.value`. Tables with the same variables are equal,
    whatever the ranges.

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
    lower, upper
        Ends of their ranges in SI units, shape (k,): equal where a variable is fixed, nan where
        the scene does not depend on it.
    logarithmic, cubic
        Which are searched by their logarithms, or by their cubes, shape (k,).
    ignored
        Names of variables that the file fixes although the scene does not depend on them.
    by_volume_fraction
        Whether the file gives the volume fraction in place of the size ratio.
    third_moment
        Mean volume of the grains over that of their mean radius, in the campaign's own scene.
    """

    ignored: tuple[str, ...] = ()
    by_volume_fraction: bool = False
    third_moment: float = 1.0

    def __init__(self, further: Iterable[Variable] = ()) -> None:
        own = sorted(further, key=lambda variable: variable.name)
        self._set((*PAPER_VARIABLES, *own))
        self.names = tuple(variable.name for variable in self.variables)
        self._places = {name: place for place, name in enumerate(self.names)}
        if len(self._places) < len(self.names):
            raise ValueError("two variables have one name")

    def _set(self, variables: tuple[Variable, ...]) -> None:
        self.variables = tuple(each._replace(column=i) for i, each in enumerate(variables))
        self.lower, self.upper = np.array([[v.lower, v.upper] for v in variables]).T.copy()
        self.logarithmic, self.cubic = (
            np.array([variable.scale == scale for variable in variables])
            for scale in (LOGARITHMIC, CUBIC)
        )
        for array in (self.lower, self.upper, self.logarithmic, self.cubic):
            array.flags.writeable = False

    def with_ranges(
        self,
        ranges: Mapping[str, Variable],
        ignored: tuple[str, ...] = (),
        by_volume_fraction: bool = False,
        third_moment: float = 1.0,
    ) -> Self:
        """Return the table with the ranges of some variables by name; others have none."""
        found = copy.copy(self)
        kept = {name: (v.lower, v.upper, v.scale) for name, v in ranges.items()}
        found._set(
            tuple(
                variable._replace(lower=lower, upper=upper, scale=scale)
                for variable in self.variables
                for lower, upper, scale in [kept.get(variable.name, (nan, nan, ""))]
            )
        )
        found.ignored, found.by_volume_fraction = ignored, by_volume_fraction
        found.third_moment = third_moment
        return found

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

    @property
    def used(self) -> tuple[str, ...]:
        """Names of variables that the scene depends on."""
        return tuple(v.name for v in self.variables if v.is_used)

    @property
    def searched(self) -> tuple[str, ...]:
        """Names of the variables that are ranges."""
        return tuple(variable.name for variable in self.variables if variable.is_searched)

    @property
    def fixed(self) -> dict[str, float]:
        """Values of the used variables that are not searched, in SI units."""
        return {v.name: v.lower for v in self.variables if v.lower == v.upper}

    @property
    def of_scene(self) -> tuple[str, ...]:
        """Names of the variables that are numbers of the scene."""
        return tuple(v.name for v in self.further if v.limits is not None)

    @property
    def own(self) -> tuple[Variable, ...]:
        """The searched variables by the names and with the ranges of the file.

        A volume fraction stands in place of the size ratio that strings hold.
        """
        return tuple(self.as_named(v) for v in self.variables if v.is_searched)

    def as_named(self, variable: Variable) -> Variable:
        """Return a variable of the table by the name and with the range of the file."""
        if variable.name != "size_ratio" or not self.by_volume_fraction:
            return variable
        scale = "" if variable.cubic else variable.scale
        own = VOLUME_FRACTION._replace(scale=scale, cubes=self.third_moment, column=variable.column)
        lower, upper = own.of_components(np.array([variable.lower, variable.upper])).tolist()
        return own._replace(lower=lower, upper=upper)

    def at(self, share: float) -> npt.NDArray[np.float64]:
        """Return the string that is this share of the way from lower to upper ends, (k,)."""
        string = (1.0 - share) * self.lower + share * self.upper
        cubes = (1.0 - share) * self.lower**3 + share * self.upper**3
        string[self.cubic] = np.cbrt(cubes[self.cubic])
        return np.asarray(string)

    def stream_key(self, string: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the numbers of a string, (k,), that its random numbers depend on.

        Numbers of the scene that are not searched are left out, so that samples are the same
        whether they stand in the scene or here.
        """
        kept = [v.limits is None or v.is_searched for v in self.variables]
        return string if all(kept) else string[kept]

    def fraction(self, size_ratio: float) -> float:
        """Return the share of the box that the grains fill at the start, by their size ratio."""
        return volume_fraction(size_ratio, self.third_moment)

    def used_values(self, string: npt.NDArray[np.float64]) -> dict[str, float]:
        """Return the variables of a string, (k,), that the scene uses, by name in SI units."""
        values = self.values_by_name(string)
        return {name: value for name, value in values.items() if not isnan(value)}

    def used_columns(self, strings: npt.NDArray[np.float64]) -> dict[str, npt.NDArray[np.float64]]:
        """Return the used variables of strings, (n, k), by the names of the file, each (n,)."""
        named = (self.as_named(variable) for variable in self.variables if variable.is_used)
        return {variable.name: variable.values(strings).copy() for variable in named}

    def has_numbers_of(self, section: str) -> bool:
        """Return whether a number of a section of the scene, such as `sizes`, is a variable."""
        return any(variable.section == section for variable in self.further)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __getitem__(self, name: str) -> Variable:
        return self.variables[self._places[name]]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, VariableTable) and self._declared == other._declared

    def __hash__(self) -> int:
        return hash(self._declared)

    @property
    def _declared(self) -> tuple[tuple[Any, ...], ...]:
        """The variables without their ranges."""
        return tuple(variable[:5] for variable in self.variables)

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
