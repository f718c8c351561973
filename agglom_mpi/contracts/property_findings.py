"""Findings on the properties of a component, one line each."""

from collections.abc import Mapping
from typing import Any, NamedTuple


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
