"""What is promised by each kind of law: its quantities, and properties of the kind alone."""

from collections.abc import Callable
from typing import Final, NamedTuple

from agglom_mpi.contracts.findings import PAIRS
from agglom_mpi.contracts.points import Domain, Point, Violation
from agglom_mpi.contracts.quantities import (
    SHIFT_DOMAIN,
    Quantity,
    finite,
    same_in_other_frame,
    same_in_other_units,
    symmetric,
)
from agglom_mpi.contracts.subject import Subject
from agglom_mpi.contracts.units import UNIT_DOMAIN


class LawProperty(NamedTuple):
    """A property that is tested at random points.

    Attributes
    ----------
    name
    violation
        Returns what is wrong at a point, None if nothing is. Its docstring states the property.
    domain
        Intervals of what the property needs beside the law's numbers and the variables.
    points
        Number of random points.
    """

    name: str
    violation: Callable[[Subject, Point], Violation]
    domain: Domain
    points: int = PAIRS


class LawKind(NamedTuple):
    """What a kind of law promises."""

    quantities: tuple[Quantity, ...]
    properties: tuple[LawProperty, ...]


FINITE: Final = "finite"
SYMMETRY: Final = "symmetry"
FRAME: Final = "frame"
UNITS: Final = "units"
COMPILED: Final = "compiled"


def general_properties(quantity: Quantity) -> list[LawProperty]:
    """Return the properties that every formula promises, the one without which no other counts."""

    def bound(
        violation: Callable[[Quantity, Subject, Point], Violation],
    ) -> Callable[..., Violation]:
        return lambda subject, point: violation(quantity, subject, point)

    domain = quantity.domain
    found = [LawProperty(FINITE, bound(finite), domain)]
    if quantity.exchanged is not None:
        found.append(LawProperty(SYMMETRY, bound(symmetric), domain))
        found.append(LawProperty(FRAME, bound(same_in_other_frame), {**domain, **SHIFT_DOMAIN}))
    found.append(LawProperty(UNITS, bound(same_in_other_units), {**domain, **UNIT_DOMAIN}))
    return found
