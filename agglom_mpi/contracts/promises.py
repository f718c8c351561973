"""Lines of `agglom check` on a campaign's components: properties broken, properties tested."""

from typing import TYPE_CHECKING

from agglom_mpi.contracts.property_findings import component_label
from agglom_mpi.declaration.components import Component

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign


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

    return [*lines, *lines_on(tested_components(campaign, components))]


def components_of(campaign: "Campaign") -> list[Component]:
    """Return all components that a campaign uses, by name or by default."""
    section = campaign.at(campaign.parameters()).section
    laws: list[Component | None] = [each.law for each in section.laws() if each.is_used]
    plan = campaign.plan
    others = () if plan is None else (campaign.objective, plan.search, plan.ensemble)
    return [each for each in (*laws, section.sizes, *others) if each is not None]
