"""A law under test among the laws of a scene, and its formulas at a point."""

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.cases import INTERVALS, Interval, factor, other_units
from agglom_mpi.declaration.components import In, number_of
from agglom_mpi.declaration.laws import Law
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ImpactLaws
from agglom_mpi.variables import PAPER_VARIABLES

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

PRESSURE_LAWS: Final = ("duration", "hardness", "solver")
"""Laws, by their keys in a scene, that only the contact pressure needs."""

CASES_SEED: Final = 20_260_101
"""Seed of the random cases, the same in every test."""

RANDOM_CASES: Final = 1000
"""Number of cases in which a property is tested."""

DECADES: Final = 1e3
"""Maximum factor between a number of a law without limits and 1, or its limit."""

VARIABLE_UNITS: Final = {name: unit for name, unit, *_ in PAPER_VARIABLES}
"""SI units of the variables, by name."""


@dataclass(eq=False)
class Subject:
    """A law under test.

    Attributes
    ----------
    tested
        The law.
    laws
        All laws of the scene by key; the one under test is among them where it is of an impact.
    variables
        Ranges of variables in SI units, by name, that replace `VARIABLE_RANGES`.
    numbers
        Ranges of the law's own numbers that a campaign searches; None: all numbers are drawn
        within their limits, where there are some.
    compiled
        Its compiled formulas by name; all others are plain Python.
    logarithms
        Those of the units of all laws over SI, see `cases.other_units`; None: the units are SI.
    """

    tested: Law
    laws: Mapping[str, Law]
    variables: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    numbers: Mapping[str, tuple[float, float]] | None = None
    compiled: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    logarithms: NDArray[np.float64] | None = None
    _columns: dict[str, list[float]] = field(default_factory=dict)

    @property
    def solves_equation(self) -> bool:
        """Whether the scene solves e = G(e)."""
        restitution: Any = self.laws["restitution"]
        needed: bool = restitution.uses_contact_pressure
        return needed

    @property
    def constants(self) -> set[str]:
        """Units of the physical constants in the formulas of the law, and of those it is given."""
        return {unit for law in (self.tested, *self.laws.values()) for unit in law.constants}

    def but(self, **changes: Any) -> "Subject":
        """Return the subject with other formulas or units; numbers that were drawn are kept."""
        other = copy.copy(self)
        vars(other).update(changes)
        return other

    @cached_property
    def intervals(self) -> Mapping[str, Interval]:
        """Intervals of the variables, of the law's own numbers, and of all others."""
        found = dict(INTERVALS)
        for name, (low, high) in {**VARIABLE_RANGES, **self.variables}.items():
            free = name in MAY_BE_ZERO and VARIABLE_RANGES[name] == (low, high)
            if unit := VARIABLE_UNITS.get(name):
                found[name] = Interval(low, high, unit, low > 0.0, (0.0,) if free else ())
        own = {f"law.{name}": self._interval(name, number) for name, number in self.drawn.items()}
        return found | own

    def value(self, name: str, number: int) -> float:
        """Return a number of a case: special or in the middle of its interval in the first one."""
        if name not in self._columns:
            random = np.random.default_rng((CASES_SEED, *name.encode()))
            at = self.intervals[name].at
            others = (at(*shares) for shares in random.random((RANDOM_CASES, 3)).tolist())
            self._columns[name] = [at(0.5, 0.0), *others]
        return self._columns[name][number]

    @cached_property
    def drawn(self) -> dict[str, In]:
        """The law's own numbers that are drawn, by name."""
        fields = type(self.tested).model_fields
        return {
            name: number
            for name, field in fields.items()
            if isinstance(number := number_of(field), In)
            and isinstance(getattr(self.tested, name), float | int)
        }

    def _interval(self, name: str, number: In) -> Interval:
        given = float(getattr(self.tested, name))
        if self.numbers is not None:
            low, high = self.numbers.get(name, (given, given))
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

    def impact_laws(self, case: "Case") -> ImpactLaws:
        """Return all laws of an impact in a case, the one under test among them."""
        needed = self.solves_equation or any(self.laws[key] is self.tested for key in PRESSURE_LAWS)
        built: dict[str, Any] = {}
        for key in ImpactLaws._fields[:-1]:
            law = case.law if self.laws[key] is self.tested else self.scaled(self.laws[key])
            built[key] = law.build(case.values) if needed or key not in PRESSURE_LAWS else None
        capacity = math.inf if self.laws["heating"].is_absent else case["heat_capacity"]
        return ImpactLaws(**built, heat_capacity=capacity)

    def scaled(self, law: Law) -> Law:
        """Return a law of the scene in the units of the subject."""
        return law if self.logarithms is None else scaled_law(law, self.logarithms)


def scaled_law(law: Law, logarithms: NDArray[np.float64]) -> Law:
    """Return a law with its numbers in other units."""
    scaled: dict[str, Any] = {}
    for name, declared in type(law).model_fields.items():
        number, value = number_of(declared), getattr(law, name)
        if isinstance(value, Law):
            scaled[name] = scaled_law(value, logarithms)
        if isinstance(number, In) and value is not None:
            by = factor(number.unit, logarithms)
            scaled[name] = tuple(v * by for v in value) if isinstance(value, tuple) else value * by
    return law.model_copy(update=scaled)


@dataclass(eq=False)
class Case:
    """A law under test at named numbers, which are drawn when they are asked for.

    Attributes
    ----------
    subject
        The law among those of its scene.
    number
        Number of the case, from 0.
    numbers
        Those asked for so far, or given, in SI units.
    origin
        The original of a case with other numbers; numbers drawn here are its numbers, too.
    """

    subject: Subject
    number: int
    numbers: dict[str, float] = field(default_factory=dict)
    origin: "Case | None" = None

    def __getitem__(self, name: str) -> float:
        if name not in self.numbers:
            if self.origin is None:
                self.numbers[name] = self.subject.value(name, self.number)
            else:
                self.numbers[name] = self.origin[name]
        return self.numbers[name]

    def but(self, **numbers: float) -> "Case":
        """Return the case with some other numbers."""
        return Case(self.subject, self.number, {**self.numbers, **numbers}, self)

    def of(self, subject: Subject) -> "Case":
        """Return the case of another subject."""
        return Case(subject, self.number, dict(self.numbers))

    def in_other_units(self) -> "tuple[Case, NDArray[np.float64]] | None":
        """Return the case in other units of length, mass and time, and their logarithms.

        None: the constants of the law leave SI alone.
        """
        wanted = [self[name] for name in ("unit_length", "unit_mass", "unit_time")]
        logarithms = other_units(wanted, self.subject.constants)
        if logarithms is None:
            return None
        units = {name: self.subject.intervals[name].unit for name in self.numbers}
        scaled = {name: self[name] * factor(unit, logarithms) for name, unit in units.items()}
        return self.of(self.subject.but(logarithms=logarithms)).but(**scaled), logarithms

    def call(self, formula: str, *arguments: Any) -> Any:
        """Return what a formula of the law gives: the compiled one if there is one."""
        plain = getattr(type(self.subject.tested), formula)
        return self.subject.compiled.get(formula, plain)(self.built, *arguments)

    @cached_property
    def built(self) -> Any:
        """The law's numbers as kernels see them."""
        return self.law.build(self.values)

    @cached_property
    def values(self) -> Mapping[str, float]:
        """All variables."""
        return {name: self[name] for name in VARIABLE_RANGES}

    @cached_property
    def law(self) -> Any:
        """The law with its numbers."""
        own = {name: self[f"law.{name}"] for name in self.subject.drawn}
        return self.subject.scaled(self.subject.tested).model_copy(update=own)

    @cached_property
    def laws(self) -> ImpactLaws:
        """All laws of an impact."""
        return self.subject.impact_laws(self)

    @property
    def grain(self) -> tuple[float, float, float]:
        """Temperature in K, surface in m² and heat capacity in J/K of a grain."""
        radius = self["radius"]
        mass = 4.0 / 3.0 * math.pi * radius**3 * self["density"]
        surface = 4.0 * math.pi * radius**2
        return self["temperature_of_grain"], surface, mass * self["heat_capacity"]

    @property
    def deficits(self) -> tuple[float, float, float]:
        """A lower, a middle and an upper deficit."""
        upper = self["upper"]
        lower = upper * self["lower_share"]
        return lower, lower + self["between"] * (upper - lower), upper

    @cached_property
    def pair(self) -> ContactPair:
        """The two grains."""
        radii = self["radius_i"], self["radius_j"]
        mass_i, mass_j = (4.0 / 3.0 * math.pi * self["density"] * each**3 for each in radii)
        given = {name: self[name] for name in ContactPair._fields if name in INTERVALS}
        derived = {
            "mass_i": mass_i,
            "mass_j": mass_j,
            "reduced_mass": mass_i * mass_j / (mass_i + mass_j),
            "radius": min(radii),
            "normal_i": self["normal_j"] + self["approach_speed"],
            "tangent_i": self["tangent_j"] + self["slip_speed"],
        }
        return ContactPair(**{**given, **derived})
