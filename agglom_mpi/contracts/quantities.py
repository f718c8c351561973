"""Properties of any formula: finite, symmetric, and the same in other frames and other units.

A quantity is what one formula gives at a point. Its results are compared with those at a point
that stands for the same: both grains exchanged, all velocities with one added, all numbers in
other units. They may differ by rounding: by `CLOSE` of themselves, or by what a change of every
number by `JITTER` makes of them, which is far above rounding (1.1e-16 each) and far below any real
difference.
"""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.contracts.points import Domain, Interval, Point, Violation
from agglom_mpi.contracts.subject import Subject, exchanged
from agglom_mpi.contracts.units import factor, other_units, scaled_point

CLOSE: Final = 1e-10
"""Relative difference that is rounding."""
JITTER: Final = 1e-11
"""Relative change of every number by which it is found how far rounding reaches."""
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


class Quantity(NamedTuple):
    """What one formula gives at a point.

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
    quantity: Quantity, subject: Subject, point: Point, results: tuple[float, ...]
) -> tuple[float, ...]:
    """Return how far each result may be changed by rounding."""
    random = np.random.default_rng(1)
    reach = [CLOSE * abs(value) for value in results]
    for _ in range(JITTERS):
        moved = {
            name: value * (1.0 + JITTER * random.choice((-1.0, 1.0)))
            for name, value in point.items()
        }
        near = quantity.at(subject, moved)
        reach = [
            max(old, 2.0 * abs(a - b)) if math.isfinite(a - b) else math.inf
            for old, a, b in zip(reach, near, results, strict=True)
        ]
    return tuple(reach)


def difference(
    quantity: Quantity,
    subject: Subject,
    point: Point,
    results: tuple[float, ...],
    others: tuple[float, ...],
) -> Violation:
    """Return the first result that another differs from by more than rounding, in words."""
    if all(_alike(a, b) for a, b in zip(results, others, strict=True)):
        return None
    reach = rounding(quantity, subject, point, results)
    slack = SLACK * quantity.scale(point)
    for value, other, far in zip(results, others, reach, strict=True):
        if not (_alike(value, other) or abs(value - other) <= max(far, slack)):
            return f"{quantity.name} is {value:.9g}, and then {other:.9g}"
    return None


def _alike(value: float, other: float) -> bool:
    return value == other or abs(value - other) <= CLOSE * abs(value)


def finite(quantity: Quantity, subject: Subject, point: Point) -> Violation:
    """Check that results are finite."""
    try:
        results = quantity.at(subject, point)
    except (ArithmeticError, ValueError) as error:
        return f"{quantity.name} raises {type(error).__name__}: {error}"
    for value in results:
        if not (math.isfinite(value) or (quantity.may_be_infinite and value == math.inf)):
            return f"{quantity.name} is {value}"
    return None


def symmetric(quantity: Quantity, subject: Subject, point: Point) -> Violation:
    """Check that results of a pair do not depend on which of the grains is i."""
    assert quantity.exchanged is not None
    results = quantity.at(subject, point)
    others = quantity.at(subject, exchanged(point))
    ordered = tuple(others[place] for place in quantity.exchanged)
    text = difference(quantity, subject, point, results, ordered)
    return text and f"{text} with i and j exchanged"


def same_in_other_frame(quantity: Quantity, subject: Subject, point: Point) -> Violation:
    """Check that results do not change when the same velocity is added to both grains."""
    moved = {
        **point,
        "normal_j": point["normal_j"] + point["frame_along_n"],
        "tangent_j": point["tangent_j"] + point["frame_along_t"],
    }
    results, others = quantity.at(subject, point), quantity.at(subject, moved)
    text = difference(quantity, subject, point, results, others)
    return text and f"{text} in the other frame"


def same_in_other_units(quantity: Quantity, subject: Subject, point: Point) -> Violation:
    """Check that results are the same in other units of length, mass and time."""
    logarithms = other_units(point, subject.constants)
    if logarithms is None:
        return None
    scaled = scaled_point(point, {**subject.domain, **quantity.domain}, logarithms)
    results = quantity.at(subject, point)
    others = quantity.at(subject.in_units(logarithms), scaled)
    back = tuple(
        value / factor(unit, logarithms) for value, unit in zip(others, quantity.units, strict=True)
    )
    text = difference(quantity, subject, point, results, back)
    return text and f"{text} in other units"


def compiled_alike(plain: Subject, quantity: Quantity, subject: Subject, point: Point) -> Violation:
    """Check that compiled formulas give what plain Python gives, where that raises nothing."""
    try:
        expected = quantity.at(plain, point)
    except (ArithmeticError, ValueError):  # compiled, a division by 0 is inf
        return None
    text = difference(quantity, plain, point, expected, quantity.at(subject, point))
    return text and f"{text} compiled"
