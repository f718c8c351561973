"""Dimensionless groups of the variables that the laws of a scene suggest.

Each law names its own. They are products of powers of the variables;
constant factors do not matter, so that lengths that all strings share are left out.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from agglom_mpi.declaration.laws import Group
from agglom_mpi.variables import TEN, VOLUME_FRACTION, VariableTable

if TYPE_CHECKING:
    from agglom_mpi.config.scene import SceneSection


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


def powers_of(scene: "SceneSection", table: VariableTable = TEN) -> frozenset[str]:
    """Return the variables that a law of the scene raises to a power."""
    return frozenset(
        name for key, group in _named(scene) for name in _of_variables(key, group, scene, table)
    )


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
