"""Test a law of a scene: all properties of its kind, at random points."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final

from agglom_mpi.contracts.formula_properties import compiled_alike
from agglom_mpi.contracts.grains import COOLING_KIND, FRAGMENTATION_KIND
from agglom_mpi.contracts.impacts import (
    DURATION_KIND,
    FRICTION_KIND,
    HEATING_KIND,
    REACTION_KIND,
    RESTITUTION_KIND,
)
from agglom_mpi.contracts.kinds import (
    COMPILED,
    FINITE,
    FRAME,
    SYMMETRY,
    UNITS,
    LawKind,
    LawProperty,
    general_properties,
)
from agglom_mpi.contracts.materials import HARDNESS_KIND, ROOT_PROPERTY
from agglom_mpi.contracts.points import Point, Violation, draw_points, simplest
from agglom_mpi.contracts.property_findings import PropertyFinding, Verdict, component_label
from agglom_mpi.contracts.starts import VELOCITIES_KIND
from agglom_mpi.contracts.subject import Subject
from agglom_mpi.declaration.laws import Law
from agglom_mpi.declaration.own_modules import line_in
from agglom_mpi.physics.contact import Duration
from agglom_mpi.physics.cooling import Cooling
from agglom_mpi.physics.fragmentation import Fragmentation
from agglom_mpi.physics.friction import Friction
from agglom_mpi.physics.hardness import Hardness
from agglom_mpi.physics.heating import Heating
from agglom_mpi.physics.reaction import Reaction
from agglom_mpi.physics.restitution import Restitution, Solver
from agglom_mpi.physics.velocities import Velocities

LAW_KINDS: Final[Mapping[type[Law], LawKind]] = {
    Restitution: RESTITUTION_KIND,
    Duration: DURATION_KIND,
    Hardness: HARDNESS_KIND,
    Friction: FRICTION_KIND,
    Heating: HEATING_KIND,
    Reaction: REACTION_KIND,
    Fragmentation: FRAGMENTATION_KIND,
    Cooling: COOLING_KIND,
    Solver: LawKind((), ()),
    Velocities: VELOCITIES_KIND,
}
"""Formulas and properties of each kind of law."""

IN_EQUATION: Final = (Restitution, Duration, Hardness, Friction, Heating, Reaction, Solver)
"""Kinds of laws that the impact equation is made of."""

INHERITED: Final = (SYMMETRY, FRAME, UNITS, ROOT_PROPERTY.name)
"""Properties that a formula may lack because a law that it calls lacks them."""

CALLERS: Final = (Restitution, Heating)
"""Kinds of laws whose formulas are given other laws."""

COMPARED_POINTS: Final = 200
"""Number of points at which compiled formulas are compared with plain Python."""

POINTS_SEED: Final = 20_260_101
"""Seed of the random points, the same in every test."""


def law_kind_of(law: Law) -> LawKind | None:
    """Return formulas and properties of the kind of a law; None if the kind is not tested."""
    return next((LAW_KINDS[each] for each in type(law).__mro__ if each in LAW_KINDS), None)


def properties_of(subject: Subject) -> list[LawProperty]:
    """Return all properties that a law promises, those of every formula first.

    A property that another law of the scene breaks is left out where the formulas call that law:
    the restitution by the pressure depends on the frame where the heat does.
    """
    kind, law = law_kind_of(subject.tested), subject.tested
    if kind is None:
        return []
    general = [each for formula in kind.formulas for each in general_properties(formula)]
    general.sort(key=lambda each: each.name != FINITE)
    root = [ROOT_PROPERTY] if isinstance(law, IN_EQUATION) and subject.solves_equation else []
    broken = {name for each in subject.laws.values() if each is not law for name in each.breaks}
    spoilt = broken.intersection(INHERITED if isinstance(law, CALLERS) else (ROOT_PROPERTY.name,))
    return [each for each in (*general, *kind.properties, *root) if each.name not in spoilt]


def law_findings(subject: Subject) -> list[PropertyFinding]:
    """Test all properties of a law; of several that fail alike the first one counts.

    Where results are not finite, nothing else is tested.
    """
    found: dict[str, PropertyFinding] = {}
    for promised in (*properties_of(subject), *_compiled_properties(subject)):
        if promised.name in found and found[promised.name].verdict is not Verdict.HOLDS:
            continue
        if FINITE in found and found[FINITE].verdict is Verdict.FAILS and promised.name != FINITE:
            break
        found[promised.name] = _tested(subject, promised)
    return list(found.values())


def _compiled_properties(subject: Subject) -> Iterator[LawProperty]:
    """Yield the property that a formula gives the same compiled and in plain Python, of each."""
    kind, plain = law_kind_of(subject.tested), subject.in_plain_python()
    for formula in () if kind is None else kind.formulas:
        if subject.is_compiled(formula.name):
            alike = partial(compiled_alike, plain, formula)
            yield LawProperty(COMPILED, alike, formula.domain, COMPARED_POINTS)


def _tested(subject: Subject, promised: LawProperty) -> PropertyFinding:
    """Test one property of a law at random points; the first failure ends it."""
    law, name = type(subject.tested), promised.name
    domain = {**subject.domain, **promised.domain}
    violation = _guarded(subject, promised.violation)
    for point in draw_points(domain, (POINTS_SEED, *name.encode()), promised.points):
        first = violation(point)
        if first is None:
            continue
        text, numbers = simplest(point, domain, violation)
        text = text or f"{first}, and at other calls with the same numbers not"
        if name in law.breaks:
            return PropertyFinding(
                component_label(law), name, Verdict.BREAKS, law.breaks[name], numbers
            )
        return PropertyFinding(component_label(law), name, Verdict.FAILS, text, numbers)
    return PropertyFinding(component_label(law), name, Verdict.HOLDS)


def _guarded(
    subject: Subject, violation: Callable[[Subject, Point], Violation]
) -> Callable[[Point], Violation]:
    """Return a test that takes an exception of the law for a violation.

    Some properties are tested in plain Python alone, where a division by 0 raises; of a law that
    is compiled it does not, and `finite` tests its result.
    """

    def guarded(point: Point) -> Violation:
        try:
            return violation(subject, point)
        except (ArithmeticError, ValueError) as error:
            return None if subject.has_compiled else f"raises {type(error).__name__}: {error}"
        except Exception as error:  # a law of the user's may raise any
            own = subject.tested.own
            place = "" if own is None else f"{line_in(own.file, error)} "
            return f"{place}raises {type(error).__name__}: {error}"

    return guarded


def unknown_breaks(law: type[Any], known: set[str]) -> Iterator[PropertyFinding]:
    """Yield the names in `breaks` of a class that are no properties of its kind."""
    for name in law.breaks:
        if name not in known:
            allowed = ", ".join(sorted(known))
            text = f"breaks {name!r}, which is no property of its kind; allowed: {allowed}"
            yield PropertyFinding(component_label(law), "breaks", Verdict.FAILS, text)
