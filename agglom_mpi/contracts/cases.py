"""Intervals of numbers at which laws are tested, over decades; faults, findings; other units."""

import math
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.units import dimensions_of

Violation: TypeAlias = str | None
"""Description of a fault; None if there is none."""

RESULT_ROUNDING: Final = 1e-10
"""Relative difference of results that is rounding."""

SPECIAL_SHARE: Final = 0.2
"""Fraction of the cases in which a number has one of its special values."""


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
        Values drawn in a fraction `SPECIAL_SHARE` of the cases.
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

    def at(self, share: float, special: float, sign: float = 1.0) -> float:
        """Return the value for three random numbers from 0 to 1, with two digits if it can be."""
        if self.special and special < SPECIAL_SHARE:
            return self.special[int(special / SPECIAL_SHARE * len(self.special))]
        if self.logarithmic:
            value = self.low * math.exp(share * math.log(self.high / self.low))
        else:
            value = self.low + share * (self.high - self.low)
        if self.high > 2.0 * self.low:
            value = float(round(value)) if self.whole else float(f"{value:.2g}")
        value = min(max(value, self.low), self.high)
        return -value if self.signed and sign < 0.5 else value


SHARE: Final = Interval(0.0, 1.0, "1", False)
SPEED: Final = Interval(1e-3, 1e2, "m/s", special=(0.0,), signed=True)
RADIUS: Final = Interval(1e-6, 1e-1, "m", special=(1e-3,))
TEMPERATURE: Final = Interval(1.0, 3e3, "K", special=(300.0,))
UNIT: Final = Interval(-4.0, 4.0, "1", False)

INTERVALS: Final[Mapping[str, Interval]] = {
    # Two grains that collide; masses follow from radii and density.
    "approach_speed": Interval(1e-5, 1e3, "m/s"),
    "slip_speed": Interval(1e-5, 1e3, "m/s", special=(0.0,)),
    "radius_i": RADIUS,
    "radius_j": RADIUS,
    "temperature_i": TEMPERATURE,
    "temperature_j": TEMPERATURE,
    "normal_j": SPEED,
    "tangent_j": SPEED,
    "time_since_impact": Interval(1e-9, 1e3, "s", special=(math.inf,)),
    # A deficit 1 − e; and others, from `lower_share` of `upper` to `upper`.
    "deficit": Interval(1e-9, 1.0, special=(1.0,)),
    "upper": Interval(1e-6, 1.0, special=(1.0,)),
    "lower_share": SHARE,
    "between": SHARE,
    "area": Interval(1e-12, 1e-2, "m^2"),
    "area_ratio": Interval(1e-3, 1e3),
    # An impact that softens a pair, and nearly bonds it: kinetic energy of the approach over heat,
    # w²/(Cθ), and pressure with e = 0 over twice the hardness after it. One in thirty has several
    # roots.
    "heat_ratio": Interval(1e-1, 1e2),
    "pressure_ratio": Interval(0.3, 0.999),
    # A grain, how much warmer another one is, and how long it cools; `relaxed` is the time over
    # that of its first rate to where it comes to rest.
    "temperature_of_grain": Interval(1.0, 5e3, "K", special=(300.0,)),
    "warmer_by": Interval(1e-3, 10.0),
    "radius": RADIUS,
    "time": Interval(1e-9, 1e9, "s", special=(0.0,)),
    "time_share": SHARE,
    "relaxed": Interval(1e-3, 1.0),
    # Energies that an impact releases, and an aggregate; `work_of_frame` is the difference of its
    # own change of energy in another frame.
    "pair_loss": Interval(1e-15, 1e3, "J", special=(0.0,)),
    "own_share": SHARE,
    "work_of_frame": Interval(1e-12, 1e3, "J", special=(0.0,), signed=True),
    "grains": Interval(1.0, 1e3, whole=True, special=(1.0, 2.0)),
    "seed": Interval(1.0, 1e6, whole=True),
    # Velocity of another inertial frame; logarithms to base 10 of new units over those of SI.
    "frame_along_n": Interval(1e-2, 1e2, "m/s", signed=True),
    "frame_along_t": Interval(1e-2, 1e2, "m/s", signed=True),
    "unit_length": UNIT,
    "unit_mass": UNIT,
    "unit_time": UNIT,
}
"""Intervals of the numbers that properties need beside those of the law and the variables."""


def within(what: str, value: float, low: float, high: float) -> Violation:
    """Return a fault unless a value is from `low` to `high`."""
    if low <= value <= high:
        return None
    return f"{what} is {value:.9g}, not within {low:.9g} ... {high:.9g}"


def equal(what: str, value: float, expected: float, margin: float) -> Violation:
    """Return a fault unless two values differ by at most `margin`."""
    if abs(value - expected) <= margin:
        return None
    return f"{what} is {value:.9g}, not {expected:.9g}"


@cache
def exponents(unit: str) -> tuple[float, ...]:
    """Return the powers of length, mass and time in a unit, without other dimensions."""
    found = dimensions_of(unit)
    return tuple(found.get(base, 0.0) for base in ("[length]", "[mass]", "[time]"))


def factor(unit: str, logarithms: NDArray[np.float64]) -> float:
    """Return the factor of a number in a unit when it is in other units; see `other_units`."""
    return float(10.0 ** -(np.array(exponents(unit)) @ logarithms))


def other_units(wanted: Iterable[float], constants: Iterable[str]) -> NDArray[np.float64] | None:
    """Return the logarithms of new units over those of SI, near the wanted ones, shape (3,).

    Physical constants, whose units are given, keep their values. None: that leaves SI alone.
    The kelvin and the mole stay as they are.
    """
    fixed = np.array([exponents(unit) for unit in constants]).reshape(-1, 3)
    chosen = (np.eye(3) - np.linalg.pinv(fixed) @ fixed) @ np.array([*wanted])
    return chosen if float(np.abs(chosen).max()) > math.sqrt(np.finfo(float).eps) else None


class PropertyFinding(NamedTuple):
    """A property of a component that was tested.

    Attributes
    ----------
    component
        The class of the component.
    name
        Name of the property.
    fault
        Description of the fault; empty if the property holds.
    numbers
        The numbers at which it fails.
    """

    component: type[Any]
    name: str
    fault: str = ""
    numbers: Mapping[str, float] = {}

    @property
    def fails(self) -> bool:
        """Whether the property does not hold, and the class does not name it in `breaks`."""
        return bool(self.fault) and self.name not in self.component.breaks

    def __str__(self) -> str:
        at = ", ".join(f"{name}={value:.12g}" for name, value in self.numbers.items())
        line = f"{component_label(self.component)}: {self.name}: {self.fault}"
        return f"{line}; at {at}" if at else line


def component_label(component: type[Any]) -> str:
    """Return the name of a component in a line: `FILE.py:Class`, or `heating own_energy`."""
    module, name = component.__module__.rpartition(".")[2], next(iter(component.names()), "")
    if not name:
        return f"{module}.{component.__qualname__}"
    return name if component.own is not None else f"{module} {name}"
