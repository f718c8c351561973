"""Points: the named numbers at which a property of a law is tested, drawn over decades.

A point has everything that decides a result: the numbers of the law, the variables of the string,
and the arguments of its formulas. A failure is reported with its point, made simpler: numbers that
do not matter are left out, and the others are rounded as far as the failure persists.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple, TypeAlias

import numpy as np

Point: TypeAlias = dict[str, float]
"""Numbers in SI units, by name."""

Violation: TypeAlias = str | None
"""Description of the fault at a point; None if there is none."""

SPECIAL: Final = 0.2
"""Fraction of the points in which a number has one of its special values."""

TRIALS: Final = 3
"""Number of other values that are tried of a number to find whether it matters."""


class Interval(NamedTuple):
    """Range of a number, and how it is drawn.

    Attributes
    ----------
    low, high
        Its ends.
    unit
        SI unit.
    logarithmic
        Whether it is uniform in the logarithm; `low` is positive then.
    special
        Values drawn at a fraction `SPECIAL` of the points.
    signed
        Whether either sign is drawn.
    whole
        Whether it is a whole number.
    """

    low: float
    high: float
    unit: str = "1"
    logarithmic: bool = True
    special: tuple[float, ...] = ()
    signed: bool = False
    whole: bool = False

    def at(self, share: float, special: float, sign: float) -> float:
        """Return the value for three random numbers from 0 to 1."""
        if self.special and special < SPECIAL:
            return self.special[int(special / SPECIAL * len(self.special))]
        if self.logarithmic:
            value = self.low * math.exp(share * math.log(self.high / self.low))
            value = min(max(value, self.low), self.high)
        else:
            value = self.low + share * (self.high - self.low)
        if self.whole:
            value = float(round(value))
        return -value if self.signed and sign < 0.5 else value

    def holds(self, value: float) -> bool:
        """Return whether a value can be drawn."""
        return value in self.special or self.low <= (abs(value) if self.signed else value) <= (
            self.high
        )


Domain: TypeAlias = Mapping[str, Interval]
"""Intervals of all numbers of a point, by name."""


def draw_points(domain: Domain, seed: tuple[int, ...], count: int) -> Iterator[Point]:
    """Yield random points of a domain."""
    shares = np.random.default_rng(seed).random((count, len(domain), 3)).tolist()
    for row in shares:
        drawn = zip(domain.items(), row, strict=True)
        yield {name: interval.at(*numbers) for (name, interval), numbers in drawn}


def simplest(
    point: Point, domain: Domain, violation: Callable[[Point], Violation]
) -> tuple[str, Point]:
    """Return the fault at a point that is as simple as it can be made, and that point.

    Numbers that do not matter are left out of it.

    Parameters
    ----------
    point
        A point with a fault.
    domain
        Domain of the point.
    violation
        Returns the fault at a point.
    """
    shown = dict(point)
    for name, interval in domain.items():
        for value in _rounder(point[name]):
            tried = {**shown, name: value}
            if interval.holds(value) and violation(tried) is not None:
                shown = tried
                break
    text = violation(shown) or ""
    others = list(draw_points(domain, (0,), TRIALS))
    matters = {
        name
        for name in domain
        if any(violation({**shown, name: other[name]}) != text for other in others)
    }
    return text, {name: value for name, value in shown.items() if name in matters}


def _rounder(value: float) -> Iterator[float]:
    """Yield simpler values in place of one, the simplest first."""
    yield from (0.0, 1.0)
    if value == 0.0 or not math.isfinite(value):
        return
    yield math.copysign(10.0 ** round(math.log10(abs(value))), value)
    for digits in (1, 2, 3):
        yield float(f"{value:.{digits}g}")


def spelled(point: Mapping[str, float]) -> str:
    """Return the numbers of a point as text, shortest digits that give the same number."""
    return ", ".join(f"{name}={_short(value)}" for name, value in point.items())


def _short(value: float) -> str:
    return f"{value:.0f}" if value == int_or_nan(value) and abs(value) < 1e6 else repr(float(value))


def int_or_nan(value: float) -> float:
    """Return a number without its fraction; nan if it is not finite."""
    return float(math.trunc(value)) if math.isfinite(value) else math.nan
