"""Which of the ten variables a scene depends on, and through which submodel."""

from collections.abc import Mapping
from typing import Final

from agglom_mpi.campaign.scene import SceneModel
from agglom_mpi.campaign.source import Path
from agglom_mpi.campaign.variables import Range
from agglom_mpi.variables import NAMES

LACKING: Final = {
    "hardness": "restitution by pressure",
    "heat_capacity": "heating",
    "friction": "friction",
    "temperature": "heating and no arrhenius hardness",
    "activation_energy": "arrhenius hardness",
    "reaction_heat": "reaction",
    "surface_energy": "fragmentation",
}
"""What a scene lacks in which nothing depends on the variable."""


def needs(scene: SceneModel) -> dict[str, str]:
    """Variables the scene depends on, in their order, each with what needs it."""
    reasons = dict.fromkeys(("relative_speed", "size_ratio", "density"), "every scene")
    if scene.restitution.law == "pressure":
        reasons["hardness"] = "restitution: pressure"
        if scene.hardness.law == "arrhenius":
            reasons["activation_energy"] = "hardness: arrhenius"
            reasons["temperature"] = "hardness: arrhenius"
    for name, submodel in (
        ("heat_capacity", "heating"),
        ("temperature", "heating"),  # cooling and reaction are refused without heating
        ("friction", "friction"),
        ("reaction_heat", "reaction"),
        ("surface_energy", "fragmentation"),
    ):
        law = getattr(scene, submodel).law
        if law != "none":
            reasons[name] = f"{submodel}: {law}"
    return {name: reasons[name] for name in NAMES if name in reasons}


def mismatches(scene: SceneModel, entries: Mapping[str, Range | None]) -> list[tuple[Path, str]]:
    """Variables that are missing, and ranges that nothing depends on."""
    needed = needs(scene)
    problems: list[tuple[Path, str]] = []
    for name in NAMES:
        entry = entries[name]
        if entry is None and name in needed:
            message = f"is missing; needed by {needed[name]}; a value or a range [lower, upper]"
            problems.append(((name,), message))
        elif entry is not None and entry.lower < entry.upper and name not in needed:
            message = (
                f"is a range, but the scene has no {LACKING[name]}; nothing depends on it; "
                "give one value or leave it out"
            )
            problems.append(((name,), message))
    return problems
