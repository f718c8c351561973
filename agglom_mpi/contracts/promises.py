"""Lines of `agglom check` on a campaign's components: properties broken, properties tested."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from agglom_mpi.contracts.cases import component_label
from agglom_mpi.declaration.components import Component
from agglom_mpi.physics import scales
from agglom_mpi.physics.restitution import solve_restitution

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

SPEED_RATIOS: Final = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Approach speeds over the mean one at which e is displayed."""


def promises_of(campaign: "Campaign", allow_code: bool) -> list[str]:
    """Return a line on each property that a component means to break, and on each that was tested.

    Parameters
    ----------
    campaign
        The campaign.
    allow_code
        Whether components of one's own are tested; those of the package pass their tests.

    Raises
    ------
    BrokenComponentError
        If a component of one's own lacks properties of its kind; with a line on each.
    UncompiledLawError
        If a formula of one cannot be compiled.
    """
    components = components_of(campaign)
    lines = [
        f"{component_label(type(each))} means to break {name}: {why}"
        for each in components
        for name, why in type(each).breaks.items()
    ]
    if not (allow_code and any(each.own is not None for each in components)):
        return lines
    # Imported here: it loads the compiler.
    from agglom_mpi.contracts.tested_components import lines_on, tested_components

    return [*lines, *lines_on(tested_components(campaign, components)), *_rebound(campaign)]


def _rebound(campaign: "Campaign") -> Iterator[str]:
    """Yield a line on e over speed of a restitution of one's own: 1 − e passes all properties."""
    section, values = campaign.at(campaign.parameters())
    law, mean = section.restitution, scales.mean_approach(section, values)
    own = [each for _, each in law.with_inner_laws("") if each.own is not None]
    if not own:
        return
    numbers, laws, found = law.build(values), section.impact_laws(values), []
    for ratio in SPEED_RATIOS:
        pair = scales.mean_pair(section, values, ratio * mean)
        try:
            solution = solve_restitution(numbers, laws, pair)
        except (ArithmeticError, ValueError):  # what it means to break
            found.append(f"no number at {pair.approach_speed:.3g}")
            continue
        rebound = "sticks" if solution.bonds else f"{1.0 - solution.deficit:.3g}"
        found.append(f"{rebound} at {pair.approach_speed:.3g}")
    yield f"{component_label(type(own[0]))}: e of the mean pair: {', '.join(found)} m/s"


def components_of(campaign: "Campaign") -> list[Component]:
    """Return all components that a campaign uses, by name or by default."""
    section = campaign.at(campaign.parameters()).section
    laws: list[Component | None] = [each.law for each in section.laws() if each.is_used]
    plan = campaign.plan
    others = () if plan is None else (campaign.objective, plan.search, plan.ensemble)
    return [each for each in (*laws, section.sizes, *others) if each is not None]
