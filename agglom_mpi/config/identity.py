"""The identity of a campaign: all that decides its results, to be compared and hashed."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.declaration.given_values import SIZES

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

SEPARATORS: Final = (",", ":")
STUDY_SEPARATORS: Final = (", ", ": ")
"""Separators of entries, and of names from values, where an identity is hashed."""


def identity(campaign: "Campaign") -> dict[str, object]:
    """Return a flat mapping such as `scene.particles` -> 100, with all values in SI units.

    Title, output, final answer, number of generations and failures allowed are left out: a campaign
    that differs in these continues the same file.
    """
    sections: dict[str, object] = {"seed": campaign.seed, "objective": objective(campaign)}
    if campaign.relations.constraints:
        sections["constraints"] = sorted(campaign.relations.canonical())
    if campaign.plan is not None:
        plan = campaign.plan
        sections |= {"search": plan.search.entries(), "ensemble": plan.ensemble.entries()}
        sections["stopping"] = plan.stopping.recorded_criteria()
    found = dict(_flat(sections)) | _of_scene(campaign, with_data=not campaign.experiments)
    for experiment in campaign.experiments:
        start = f"experiments.{experiment.name}"
        found |= {f"{start}.{k}": v for k, v in _of_scene(experiment.campaign).items()}
    return found | dict(_flat({"experiment_names": [each.name for each in campaign.experiments]}))


def _of_scene(campaign: "Campaign", with_data: bool = True) -> dict[str, object]:
    variables = campaign.variables
    sections: dict[str, object] = {
        "scene": campaign.scene.entries(),
        "variables": {
            v.name: (v.lower, v.upper, v.scale) if v.scale else (v.lower, v.upper)
            for v in variables.variables
            if v.is_used
        },
    }
    if campaign.data_entries and with_data:
        sections["data"] = [entry.entries() for entry in campaign.data_entries]
    given = set(variables.of_scene)  # they stand among the variables
    # The identity has the diameter or the half-width in place of any of these.
    given |= {*SIZES} if given.intersection(SIZES) else set()
    left_out = {f"scene.{name}" for name in given}
    return {name: value for name, value in _flat(sections) if name not in left_out}


def objective(campaign: "Campaign") -> dict[str, object]:
    """Return the entries of the objective, with the digest of a user's function."""
    entries: dict[str, object] = campaign.objective.entries()
    if campaign.objective.code is not None:
        if campaign.user_function is None:
            raise campaign.function_error("is a function whose source was not read")
        entries |= campaign.user_function.module.entries()
    return entries


def digest(entries: Mapping[str, object], separators: tuple[str, str] = SEPARATORS) -> str:
    """Return the SHA-256 of an identity as 64 hexadecimal digits.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    # JSON writes a float as the shortest text that reads back as the same float64.
    text = json.dumps(entries, sort_keys=True, separators=separators, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, object]]:
    match value:
        case {} if not value and path:  # a given string that is the middle of the box
            yield path, "nothing"
        case dict():
            for key, inner in value.items():
                yield from _flat(inner, f"{path}.{key}" if path else str(key))
        case list() | tuple():
            for i, inner in enumerate(value):
                yield from _flat(inner, f"{path}.{i}")
        case float():
            yield path, value + 0.0  # -0.0 is 0.0
        case _:
            yield path, value
