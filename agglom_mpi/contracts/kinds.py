"""Records of the promises of a kind of law: its formulas, and properties of the kind alone."""

from collections.abc import Callable
from typing import Final, NamedTuple

from agglom_mpi.contracts.formula_properties import (
    SHIFT_DOMAIN,
    LawFormula,
    results_are_finite,
    same_in_other_frame,
    same_in_other_units,
    symmetric,
)
from agglom_mpi.contracts.other_units import UNIT_DOMAIN
from agglom_mpi.contracts.points import Domain, Point, Violation
from agglom_mpi.contracts.subject import Subject

RANDOM_POINTS: Final = 1000
"""Number of random points at which a property that is cheap to test is tested."""


class LawProperty(NamedTuple):
    """A property that is tested at random points.

    Attributes
    ----------
    name
    violation
        Returns a description of the fault at a point, None if there is none. Its docstring states
        the property.
    domain
        Intervals of the numbers that the property needs beside those of the law and the variables.
    points
        Number of random points.
    """

    name: str
    violation: Callable[[Subject, Point], Violation]
    domain: Domain
    points: int = RANDOM_POINTS


class LawKind(NamedTuple):
    """Promises of a kind of law: every formula's, and those of the kind alone."""

    formulas: tuple[LawFormula, ...]
    properties: tuple[LawProperty, ...]


FINITE: Final = "finite"
SYMMETRY: Final = "symmetry"
FRAME: Final = "frame"
UNITS: Final = "units"
COMPILED: Final = "compiled"


def general_properties(formula: LawFormula) -> list[LawProperty]:
    """Return the properties that every formula promises; `finite`, which all need, is the first."""

    def bound(
        violation: Callable[[LawFormula, Subject, Point], Violation],
    ) -> Callable[..., Violation]:
        return lambda subject, point: violation(formula, subject, point)

    domain = formula.domain
    found = [LawProperty(FINITE, bound(results_are_finite), domain)]
    if formula.exchanged is not None:
        found.append(LawProperty(SYMMETRY, bound(symmetric), domain))
        found.append(LawProperty(FRAME, bound(same_in_other_frame), {**domain, **SHIFT_DOMAIN}))
    found.append(LawProperty(UNITS, bound(same_in_other_units), {**domain, **UNIT_DOMAIN}))
    return found
