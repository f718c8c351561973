"""A law under test among the laws of a scene, and its formulas at a point."""

import copy
import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.other_units import factor
from agglom_mpi.contracts.points import Domain, Interval, Point
from agglom_mpi.declaration.components import In, number_of
from agglom_mpi.declaration.laws import Law
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ImpactLaws
from agglom_mpi.variables import PAPER_VARIABLES

SCENE_LAWS: Final = (
    *("restitution", "duration", "contact_area", "hardness", "friction", "heating", "reaction"),
    *("fragmentation", "solver"),
)
"""Laws of an impact, by their keys in a scene."""

VARIABLE_RANGES: Final[dict[str, tuple[float, float]]] = {
    "relative_speed": (1e-4, 1e3),
    "size_ratio": (0.1, 0.9),
    "density": (1e2, 2e4),
    "hardness": (1e4, 1e11),
    "heat_capacity": (1e1, 1e4),
    "friction": (1e-3, 2.0),
    "temperature": (1e1, 3e3),
    "activation_energy": (1e0, 1e5),
    "reaction_heat": (1e-2, 1e7),
    "surface_energy": (1e-4, 1e3),
}
"""Values of the variables in SI units where no campaign limits them."""

MAY_BE_ZERO: Final = ("friction", "activation_energy", "reaction_heat")
"""Variables that may be 0."""

DECADES: Final = 1e3
"""Maximum factor between a number of a law without limits and 1, or its limit."""

VARIABLE_UNITS: Final = {name: unit for name, unit, *_ in PAPER_VARIABLES}
"""SI units of the variables, by name."""


class Subject:
    """A law under test.

    Parameters
    ----------
    law
        The law.
    laws
        All laws of the scene by key; the one under test is among them where it is of an impact.
    variables
        Ranges of variables in SI units, by name, that replace `VARIABLE_RANGES`.
    numbers
        Ranges of the law's own numbers that a campaign searches; None: all numbers are drawn
        within their limits, where there are some.
    compiled
        Formulas that replace the law's own, by name.
    """

    def __init__(
        self,
        law: Law,
        laws: Mapping[str, Law],
        variables: Mapping[str, tuple[float, float]] | None = None,
        numbers: Mapping[str, tuple[float, float]] | None = None,
        compiled: Mapping[str, Callable[..., Any]] | None = None,
    ) -> None:
        self.tested = law
        self.laws = laws
        self._ranges = VARIABLE_RANGES | dict(variables or {})
        self._numbers = numbers
        self._compiled = compiled or {}
        self._logarithms: NDArray[np.float64] | None = None

    def formula(self, name: str) -> Callable[..., Any]:
        """Return a formula of the law: the compiled one if there is one."""
        found: Callable[..., Any] = self._compiled.get(name) or getattr(type(self.tested), name)
        return found

    @property
    def solves_equation(self) -> bool:
        """Whether the scene solves e = G(e)."""
        restitution: Any = self.laws["restitution"]
        needed: bool = restitution.uses_contact_pressure
        return needed

    def is_compiled(self, name: str) -> bool:
        """Return whether a formula of the law is a compiled one."""
        return name in self._compiled

    @property
    def has_compiled(self) -> bool:
        """Whether any formula of the law is a compiled one."""
        return bool(self._compiled)

    def in_plain_python(self) -> "Subject":
        """Return the subject with all formulas as plain Python."""
        return Subject(self.tested, self.laws, self._ranges, self._numbers)

    @cached_property
    def domain(self) -> Domain:
        """Intervals of the variables and of the law's own numbers."""
        found = {
            name: Interval(low, high, VARIABLE_UNITS[name], low > 0.0 < high, self._zero(name, low))
            for name, (low, high) in self._ranges.items()
            if name in VARIABLE_UNITS
        }
        for name, number in self._drawn.items():
            found[self._own(name)] = self._interval(name, number)
        return found

    def _zero(self, name: str, low: float) -> tuple[float, ...]:
        free = VARIABLE_RANGES.get(name) == self._ranges[name]
        return (0.0,) if free and name in MAY_BE_ZERO else ()

    @cached_property
    def _drawn(self) -> dict[str, In]:
        """The law's own numbers that are drawn, by name."""
        fields = type(self.tested).model_fields
        found = ((name, number_of(field)) for name, field in fields.items())
        return {
            name: number
            for name, number in found
            if isinstance(number, In) and isinstance(getattr(self.tested, name), float | int)
        }

    def _own(self, name: str) -> str:
        """Return the name of an own number in a point, apart from those of variables."""
        return f"{name}_of_law" if name in VARIABLE_UNITS else name

    def _interval(self, name: str, number: In) -> Interval:
        """Return where a number of the law is drawn from."""
        given = float(getattr(self.tested, name))
        if self._numbers is not None:
            low, high = self._numbers.get(name, (given, given))
            return Interval(low, high, number.unit, low > 0.0)
        least, most = number.at_least, number.at_most
        start = number.above if least is None else least
        end = number.below if most is None else most
        ends = tuple(limit for limit in (least, most) if limit is not None)
        if start is None:
            return Interval(given, given, number.unit, False)
        if end is None:
            begin = start if start > 0.0 else (given or 1.0) / DECADES
            return Interval(begin, begin * DECADES**2, number.unit, True, ends)
        inner = 1e-6 * (end - start)
        return Interval(start + inner, end - inner, number.unit, False, ends)

    def in_units(self, logarithms: NDArray[np.float64]) -> "Subject":
        """Return the subject with all laws in other units; see `other_units.other_units`."""
        other = copy.copy(self)
        other._logarithms = logarithms
        return other

    def _scaled(self, law: Law) -> Law:
        return law if self._logarithms is None else scaled_law(law, self._logarithms)

    def law_at(self, point: Point) -> Law:
        """Return the law with its numbers at a point."""
        own = {name: point[self._own(name)] for name in self._drawn}
        law = self._scaled(self.tested)
        return law.model_copy(update=own) if own else law

    def numbers(self, point: Point) -> Any:
        """Return the numbers of the law at a point, as kernels see them."""
        return self.law_at(point).build(point)

    def impact_laws(self, point: Point) -> ImpactLaws:
        """Return all laws of an impact at a point, the one under test among them."""
        unused = (
            ()
            if self.solves_equation or self._is_of_pressure
            else ("duration", "hardness", "solver")
        )
        built: dict[str, Any] = {
            key: None
            if key in unused
            else self.numbers(point)
            if law is self.tested
            else self._scaled(law).build(point)
            for key, law in self.laws.items()
            if key in SCENE_LAWS
        }
        absent = self.laws["heating"].is_absent
        return ImpactLaws(**built, heat_capacity=math.inf if absent else point["heat_capacity"])

    @property
    def _is_of_pressure(self) -> bool:
        """Whether the law under test is one that only the contact pressure needs."""
        return any(self.laws[key] is self.tested for key in ("duration", "hardness", "solver"))

    @property
    def constants(self) -> tuple[str, ...]:
        """Units of the physical constants in the formulas of the law, and of those it is given."""
        return tuple({unit for law in (self.tested, *self.laws.values()) for unit in law.constants})


def scaled_law(law: Law, logarithms: NDArray[np.float64]) -> Law:
    """Return a law with its numbers in other units."""
    scaled: dict[str, Any] = {}
    for name, field in type(law).model_fields.items():
        number, value = number_of(field), getattr(law, name)
        if isinstance(value, Law):
            scaled[name] = scaled_law(value, logarithms)
        if isinstance(number, In) and value is not None:
            by = factor(number.unit, logarithms)
            scaled[name] = tuple(v * by for v in value) if isinstance(value, tuple) else value * by
    return law.model_copy(update=scaled)


PAIR_DOMAIN: Final[Domain] = {
    "approach_speed": Interval(1e-5, 1e3, "m/s"),
    "slip_speed": Interval(1e-5, 1e3, "m/s", special=(0.0,)),
    "radius_i": Interval(1e-6, 1e-1, "m", special=(1e-3,)),
    "radius_j": Interval(1e-6, 1e-1, "m", special=(1e-3,)),
    "temperature_i": Interval(1.0, 3e3, "K", special=(300.0,)),
    "temperature_j": Interval(1.0, 3e3, "K", special=(300.0,)),
    "normal_j": Interval(1e-3, 1e2, "m/s", special=(0.0,), signed=True),
    "tangent_j": Interval(1e-3, 1e2, "m/s", special=(0.0,), signed=True),
    "time_since_impact": Interval(1e-9, 1e3, "s", special=(math.inf,)),
}
"""Numbers of two grains that collide; masses follow from radii and density."""


def pair_at(point: Point) -> ContactPair:
    """Return the pair of a point."""
    masses = [
        4.0 / 3.0 * math.pi * point["density"] * point[name] ** 3
        for name in ("radius_i", "radius_j")
    ]
    return ContactPair(
        approach_speed=point["approach_speed"],
        slip_speed=point["slip_speed"],
        mass_i=masses[0],
        mass_j=masses[1],
        reduced_mass=masses[0] * masses[1] / (masses[0] + masses[1]),
        radius=min(point["radius_i"], point["radius_j"]),
        radius_i=point["radius_i"],
        radius_j=point["radius_j"],
        temperature_i=point["temperature_i"],
        temperature_j=point["temperature_j"],
        normal_i=point["normal_j"] + point["approach_speed"],
        normal_j=point["normal_j"],
        tangent_i=point["tangent_j"] + point["slip_speed"],
        tangent_j=point["tangent_j"],
        time_since_impact=point["time_since_impact"],
    )


def exchanged(point: Point) -> Point:
    """Return the point with both grains exchanged, and the directions n and t reversed."""
    return {
        **point,
        "radius_i": point["radius_j"],
        "radius_j": point["radius_i"],
        "temperature_i": point["temperature_j"],
        "temperature_j": point["temperature_i"],
        "normal_j": -(point["normal_j"] + point["approach_speed"]),
        "tangent_j": -(point["tangent_j"] + point["slip_speed"]),
    }
