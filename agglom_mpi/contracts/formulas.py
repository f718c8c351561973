"""Properties of any formula: finite, symmetric, and the same in other frames and other units.

The results of a formula in a case are compared with those in an equivalent one: both grains
exchanged, one velocity added to all, all numbers in other units. They may differ by rounding: by
`RESULT_ROUNDING` of themselves, or by the effect of a change of every number by `JITTER`, which is
far above rounding (1.1e-16 each) and far below any real difference.
"""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.contracts.cases import Violation, factor
from agglom_mpi.contracts.subject import Case

RESULT_ROUNDING: Final = 1e-10
"""Relative difference that is rounding."""
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
