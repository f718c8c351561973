"""Lines of `agglom check` on a campaign's components: properties broken, findings of tests."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from agglom_mpi.declaration.components import Component
from agglom_mpi.physics import scales
from agglom_mpi.physics.restitution import solve_restitution

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

SPEED_RATIOS: Final = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Approach speeds over the mean one at which e is displayed."""


class PropertyFinding(NamedTuple):
    """A property of a component that was tested.

    Attributes
    ----------
    component
        The class of the component.
    name
        Name of the property.
    fault
        Description of the fault; empty if the property holds.
    numbers
        The numbers at which it fails.
    """

    component: type[Any]
    name: str
    fault: str = ""
    numbers: Mapping[str, float] = {}

    @property
    def fails(self) -> bool:
        """Whether the property does not hold, and the class does not name it in `breaks`."""
        return bool(self.fault) and self.name not in self.component.breaks

    def __str__(self) -> str:
        at = ", ".join(f"{name}={value:.12g}" for name, value in self.numbers.items())
        line = f"{component_label(self.component)}: {self.name}: {self.fault}"
        return f"{line}; at {at}" if at else line


def component_label(component: type[Any]) -> str:
    """Return the name of a component in a line: `FILE.py:Class`, or `heating own_energy`."""
    module, name = component.__module__.rpartition(".")[2], next(iter(component.names()), "")
    if not name:
        return f"{module}.{component.__qualname__}"
    return name if component.own is not None else f"{module} {name}"


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
