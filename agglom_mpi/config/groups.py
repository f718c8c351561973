"""Dimensionless groups of the variables that the laws of a scene suggest.

Each law may name its own in an attribute `groups`. They are products of powers of the variables;
constant factors do not matter, so that lengths that all strings share are left out.
"""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from agglom_mpi.variables import NAMES

if TYPE_CHECKING:
    from agglom_mpi.config.scene import SceneSection


class Group(NamedTuple):
    """A dimensionless group, but for constants.

    Attributes
    ----------
    symbol
        As it is printed: `ρv²/H`.
    meaning
    powers
        Power of each variable by name, and of the `grain_radius`.
    """

    symbol: str
    meaning: str
    powers: Mapping[str, float]


IMPACT_PRESSURE = Group(
    "ρv²/H",
    "impact pressure over hardness",
    {"density": 1.0, "relative_speed": 2.0, "hardness": -1.0},
)
SOFTENING = Group(
    "U/(Rθ)",
    "activation energy over thermal energy",
    {"activation_energy": 1.0, "temperature": -1.0},
)
HEATING = Group(
    "v²/(Cθ)",
    "kinetic energy of an impact over heat of the grains",
    {"relative_speed": 2.0, "heat_capacity": -1.0, "temperature": -1.0},
)
REACTION = Group(
    "κ/(ρbCθ)",
    "heat of reaction over heat of the grains",
    {
        "reaction_heat": 1.0,
        "density": -1.0,
        "grain_radius": -1.0,
        "heat_capacity": -1.0,
        "temperature": -1.0,
    },
)
FRAGMENTATION = Group(
    "ρv²b/γ",
    "kinetic energy of an impact over surface energy",
    {"density": 1.0, "relative_speed": 2.0, "grain_radius": 1.0, "surface_energy": -1.0},
)


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
    laws = [
        "restitution",
        "hardness",
        "friction",
        "heating",
        "reaction",
        "fragmentation",
        "cooling",
    ]
    if scene.restitution.law != "pressure":
        laws.remove("hardness")
    for name in laws:
        yield from getattr(getattr(scene, name), "groups", ())
