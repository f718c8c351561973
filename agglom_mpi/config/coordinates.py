"""Coordinates in which a campaign's strings are emulated: variables, and dimensionless groups."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.components import unit_of
from agglom_mpi.declaration.laws import Group, Law
from agglom_mpi.variables import TEN, VOLUME_FRACTION, VariableTable

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.config.scene import SceneSection

Floats = NDArray[np.float64]

SMALL: Final = 0.05
"""Offset of a variable whose range begins at 0, relative to its upper end, before a group takes
its logarithm."""


class Coordinates:
    """Maps strings to the coordinates in which they are emulated, each from 0 to 1 over the box.

    There is one for each variable that is `kept` and one for each dimensionless group. Those of
    groups are logarithms, and so are those of variables that a law raises to a power or that are
    searched by their logarithm, unless their range begins at 0. Others are linear, such as
    friction: strings are most sensitive to it where it is large.

    Parameters
    ----------
    lower, upper
        The box in SI units, shape (k,).
    groups
        The groups.
    powers
        Names of the variables that a law raises to a power.
    logarithmic
        Which variables are searched by their logarithm, shape (k,).
    table
        The variables.
    covered
        Names of searched variables that matter through groups alone, and are no coordinates.

    Attributes
    ----------
    searched
        Places of the d searched variables in a string, shape (d,).
    names
        Names of the searched variables.
    kept
        Which of the searched variables are coordinates themselves, shape (d,).
    groups
    """

    def __init__(
        self,
        lower: Floats,
        upper: Floats,
        groups: list[Group],
        powers: frozenset[str] = frozenset(),
        logarithmic: NDArray[np.bool_] | None = None,
        table: VariableTable = TEN,
        covered: frozenset[str] = frozenset(),
    ) -> None:
        self.searched = np.flatnonzero(lower < upper)
        self.names = tuple(table.names[i] for i in self.searched)
        self.kept = np.array([name not in covered for name in self.names], np.bool_)
        self._table = table
        self.groups = groups
        self._lower, self._upper = lower, upper
        by_power = np.array([name in powers for name in table.names])
        wanted = by_power if logarithmic is None else by_power | logarithmic
        self._positive = lower[self.searched] > 0.0
        self._logarithmic = self._positive & wanted[self.searched]
        self._first, self._last = (self._scaled(ends[None])[0] for ends in (lower, upper))
        self._powers = np.zeros((len(groups), table.count))
        for row, group in zip(self._powers, groups, strict=True):
            row[[table.index(name) for name in group.powers]] = list(group.powers.values())
        self._powers[:, ~(lower < upper)] = 0.0
        ends = np.array([self._logarithms(lower[None])[0], self._logarithms(upper[None])[0]])
        corners = self._powers[:, None, :] * ends
        self._least, self._most = corners.min(axis=1).sum(axis=1), corners.max(axis=1).sum(axis=1)

    @property
    def dimensions(self) -> int:
        """Number of coordinates, p."""
        return int(self.kept.sum()) + len(self.groups)

    @property
    def spans(self) -> Floats:
        """Change of the logarithm of each searched variable along its coordinate, (d,).

        For a linear coordinate it is the change in the middle of its range.
        """
        lower, upper = self._lower[self.searched], self._upper[self.searched]
        linear = 2.0 * (upper - lower) / (upper + lower)
        ratio = upper / np.where(self._logarithmic, lower, upper)
        return np.where(self._logarithmic, np.log(ratio), linear)

    @property
    def group_directions(self) -> Floats:
        """Change of the logarithm of each group along each variable's coordinate, (g, d)."""
        return np.asarray(self._powers[:, self.searched] * self.spans)

    def of_strings(self, strings: Floats) -> Floats:
        """Return the coordinates of strings, (n, k) in SI units, shape (n, p)."""
        own = self.own(strings)[:, self.kept]
        if not self.groups:
            return own
        values = self._logarithms(strings) @ self._powers.T
        return np.column_stack((own, (values - self._least) / (self._most - self._least)))

    def own(self, strings: Floats) -> Floats:
        """Return the coordinates of the searched variables alone, of strings (n, k): (n, d)."""
        return np.asarray((self._scaled(strings) - self._first) / (self._last - self._first))

    def strings(self, own: Floats) -> Floats:
        """Return the strings, (n, k), of coordinates of the searched variables, (n, d)."""
        scaled = self._first + own * (self._last - self._first)
        strings = np.tile(self._lower, (len(own), 1))
        exponents = np.where(self._logarithmic, scaled, 0.0)
        strings[:, self.searched] = np.where(self._logarithmic, np.exp(exponents), scaled)
        return strings

    def group_values(self, strings: Floats, group: Group) -> Floats:
        """Return a group of strings, (n, k), in SI units but for constants, shape (n,)."""
        factors = [
            strings[:, self._table.index(name)] ** power for name, power in group.powers.items()
        ]
        return np.asarray(np.prod(factors, axis=0))

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return what `of_strings` rests on as plain arrays, of the d searched variables alone.

        Coordinates of variables are (y − `first`)/`widths`, where y is the value, or its logarithm
        where `logarithmic`; those of groups, (g,), are (log(x + `offsets`) · `powers` − `least`)/
        `spans`, with powers of shape (d, g).
        """
        chosen, upper = self._powers[:, self.searched].T, self._upper[self.searched]
        offsets = np.where(self._positive, 0.0, SMALL * upper)
        # A variable of no group may be negative: any offset does that gives it a logarithm.
        offsets = np.where(chosen.any(axis=1), offsets, 1.0 - self._lower[self.searched])
        return {
            "logarithmic": self._logarithmic,
            "first": self._first,
            "widths": self._last - self._first,
            "offsets": offsets,
            "powers": chosen,
            "least": self._least,
            "spans": self._most - self._least,
        }

    def _scaled(self, strings: Floats) -> Floats:
        chosen = strings[:, self.searched]
        positive = np.where(self._logarithmic, chosen, 1.0)
        return np.where(self._logarithmic, np.log(positive), chosen)

    def _logarithms(self, strings: Floats) -> Floats:
        """Return logarithms of all variables, 0 for those that are not searched, (n, k)."""
        found = np.zeros(strings.shape)
        x, top = strings[:, self.searched], self._upper[self.searched]
        found[:, self.searched] = np.log(np.where(self._positive, x, x + SMALL * top))
        return found


def coordinates_of(campaign: "Campaign", of_ratios: bool = False) -> Coordinates:
    """Return the coordinates in which a campaign's strings are emulated.

    Parameters
    ----------
    campaign
    of_ratios
        Whether what is emulated has no dimension, so that it is a function of the scene's groups:
        variables that matter through them alone are then no coordinates.
    """
    scene, box = campaign.scene, campaign.variables
    groups = groups_of(scene, box.searched, box)
    named = (_of_variables(key, group, scene, box) for key, group in _named(scene))
    powers = frozenset(name for each in named for name in each)
    covered = covered_by_groups(scene, box.searched, box) if of_ratios else frozenset()
    return Coordinates(box.lower, box.upper, groups, powers, box.logarithmic, box, covered)


def covered_by_groups(
    scene: "SceneSection", searched: tuple[str, ...], table: VariableTable = TEN
) -> frozenset[str]:
    """Return the searched variables through which a ratio depends on a scene's groups alone.

    Others are pure numbers, in no group, alone in one, or 0 in the box, where a group has no
    logarithm; or a law has a dimension that its groups do not state. Such a law keeps the variables
    that it uses, and speed and lengths, as its times compare with those of flights; all of them,
    where it names none or is one's own.
    """
    of_flights = {"relative_speed", *_radius_factors(scene, table)}
    stated = [_of_variables(key, group, scene, table) for key, group in _named(scene)]
    named = {name for _, group in _named(scene) for name in group.powers}
    found = {name for powers in stated for name in powers if name in searched}
    kept = {name for name in found if table[name].unit == "1" or table[name].lower <= 0.0}
    for powers in stated:
        here = [name for name in powers if name in searched]
        kept.update(here if len(here) == 1 else ())
    if scene.end_time != "characteristic":
        kept |= of_flights
    for each in scene.laws():
        if each.is_used and _has_other_scales(each.law, named):
            kept.update({*of_flights, *each.law.required} if each.law.required else found)
            kept.update(found if each.law.own is not None else ())
    return frozenset(found - kept)


def _has_other_scales(law: Law, named: set[str]) -> bool:
    """Return whether a law has dimensions that no group states, of all variables `named` in any."""
    own = {name for group in law.groups for name in group.powers}
    numbers = {name for name, field in type(law).model_fields.items() if unit_of(field) != "1"}
    variables = {name for name in law.variables if TEN[name].unit != "1"}
    constants = bool(law.constants) and not law.groups
    # One variable alone has nothing to be compared with.
    return constants or not numbers <= own or (len(variables) > 1 and not variables <= named)


def groups_of(
    scene: "SceneSection", searched: tuple[str, ...], table: VariableTable = TEN
) -> list[Group]:
    """Return the groups of a scene in which a searched variable meets another, in SI units.

    Their powers are of variables alone: a grain radius is that of the size ratio and the box, that
    of a variable that gives the grains' size, or the same in all strings.
    """
    found: dict[str, Group] = {}
    for key, group in _named(scene):
        powers = _of_variables(key, group, scene, table)
        if sum(name in searched for name in powers) > 1:
            found[group.symbol] = group._replace(powers=powers)
    return list(found.values())


def _of_variables(
    key: str, group: Group, scene: "SceneSection", table: VariableTable
) -> dict[str, float]:
    """Return the powers of the variables in a group of the law in a field of the scene, by name.

    The group may name numbers of its own law.
    """
    paths = {name: f"{key}.{name}" if f"{key}.{name}" in table else name for name in group.powers}
    powers = {paths[name]: p for name, p in group.powers.items() if paths[name] in table}
    if radius := group.powers.get("grain_radius", 0.0):
        for name in _radius_factors(scene, table):
            powers[name] = powers.get(name, 0.0) + radius
    if VOLUME_FRACTION.name in table and "size_ratio" in powers:
        powers[VOLUME_FRACTION.name] = powers.pop("size_ratio") / 3.0
    return powers


def _radius_factors(scene: "SceneSection", table: VariableTable) -> list[str]:
    """Return the variables that the mean radius of the grains is proportional to."""
    if scene.diameter is None:
        return ["size_ratio", *(["half_width"] if "half_width" in table else [])]
    return [name for name in ("grain_diameter", "grain_radius", "sizes.median") if name in table]


def _named(scene: "SceneSection") -> Iterator[tuple[str, Group]]:
    """Yield the groups of the laws that a scene uses, each with the field of its law."""
    for each in scene.laws():
        if each.is_used:
            for group in each.law.groups:
                yield each.key, group
