"""What decides the results of a campaign, in one canonical form that can be compared and hashed."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from agglom_mpi.campaign.plan import Plan
from agglom_mpi.variables import NAMES

if TYPE_CHECKING:
    from agglom_mpi.campaign.load import Campaign


def identity(campaign: "Campaign") -> dict[str, object]:
    """Flat mapping such as `scene.particles` -> 100, with all values in SI units.

    Title, output, the number of generations and the failures allowed are left out: a campaign
    that differs in these goes on with the same rows.
    """
    variables = campaign.variables
    ends = zip(variables.lower.tolist(), variables.upper.tolist(), strict=True)
    boxes = dict(zip(NAMES, ends, strict=True))
    sections = {
        "seed": campaign.seed,
        "scene": campaign.scene.model_dump(),
        "variables": {name: boxes[name] for name in variables.used},
        "objective": campaign.objective.model_dump(),
    }
    if campaign.plan is not None:
        sections |= _planned(campaign.plan)
    return dict(_flat(sections))


def _planned(plan: Plan) -> dict[str, object]:
    target = plan.stopping.target
    return {
        "search": plan.search.model_dump(),
        "ensemble": plan.ensemble.model_dump(),
        "stopping": {"target": target.model_dump() if target else None},
    }


def digest(entries: Mapping[str, object]) -> str:
    """SHA-256 of an identity as 64 hexadecimal digits."""
    # JSON writes a float as the shortest text that reads back as the same float64.
    text = json.dumps(entries, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, object]]:
    match value:
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
