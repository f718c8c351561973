"""Test a law of a scene: all properties of its kind, at random points."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final

from agglom_mpi.contracts.findings import Finding, State, label_of
from agglom_mpi.contracts.grains import COOLING, FRAGMENTATION
from agglom_mpi.contracts.impacts import DURATION, FRICTION, HEATING, REACTION, RESTITUTION
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
from agglom_mpi.contracts.materials import HARDNESS, ROOT
from agglom_mpi.contracts.points import Point, Violation, draw_points, simplest
from agglom_mpi.contracts.quantities import compiled_alike
from agglom_mpi.contracts.starts import VELOCITIES
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

KINDS: Final[Mapping[type[Law], LawKind]] = {
    Restitution: RESTITUTION,
    Duration: DURATION,
    Hardness: HARDNESS,
    Friction: FRICTION,
    Heating: HEATING,
    Reaction: REACTION,
    Fragmentation: FRAGMENTATION,
    Cooling: COOLING,
    Solver: LawKind((), ()),
    Velocities: VELOCITIES,
}
"""What each kind of law promises."""

IN_EQUATION: Final = (Restitution, Duration, Hardness, Friction, Heating, Reaction, Solver)
"""Kinds of laws that the impact equation is made of."""

INHERITED: Final = (SYMMETRY, FRAME, UNITS, ROOT.name)
"""Properties that a formula may lack because a law that it calls lacks them."""

CALLERS: Final = (Restitution, Heating)
"""Kinds of laws whose formulas are given other laws."""

COMPARED: Final = 200
"""Number of points at which compiled formulas are compared with plain Python."""

SEED: Final = 20_260_101
"""Seed of the random points, the same in every test."""


def kind_of(law: Law) -> LawKind | None:
    """Return what the kind of a law promises; None of a kind that is not tested."""
    return next((KINDS[each] for each in type(law).__mro__ if each in KINDS), None)


def properties_of(subject: Subject) -> list[LawProperty]:
    """Return all properties that a law promises, those of every formula first.

    Those are left out that other laws of the scene break, and that its formulas get from them: the
    restitution by the pressure depends on the frame where the heat does.
    """
    kind, law = kind_of(subject.tested), subject.tested
    if kind is None:
        return []
    general = [each for quantity in kind.quantities for each in general_properties(quantity)]
    general.sort(key=lambda each: each.name != FINITE)
    root = [ROOT] if isinstance(law, IN_EQUATION) and subject.solves_equation else []
    broken = {name for each in subject.laws.values() if each is not law for name in each.breaks}
    spoilt = broken.intersection(INHERITED if isinstance(law, CALLERS) else (ROOT.name,))
    return [each for each in (*general, *kind.properties, *root) if each.name not in spoilt]


def law_findings(subject: Subject) -> list[Finding]:
    """Test all properties of a law; of several that fail alike the first one counts.

    Where results are not finite, nothing else is tested.
    """
    found: dict[str, Finding] = {}
    for promised in (*properties_of(subject), *_compiled_properties(subject)):
        if promised.name in found and found[promised.name].state is not State.HOLDS:
            continue
        if FINITE in found and found[FINITE].state is State.FAILS and promised.name != FINITE:
            break
        found[promised.name] = _tested(subject, promised)
    return list(found.values())


def _compiled_properties(subject: Subject) -> Iterator[LawProperty]:
    """Yield that each compiled formula gives what it gives in plain Python."""
    kind, plain = kind_of(subject.tested), subject.in_plain_python()
    for quantity in () if kind is None else kind.quantities:
        if subject.is_compiled(quantity.name):
            alike = partial(compiled_alike, plain, quantity)
            yield LawProperty(COMPILED, alike, quantity.domain, COMPARED)


def _tested(subject: Subject, promised: LawProperty) -> Finding:
    """Test one property of a law at random points; the first failure ends it."""
    law, name = type(subject.tested), promised.name
    domain = {**subject.domain, **promised.domain}
    violation = _guarded(subject, promised.violation)
    for point in draw_points(domain, (SEED, *name.encode()), promised.points):
        if violation(point) is None:
            continue
        text, numbers = simplest(point, domain, violation)
        if name in law.breaks:
            return Finding(label_of(law), name, State.BREAKS, law.breaks[name], numbers)
        return Finding(label_of(law), name, State.FAILS, text, numbers)
    return Finding(label_of(law), name, State.HOLDS)


def _guarded(
    subject: Subject, violation: Callable[[Subject, Point], Violation]
) -> Callable[[Point], Violation]:
    """Return a test that takes an exception of the law for a violation.

    Some properties are tested in plain Python alone, where a division by 0 raises; of a law that
    is compiled it does not, and `finite` tests what it gives.
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


def unknown_breaks(law: type[Any], known: set[str]) -> Iterator[Finding]:
    """Yield what a class says that it breaks, and that is no property of its kind."""
    for name in law.breaks:
        if name not in known:
            allowed = ", ".join(sorted(known))
            text = f"breaks {name!r}, which is no property of its kind; allowed: {allowed}"
            yield Finding(label_of(law), "breaks", State.FAILS, text)
