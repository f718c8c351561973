"""Properties of any formula: finite, symmetric, and the same in other frames and other units.

The results of a formula at a point are compared with those at an equivalent point: both grains
exchanged, one velocity added to all, all numbers in other units. They may differ by rounding: by
`RESULT_ROUNDING` of themselves, or by the effect of a change of every number by `JITTER`, which is
far above rounding (1.1e-16 each) and far below any real difference.
"""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.contracts.other_units import factor, other_units, scaled_point
from agglom_mpi.contracts.points import Domain, Interval, Point, Violation
from agglom_mpi.contracts.subject import Subject, exchanged

RESULT_ROUNDING: Final = 1e-10
"""Relative difference that is rounding."""
JITTER: Final = 1e-11
"""Relative change of every number, to estimate how far rounding reaches."""
SLACK: Final = 1e-12
"""Rounding relative to the terms that a result is the difference of."""
JITTERS: Final = 4
"""Number of such changes."""

SHIFT_DOMAIN: Final[Domain] = {
    "frame_along_n": Interval(1e-2, 1e2, "m/s", signed=True),
    "frame_along_t": Interval(1e-2, 1e2, "m/s", signed=True),
}
"""Velocity of another inertial frame."""


def as_floats(value: Any) -> tuple[float, ...]:
    """Return a number, or a tuple of numbers, as a tuple of floats."""
    return tuple(map(float, value)) if isinstance(value, tuple) else (float(value),)


class LawFormula(NamedTuple):
    """A formula of a law, and how its results are tested.

    Attributes
    ----------
    name
        Name of the formula.
    arguments
        Returns the formula's arguments at a point, without the law's numbers.
    units
        SI unit of each result.
    domain
        Intervals of the arguments.
    exchanged
        Order of the results when both grains are exchanged; None: it is not of a pair.
    may_be_infinite
        Whether +inf is allowed.
    scale
        Returns the size of the terms that the results are differences of.
    results
        Returns the results from what the formula returns.
    """

    name: str
    arguments: Callable[[Subject, Point], tuple[Any, ...]]
    units: tuple[str, ...]
    domain: Domain
    exchanged: tuple[int, ...] | None = None
    may_be_infinite: bool = False
    scale: Callable[[Point], float] = lambda point: 0.0
    results: Callable[[Any], tuple[float, ...]] = as_floats

    def at(self, subject: Subject, point: Point) -> tuple[float, ...]:
        """Return the results at a point."""
        numbers = subject.numbers(point)
        arguments = self.arguments(subject, point)
        return self.results(subject.formula(self.name)(numbers, *arguments))


def rounding(
    formula: LawFormula, subject: Subject, point: Point, results: tuple[float, ...]
) -> tuple[float, ...]:
    """Return how far each result may be changed by rounding."""
    random = np.random.default_rng(1)
    reach = [RESULT_ROUNDING * abs(value) for value in results]
    for _ in range(JITTERS):
        moved = {
            name: value * (1.0 + JITTER * random.choice((-1.0, 1.0)))
            for name, value in point.items()
        }
        near = formula.at(subject, moved)
        reach = [
            max(old, 2.0 * abs(a - b)) if math.isfinite(a - b) else math.inf
            for old, a, b in zip(reach, near, results, strict=True)
        ]
    return tuple(reach)


def difference(
    formula: LawFormula,
    subject: Subject,
    point: Point,
    results: tuple[float, ...],
    others: tuple[float, ...],
) -> Violation:
    """Return the first result that another differs from by more than rounding, in words."""
    if all(_alike(a, b) for a, b in zip(results, others, strict=True)):
        return None
    reach = rounding(formula, subject, point, results)
    slack = SLACK * formula.scale(point)
    for value, other, far in zip(results, others, reach, strict=True):
        if not (_alike(value, other) or abs(value - other) <= max(far, slack)):
            return f"{formula.name} is {value:.9g}, and then {other:.9g}"
    return None


def _alike(value: float, other: float) -> bool:
    return value == other or abs(value - other) <= RESULT_ROUNDING * abs(value)


def results_are_finite(formula: LawFormula, subject: Subject, point: Point) -> Violation:
    """Check that results are finite."""
    try:
        results = formula.at(subject, point)
    except (ArithmeticError, ValueError) as error:
        return f"{formula.name} raises {type(error).__name__}: {error}"
    for value in results:
        if not (math.isfinite(value) or (formula.may_be_infinite and value == math.inf)):
            return f"{formula.name} is {value}"
    return None


def symmetric(formula: LawFormula, subject: Subject, point: Point) -> Violation:
    """Check that results of a pair do not depend on which of the grains is i."""
    assert formula.exchanged is not None
    results = formula.at(subject, point)
    others = formula.at(subject, exchanged(point))
    ordered = tuple(others[place] for place in formula.exchanged)
    text = difference(formula, subject, point, results, ordered)
    return text and f"{text} with i and j exchanged"


def same_in_other_frame(formula: LawFormula, subject: Subject, point: Point) -> Violation:
    """Check that results do not change when the same velocity is added to both grains."""
    moved = {
        **point,
        "normal_j": point["normal_j"] + point["frame_along_n"],
        "tangent_j": point["tangent_j"] + point["frame_along_t"],
    }
    results, others = formula.at(subject, point), formula.at(subject, moved)
    text = difference(formula, subject, point, results, others)
    return text and f"{text} in the other frame"


def same_in_other_units(formula: LawFormula, subject: Subject, point: Point) -> Violation:
    """Check that results are the same in other units of length, mass and time."""
    logarithms = other_units(point, subject.constants)
    if logarithms is None:
        return None
    scaled = scaled_point(point, {**subject.domain, **formula.domain}, logarithms)
    results = formula.at(subject, point)
    others = formula.at(subject.in_units(logarithms), scaled)
    back = tuple(
        value / factor(unit, logarithms) for value, unit in zip(others, formula.units, strict=True)
    )
    text = difference(formula, subject, point, results, back)
    return text and f"{text} in other units"


def compiled_alike(
    plain: Subject, formula: LawFormula, subject: Subject, point: Point
) -> Violation:
    """Check that compiled formulas give what plain Python gives, where that raises nothing."""
    try:
        expected = formula.at(plain, point)
    except (ArithmeticError, ValueError):  # compiled, a division by 0 is inf
        return None
    text = difference(formula, plain, point, expected, formula.at(subject, point))
    return text and f"{text} compiled"
