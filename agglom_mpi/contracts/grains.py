"""Properties of laws of a single grain: cooling between impacts, and fragmentation."""

import math
from typing import Any, Final

import numpy as np

from agglom_mpi.contracts.formula_properties import RESULT_ROUNDING, LawFormula
from agglom_mpi.contracts.kinds import LawKind, LawProperty
from agglom_mpi.contracts.points import Domain, Interval, Point, Violation
from agglom_mpi.contracts.subject import Subject
from agglom_mpi.formatting import pluralise

GRAIN: Final[Domain] = {
    "temperature_of_grain": Interval(1.0, 5e3, "K", special=(300.0,)),
    "radius": Interval(1e-6, 1e-1, "m"),
    "time": Interval(1e-9, 1e9, "s", special=(0.0,)),
}
"""A grain, and how long it cools."""

INTERVALS: Final[Domain] = {**GRAIN, "time_share": Interval(0.0, 1.0, "1", False)}

RELAXING: Final[Domain] = {**GRAIN, "relaxed": Interval(1e-3, 1.0)}
"""A grain, and the time that it cools over that of its first rate to where it comes to rest."""

FEW, MANY = (np.polynomial.legendre.leggauss(count) for count in (12, 24))
"""Nodes and weights on [-1, 1] of two quadratures, whose difference is the error of the first."""

SHATTERING: Final[Domain] = {
    "pair_loss": Interval(1e-15, 1e3, "J", special=(0.0,)),
    "own_share": Interval(0.0, 1.0, "1", False),
    "radius": Interval(1e-6, 1e-1, "m"),
    "grains": Interval(1.0, 1e3, whole=True, special=(1.0, 2.0)),
    "work_of_frame": Interval(1e-12, 1e3, "J", special=(0.0,), signed=True),
}
"""Energies that an impact releases, and an aggregate; `work_of_frame` is the difference of its own
change of energy in another frame."""


def surface_and_capacity(point: Point) -> tuple[float, float]:
    """Return the surface in m² and the heat capacity in J/K of a grain."""
    radius = point["radius"]
    mass = 4.0 / 3.0 * math.pi * radius**3 * point["density"]
    return 4.0 * math.pi * radius**2, mass * point["heat_capacity"]


def _rate(subject: Subject, point: Point) -> tuple[Any, ...]:
    return point["temperature_of_grain"], *surface_and_capacity(point)


def _cooled(subject: Subject, point: Point) -> tuple[Any, ...]:
    return *_rate(subject, point), point["time"]


def stays_between(subject: Subject, point: Point) -> Violation:
    """Check that a grain stays above 0 K, and between its temperature and where it tends to."""
    numbers = subject.numbers(point)
    start, surface, capacity = _rate(subject, point)
    rest = subject.formula("rest_temperature")(numbers)
    end = subject.formula("exact_temperature")(numbers, start, surface, capacity, point["time"])
    margin = RESULT_ROUNDING * max(start, rest)
    low, high = sorted((start, rest))
    if max(low - margin, 0.0) <= end <= high + margin:
        return None
    if low <= end <= start:  # it may have been at rest before
        return None
    return f"{start:.9g} K becomes {end:.9g} K on the way to {rest:.9g} K"


def two_intervals_are_one(subject: Subject, point: Point) -> Violation:
    """Check that a grain that cools for two times has cooled for their sum."""
    numbers = subject.numbers(point)
    start, surface, capacity = _rate(subject, point)
    exact = subject.formula("exact_temperature")
    first = point["time"] * point["time_share"]
    middle = exact(numbers, start, surface, capacity, first)
    twice = exact(numbers, middle, surface, capacity, point["time"] - first)
    once = exact(numbers, start, surface, capacity, point["time"])
    if abs(twice - once) <= RESULT_ROUNDING * max(once, twice, 0.01 * start):
        return None
    return f"{start:.9g} K becomes {once:.9g} K at once, and {twice:.9g} K by two intervals"


def solves_its_equation(subject: Subject, point: Point) -> Violation:
    """Check that `exact_temperature` falls by the integral of `cooling_rate` along itself."""
    numbers = subject.numbers(point)
    start, surface, capacity = _rate(subject, point)
    rate, exact = (subject.formula(name) for name in ("cooling_rate", "exact_temperature"))
    distance = abs(start - subject.formula("rest_temperature")(numbers))
    first = abs(rate(numbers, start, surface, capacity))
    if first == 0.0 or distance <= 1e-6 * start:
        return None
    time = point["relaxed"] * distance / first

    def fallen(nodes: Any, weights: Any) -> float:
        return (
            0.5
            * time
            * sum(
                weight
                * rate(
                    numbers,
                    exact(numbers, start, surface, capacity, 0.5 * time * (1.0 + node)),
                    surface,
                    capacity,
                )
                for node, weight in zip(nodes.tolist(), weights.tolist(), strict=True)
            )
        )

    coarse, fine = fallen(*FEW), fallen(*MANY)
    change = start - exact(numbers, start, surface, capacity, time)
    margin = 10.0 * abs(fine - coarse) + 1e-9 * abs(fine) + RESULT_ROUNDING * max(start, distance)
    if abs(change - fine) <= margin:
        return None
    return f"it cools by {change:.9g} K in {time:.6g} s, but its rate gives {fine:.9g} K"


def _released(subject: Subject, point: Point) -> tuple[Any, ...]:
    own = point["own_share"] * point["pair_loss"] + point["work_of_frame"]
    return point["pair_loss"], own, point["radius"], int(point["grains"])


def counts_are_whole(subject: Subject, point: Point) -> Violation:
    """Check that there are 1 to `grains` whole pieces, and that a single one takes no energy."""
    numbers = subject.numbers(point)
    pieces, energy = subject.formula("breakage")(numbers, *_released(subject, point))
    if pieces != int(pieces) or not 1 <= pieces <= point["grains"]:
        return f"{pluralise(int(point['grains']), 'grain')} become {pluralise(pieces, 'piece')}"
    if energy < 0.0 or (pieces == 1 and energy != 0.0):
        return f"{pieces} pieces take {energy:.9g} J"
    return None


def takes_what_is_there(subject: Subject, point: Point) -> Violation:
    """Check that new surface of both grains takes no more energy than the pair has lost."""
    numbers = subject.numbers(point)
    loss, own, radius, grains = _released(subject, point)
    breakage = subject.formula("breakage")
    taken = breakage(numbers, loss, own, radius, grains).energy
    taken += breakage(numbers, loss, loss - own, radius, grains).energy
    if taken <= loss * (1.0 + RESULT_ROUNDING):
        return None
    return f"new surface takes {taken:.9g} J, but the pair has lost {loss:.9g} J"


def same_pieces_in_other_frame(subject: Subject, point: Point) -> Violation:
    """Check that the pieces do not depend on the work of the impulses in another frame."""
    numbers = subject.numbers(point)
    loss, own, radius, grains = _released(subject, point)
    breakage = subject.formula("breakage")
    rest = own - point["work_of_frame"]
    one, other = (breakage(numbers, loss, change, radius, grains) for change in (own, rest))
    if (
        one.pieces == other.pieces
        and abs(one.energy - other.energy) <= RESULT_ROUNDING * one.energy
    ):
        return None
    return f"there are {one.pieces} pieces, and {other.pieces} in another frame"


COOLING_KIND: Final = LawKind(
    formulas=(
        LawFormula("cooling_rate", _rate, ("K/s",), GRAIN),
        LawFormula("exact_temperature", _cooled, ("K",), GRAIN),
        LawFormula("rest_temperature", lambda subject, point: (), ("K",), {}),
    ),
    properties=(
        LawProperty("bounds", stays_between, GRAIN),
        LawProperty("interval", two_intervals_are_one, INTERVALS),
        LawProperty("solution", solves_its_equation, RELAXING, 500),
    ),
)
FRAGMENTATION_KIND: Final = LawKind(
    formulas=(LawFormula("breakage", _released, ("1", "J"), SHATTERING),),
    properties=(
        LawProperty("pieces", counts_are_whole, SHATTERING),
        LawProperty("energy", takes_what_is_there, SHATTERING),
        LawProperty("frame", same_pieces_in_other_frame, SHATTERING),
    ),
)
