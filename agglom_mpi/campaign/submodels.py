"""The submodels of a scene by name: what each law computes and where it is published."""

from typing import Final

from agglom_mpi.campaign.parts import Part
from agglom_mpi.campaign.scene import SceneModel

MEANING: Final = {
    ("escape", "periodic"): "true periodic box, contacts across faces",
    ("escape", "reentry"): "re-entry at the opposite face, no contacts across faces, as published",
    ("velocities", "uniform_x"): "x alone, uniform from 0 to v0 [A]",
    ("velocities", "spread"): "a mean plus a uniform spread in x, y, z [B]",
    ("restitution", "pressure"): "by contact pressure over hardness [A 6] [B 3.1, 4.13]",
    ("restitution", "constant"): "the same in every impact",
    ("duration", "mean_speed"): "length over the mean speed [A 12]",
    ("duration", "compression_recovery"): "compression, then recovery [B 4.10]",
    ("contact_area", ""): "grows as restitution falls [A 11] [B 4.12]",
    ("hardness", "arrhenius"): "falls with temperature, H0 exp(U/(R theta))",
    ("hardness", "constant"): "H0 at every temperature",
    ("friction", "restitution_scaled"): "mu0 (1 - e), capped where slip ends [A 7]",
    ("friction", "constant"): "mu0, capped where slip ends [B]",
    ("heating", "pair_split"): "half the energy the pair lost to each [A 14-17]",
    ("heating", "own_energy"): "each its own energy change, as published [B 6.5-6.10]",
    ("reaction", "contact_area"): "heat per contact area [A 14-17] [B 6.5-6.10]",
    ("fragmentation", "pair_energy"): "by the energy the pair lost [B 5.1-5.5]",
    ("fragmentation", "own_energy"): "by its own energy change, as published [B 5.1-5.5]",
    ("cooling", "radiation"): "radiation and convection [B 6.19-6.21]",
    ("cooling", "quartic"): "(theta - theta0)^4, bounded at theta0 [A 18-19]",
    ("solver", "root"): "e = G(e) by a bracketed root finder",
    ("solver", "iteration"): "the published fixed point, which cycles for most impacts [A 20]",
}
"""One sentence for each law of each submodel."""

CONTACT_TIME: Final = "the same, but elastic within contact_time (s) of either's last impact"
"""The sentence for constant restitution with a contact time."""


def submodels(scene: SceneModel) -> tuple[list[str], list[str]]:
    """Lines on the submodels that the scene uses, and the names of those it leaves out."""
    used, left_out = [], []
    idle = _idle(scene)
    for key in dict.fromkeys(key for key, _ in MEANING):
        part = getattr(scene, key)
        law = part if isinstance(part, str) else getattr(part, "law", "")
        if law == "none" or key in idle:
            left_out.append(key)
        else:
            name = f"{key}: {law}" if law else key
            meaning = CONTACT_TIME if getattr(part, "contact_time", 0.0) else MEANING[key, law]
            used.append(f"{name:<32}{meaning}{_settings(part)}")
    return used, left_out


def missing_arrays(scene: SceneModel) -> list[str]:
    """Name what need not be known of each particle; `simulation.allocation` does the same."""
    kept = {
        "temperature": scene.heating.law != "none",
        "time of last cooling": getattr(scene.cooling, "integration", "euler") == "exact",
        "time of last impact": getattr(scene.restitution, "contact_time", 0.0) > 0.0,
        "number of grains": scene.fragmentation.law != "none",
    }
    return [name for name, used in kept.items() if not used]


def _idle(scene: SceneModel) -> set[str]:
    """Submodels that have a law, but that nothing in the scene asks."""
    if scene.restitution.law == "pressure":
        return set()
    return {"duration", "hardness", "solver"} | (
        {"contact_area"} if scene.reaction.law == "none" else set()
    )


def _settings(part: Part | str) -> str:
    if isinstance(part, str):
        return ""
    pairs = [
        f"{key} {_plain(value)}"
        for key, value in part
        if key != "law" and (key, value) != ("contact_time", 0.0)
    ]
    return f"; {', '.join(pairs)}" if pairs else ""


def _plain(value: object) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_plain, value))})"
    return f"{value:g}" if isinstance(value, float) else str(value)
