"""Test a law of a scene: all properties of its kind, in random cases."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

from agglom_mpi.contracts import formulas, grains, impacts, starts
from agglom_mpi.contracts.cases import PropertyFinding, Violation
from agglom_mpi.contracts.formulas import LawFormula
from agglom_mpi.contracts.subject import RANDOM_CASES, Case, Subject
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

Check = Callable[[Case], Violation]
"""Returns a description of the fault in a case, None if there is none."""


class LawKind(NamedTuple):
    """Promises of a kind of law: every formula's, those of the kind alone, and how often tested."""

    formulas: tuple[LawFormula, ...] = ()
    properties: Mapping[str, Check] = {}
    cases: int = RANDOM_CASES


def _pair(case: Case) -> tuple[Any, ...]:
    return (case.pair,)


def _bounce(case: Case) -> tuple[Any, ...]:
    return case.pair, case["deficit"]


def _temperature(case: Case) -> tuple[Any, ...]:
    return (case["temperature_of_grain"],)


LAW_KINDS: Final[Mapping[type[Law], LawKind]] = {
    Restitution: LawKind(
        (LawFormula("solve_restitution", lambda c: (c.laws, c.pair), ("1", "1"), (0, 1)),),
        {"range": impacts.within_limits, "energy": impacts.makes_no_energy},
    ),
    Duration: LawKind(
        (
            LawFormula("force_scale", _pair, ("N",), (0,)),
            LawFormula("restitution_factor", lambda c: (1.0 - c["deficit"],), ("1",)),
            LawFormula("restitution_factor_slope", lambda c: (c["deficit"],), ("1",)),
        ),
        {
            "size": impacts.pressure_knows_no_size,
            "factor": impacts.factor_never_falls,
            "slope": impacts.factor_slope_is_right,
        },
    ),
    Hardness: LawKind(
        (
            LawFormula("log_hardening", _temperature, ("1",), may_be_infinite=True),
            LawFormula("softening_rate", _temperature, ("1/K",)),
        ),
        {
            "falls": impacts.hardness_falls,
            "derivative": impacts.softening_is_derivative,
            "convex": impacts.softening_never_rises,
        },
    ),
    Friction: LawKind(
        (LawFormula("tangential_impulse", _bounce, ("kg*m/s",), (0,)),),
        {"slip": impacts.never_drives_slip, "slopes": impacts.slopes_bound_impulse},
    ),
    Heating: LawKind(
        (
            LawFormula(
                "impact_heats",
                lambda case: (case.laws.friction, *_bounce(case)),
                ("J", "J"),
                (1, 0),
                scale=impacts.energy_scale,
            ),
            LawFormula("merge_heat", _pair, ("J",), (0,), scale=impacts.energy_scale),
        ),
        {
            "energy": impacts.keeps_the_books,
            "slopes": impacts.slopes_bound_heats,
            "unique": impacts.heat_rises_less_than_deficit,
        },
    ),
    Reaction: LawKind(
        (LawFormula("contact_heat", lambda case: (case["area"],), ("J",)),),
        {"linear": impacts.is_proportional_to_area},
    ),
    Fragmentation: LawKind(
        (LawFormula("breakage", grains.released, ("1", "J")),),
        {
            "pieces": grains.counts_are_whole,
            "energy": grains.takes_what_is_there,
            "frame": grains.same_pieces_in_other_frame,
        },
    ),
    Cooling: LawKind(
        (
            LawFormula("cooling_rate", lambda case: case.grain, ("K/s",)),
            LawFormula("exact_temperature", lambda case: (*case.grain, case["time"]), ("K",)),
            LawFormula("rest_temperature", lambda case: (), ("K",)),
        ),
        {
            "bounds": grains.stays_between,
            "interval": grains.two_intervals_are_one,
            "solution": grains.solves_its_equation,
        },
    ),
    Solver: LawKind(),
    Velocities: LawKind(
        properties={
            "finite": starts.velocities_are_finite,
            "variance": starts.velocities_have_their_variance,
            "bounds": starts.velocities_are_within_bounds,
            "flow": starts.flow_does_not_scale,
            "units": starts.velocities_in_other_units,
        },
        cases=12,
    ),
}
"""Formulas and properties of each kind of law."""

IN_EQUATION: Final = (Restitution, Duration, Hardness, Friction, Heating, Reaction, Solver)
"""Kinds of laws that the impact equation is made of."""

INHERITED: Final = ("symmetry", "frame", "units", "root")
"""Properties that a formula may lack because a law that it calls lacks them."""

CALLERS: Final = (Restitution, Heating)
"""Kinds of laws whose formulas are given other laws."""

OTHER_CASES: Final = 9
"""Number of other cases that are tried to find whether a number matters."""


def law_kind_of(law: Law) -> LawKind:
    """Return formulas and properties of the kind of a law; none if the kind is not tested."""
    return next((LAW_KINDS[each] for each in type(law).__mro__ if each in LAW_KINDS), LawKind())


def properties_of(subject: Subject) -> Iterator[tuple[str, Check]]:
    """Yield all properties that a law promises, those of every formula first.

    A property that another law of the scene breaks is left out where the formulas call that law:
    the restitution by the pressure depends on the frame where the heat does.
    """
    kind, law = law_kind_of(subject.tested), subject.tested
    of_pairs = [each for each in kind.formulas if each.exchanged is not None]
    compiled = [each for each in kind.formulas if each.name in subject.compiled]
    found: list[tuple[str, Check]] = [
        *(("finite", partial(formulas.results_are_finite, each)) for each in kind.formulas),
        *(("symmetry", partial(formulas.symmetric, each)) for each in of_pairs),
        *(("frame", partial(formulas.same_in_other_frame, each)) for each in of_pairs),
        *(("units", partial(formulas.same_in_other_units, each)) for each in kind.formulas),
        *kind.properties.items(),
        *(("compiled", partial(formulas.compiled_alike, each)) for each in compiled),
    ]
    if isinstance(law, IN_EQUATION) and subject.solves_equation:
        found.append(("root", impacts.root_is_the_smallest))
    broken = {name for each in subject.laws.values() if each is not law for name in each.breaks}
    spoilt = broken.intersection(INHERITED if isinstance(law, CALLERS) else ("root",))
    return ((name, check) for name, check in found if name not in spoilt)


def law_findings(subject: Subject) -> list[PropertyFinding]:
    """Test all properties of a law; of several that fail alike the first one counts.

    Where results are not finite, nothing else is tested.
    """
    found: dict[str, PropertyFinding] = {}
    for name, check in properties_of(subject):
        if name != "finite" and "finite" in found and found["finite"].fails:
            break
        if name not in found or not found[name].fault:
            fault, numbers = _first_fault(subject, check)
            found[name] = PropertyFinding(type(subject.tested), name, fault, numbers)
    return list(found.values())


def _first_fault(subject: Subject, check: Check) -> tuple[str, Mapping[str, float]]:
    """Return the fault in the first case that has one, and the numbers that matter for it."""
    for number in range(min(law_kind_of(subject.tested).cases, RANDOM_CASES)):
        case = Case(subject, number)
        if first := guarded(check, case):
            text, numbers = _simplest(check, case)
            return text or f"{first}, and at other calls with the same numbers not", numbers
    return "", {}


def _simplest(check: Check, case: Case) -> tuple[str, Mapping[str, float]]:
    """Return the fault in a case, and the numbers that matter for it.

    Each number is set to that of the first case where the fault persists, and left out if the fault
    is the same at other values.
    """
    value, names = case.subject.value, list(case.numbers)
    for name in names:
        tried = case.but(**{name: value(name, 0)})
        if guarded(check, tried) is not None:
            case = tried
    text = guarded(check, case) or ""

    def matters(name: str) -> bool:
        others = (case.but(**{name: value(name, number)}) for number in range(1, OTHER_CASES))
        return any(guarded(check, other) != text for other in others)

    return text, {name: case[name] for name in names if matters(name)}


def guarded(check: Check, case: Case) -> Violation:
    """Return the fault in a case; an exception of the law is one.

    Some properties are tested in plain Python alone, where a division by 0 raises; of a law that
    is compiled it does not, and `finite` tests its result.
    """
    try:
        return check(case)
    except Exception as error:  # a law of the user's may raise any
        if isinstance(error, ArithmeticError | ValueError) and case.subject.compiled:
            return None
        own = case.subject.tested.own
        place = "" if own is None else f"{line_in(own.file, error)} "
        return f"{place}raises {type(error).__name__}: {error}"
