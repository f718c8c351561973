"""Test a law of a scene: properties of any formula, and those of its kind, in random cases.

The results of a formula in a case are compared with those in an equivalent one: both grains
exchanged, one velocity added to all, all numbers in other units. They may differ by rounding: by
`RESULT_ROUNDING` of themselves, or by the effect of a change of every number by `JITTER`, which is
far above rounding (1.1e-16 each) and far below any real difference.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.contracts import grains, impacts
from agglom_mpi.contracts.cases import RESULT_ROUNDING, PropertyFinding, Violation, factor
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

JITTER: Final = 1e-11
"""Relative change of every number, to estimate how far rounding reaches."""
SLACK: Final = 1e-12
"""Rounding relative to the terms that a result is the difference of."""
JITTERS: Final = 4
"""Number of such changes."""


class LawFormula(NamedTuple):
    """A formula of a law, and how its results are tested.

    Attributes
    ----------
    name
        Name of the formula.
    arguments
        Returns the formula's arguments, without the law's numbers.
    units
        SI unit of each result that is tested, the first ones.
    exchanged
        Order of the results when both grains are exchanged; None: it is not of a pair.
    may_be_infinite
        Whether +inf is allowed.
    scale
        Returns the size of the terms that the results are differences of.
    """

    name: str
    arguments: Callable[[Case], tuple[Any, ...]]
    units: tuple[str, ...]
    exchanged: tuple[int, ...] | None = None
    may_be_infinite: bool = False
    scale: Callable[[Case], float] = lambda case: 0.0

    def at(self, case: Case) -> tuple[float, ...]:
        """Return the results in a case."""
        found = case.call(self.name, *self.arguments(case))
        found = found if isinstance(found, tuple) else (found,)
        return tuple(map(float, found[: len(self.units)]))


def difference(
    formula: LawFormula, case: Case, results: tuple[float, ...], others: tuple[float, ...], how: str
) -> Violation:
    """Return the first result that another differs from by more than rounding, in words."""

    def alike(value: float, other: float, margin: float = 0.0) -> bool:
        return value == other or abs(value - other) <= max(margin, RESULT_ROUNDING * abs(value))

    if all(map(alike, results, others)):
        return None
    random, reach = np.random.default_rng(1), [SLACK * formula.scale(case)] * len(results)
    for _ in range(JITTERS):
        numbers, signs = case.numbers, random.choice((-1.0, 1.0), len(case.numbers))
        moved = zip(numbers.items(), (1.0 + JITTER * signs).tolist(), strict=True)
        near = formula.at(case.but(**{name: value * by for (name, value), by in moved}))
        for place, (value, other) in enumerate(zip(results, near, strict=True)):
            away = abs(value - other)
            reach[place] = max(reach[place], 2.0 * away) if math.isfinite(away) else math.inf
    for value, other, far in zip(results, others, reach, strict=True):
        if not alike(value, other, far):
            return f"{formula.name} is {value:.9g}, and then {other:.9g} {how}"
    return None


def results_are_finite(formula: LawFormula, case: Case) -> Violation:
    """Check that results are finite."""
    try:
        results = formula.at(case)
    except (ArithmeticError, ValueError) as error:
        return f"{formula.name} raises {type(error).__name__}: {error}"
    for value in results:
        if not (math.isfinite(value) or (formula.may_be_infinite and value == math.inf)):
            return f"{formula.name} is {value}"
    return None


def symmetric(formula: LawFormula, case: Case) -> Violation:
    """Check that results of a pair do not depend on which of the grains is i."""
    swapped = {
        f"{name}_{one}": case[f"{name}_{other}"]
        for name in ("radius", "temperature")
        for one, other in ("ij", "ji")
    }
    normal = -(case["normal_j"] + case["approach_speed"])  # the directions n and t are reversed
    tangent = -(case["tangent_j"] + case["slip_speed"])
    others = formula.at(case.but(**swapped, normal_j=normal, tangent_j=tangent))
    ordered = tuple(others[place] for place in formula.exchanged or ())
    return difference(formula, case, formula.at(case), ordered, "with i and j exchanged")


def same_in_other_frame(formula: LawFormula, case: Case) -> Violation:
    """Check that results do not change when the same velocity is added to both grains."""
    normal = case["normal_j"] + case["frame_along_n"]
    tangent = case["tangent_j"] + case["frame_along_t"]
    others = formula.at(case.but(normal_j=normal, tangent_j=tangent))
    return difference(formula, case, formula.at(case), others, "in the other frame")


def same_in_other_units(formula: LawFormula, case: Case) -> Violation:
    """Check that results are the same in other units of length, mass and time."""
    results, found = formula.at(case), case.in_other_units()
    if found is None:
        return None
    scaled, logarithms = found
    others = zip(formula.at(scaled), formula.units, strict=True)
    back = tuple(value / factor(unit, logarithms) for value, unit in others)
    return difference(formula, case, results, back, "in other units")


def compiled_alike(formula: LawFormula, case: Case) -> Violation:
    """Check that compiled formulas give what plain Python gives, where that raises nothing."""
    plain = case.of(case.subject.but(compiled={}))
    try:
        expected = formula.at(plain)
    except (ArithmeticError, ValueError):  # compiled, a division by 0 is inf
        return None
    return difference(formula, plain, expected, formula.at(case), "compiled")


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
            "finite": grains.velocities_are_finite,
            "variance": grains.velocities_have_their_variance,
            "bounds": grains.velocities_are_within_bounds,
            "flow": grains.flow_does_not_scale,
            "units": grains.velocities_in_other_units,
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
        *(("finite", partial(results_are_finite, each)) for each in kind.formulas),
        *(("symmetry", partial(symmetric, each)) for each in of_pairs),
        *(("frame", partial(same_in_other_frame, each)) for each in of_pairs),
        *(("units", partial(same_in_other_units, each)) for each in kind.formulas),
        *kind.properties.items(),
        *(("compiled", partial(compiled_alike, each)) for each in compiled),
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
