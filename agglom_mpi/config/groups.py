"""Dimensionless groups of the variables that the laws of a scene suggest.

Each law names its own. They are products of powers of the variables;
constant factors do not matter, so that lengths that all strings share are left out.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from agglom_mpi.declaration.laws import Group
from agglom_mpi.variables import NAMES

if TYPE_CHECKING:
    from agglom_mpi.config.scene import SceneSection


def groups_of(scene: "SceneSection", searched: tuple[str, ...]) -> list[Group]:
    """Return the groups of a scene in which a searched variable meets another, in SI units.

    Their powers are of the ten variables alone: a grain radius is that of the size ratio, or the
    same in all strings.
    """
    found: dict[str, Group] = {}
    for group in _named(scene):
        powers = {name: power for name, power in group.powers.items() if name in NAMES}
        radius = group.powers.get("grain_radius", 0.0)
        if radius and scene.diameter is None:
            powers["size_ratio"] = powers.get("size_ratio", 0.0) + radius
        if sum(name in searched for name in powers) > 1:
            found[group.symbol] = group._replace(powers=powers)
    return list(found.values())


def powers_of(scene: "SceneSection") -> frozenset[str]:
    """Return the variables of which a law of the scene takes a power."""
    names = {name for group in _named(scene) for name in group.powers}
    sized = "grain_radius" in names and scene.diameter is None
    return frozenset(names - {"grain_radius"} | ({"size_ratio"} if sized else set()))


def _named(scene: "SceneSection") -> Iterator[Group]:
    for each in scene.laws():
        if each.is_used:
            yield from each.law.groups
