"""Findings on the properties of a component, one line each."""

from collections.abc import Mapping
from enum import Enum
from typing import Any, NamedTuple

from agglom_mpi.contracts.points import spelled


class Verdict(Enum):
    """Whether a property holds."""

    HOLDS = "holds"
    BREAKS = "breaks"
    """It does not, and the class names it in `breaks`."""
    FAILS = "fails"


class PropertyFinding(NamedTuple):
    """A property of a component that was tested.

    Attributes
    ----------
    component
        File and class, `sticking.py:JKR`.
    property
        Name of the property.
    verdict
        Whether it holds.
    text
        Description of the fault, or the reason why the class means to break it.
    numbers
        The numbers at which it fails.
    """

    component: str
    property: str
    verdict: Verdict
    text: str = ""
    numbers: Mapping[str, float] = {}

    def __str__(self) -> str:
        at = f"; at {spelled(self.numbers)}" if self.numbers else ""
        return f"{self.component}: {self.property}: {self.text}{at}"


def component_label(component: type[Any]) -> str:
    """Return the name of a component in a line: `FILE.py:Class`, or `heating own_energy`."""
    module, name = component.__module__.rpartition(".")[2], next(iter(component.names()), "")
    if not name:
        return f"{module}.{component.__qualname__}"
    return name if component.own is not None else f"{module} {name}"
