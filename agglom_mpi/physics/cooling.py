"""Cooling of a grain between impacts: the laws, their exact solutions and published Euler steps.

A temperature does not depend on how the grain moves, so each can be integrated on its own.
"""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal, NamedTuple, Self

import numpy as np

from agglom_mpi.compilation.stages import Submodel, formula, inlined
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.laws import Law, Values
from agglom_mpi.declaration.needed import needed
from agglom_mpi.physics.constants import STEFAN_BOLTZMANN

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES: Final = tuple(0.5 + 0.5 * float(node) for node in _NODES)
WEIGHTS: Final = tuple(0.5 * float(weight) for weight in _WEIGHTS)
PANEL: Final = 0.5
"""Width in ln of the distance to equilibrium over which the 8-point rule is exact to rounding."""

SHORT: Final = 6e-5
"""Fall of ln of the distance to equilibrium up to which a series is exact to rounding: what it
leaves out is below 6.75 times the fourth power."""

COLDEST: Final = 1e-30
"""Equilibrium in K up to which it is taken as 0 K, so that ln of the distance has a range."""

DIFFERENCE: Final = 6e-6
"""Relative step of a central difference, the cube root of the rounding: its error is 4e-11."""


class EulerCooling(NamedTuple):
    """One explicit Euler step of a law per time step, as published  [A 19] [B 6.21].

    It may oscillate about the surroundings and go below zero. The quartic law is held at θ₀, which
    the exact solution never crosses and beyond which an Euler step runs away.
    """

    law: Submodel


class ExactCooling(NamedTuple):
    """The exact solution of a law, applied to a particle only when its temperature is needed."""

    law: Submodel


class Cooling(Law):
    """Law of the temperature of a grain between impacts.

    Formulas get the temperature in K, the grain's surface 4πb² in m² and its heat capacity mC in
    J/K.

    Attributes
    ----------
    longest_step
        Longest Euler step that does not overshoot where the law is linear, as a formula.
    """

    longest_step: ClassVar[str] = "1/(dθ'/dθ)"

    @needed
    def cooling_rate(self, temperature: float, surface: float, capacity: float) -> float:
        """−θ' in K/s."""
        raise NotImplementedError

    @needed
    def exact_temperature(
        self, temperature: float, surface: float, capacity: float, time: float
    ) -> float:
        """Exact temperature in K after `time` in s."""
        raise NotImplementedError

    def euler_step(self, temperature: float, surface: float, capacity: float, step: float) -> float:
        """Temperature in K after one explicit Euler step of `step` in s  [A 19] [B 6.21]."""
        return temperature - step * cooling_rate(self, temperature, surface, capacity)

    @needed
    def rest_temperature(self) -> float:
        """Temperature in K to which a grain tends."""
        raise NotImplementedError

    def rate_slope(self, temperature: float, surface: float, capacity: float) -> float:
        """Slope of the rate with the temperature, 1/s: Euler steps beyond its inverse overshoot.

        A central difference, unless a law gives the derivative.
        """
        step = DIFFERENCE * temperature
        faster = cooling_rate(self, temperature + step, surface, capacity)
        slower = cooling_rate(self, temperature - step, surface, capacity)
        return (faster - slower) / (2.0 * step)

    @property
    def by_steps(self) -> bool:
        """Whether it is integrated by Euler steps, one in each time step of the engine."""
        return False

    def stepped(self) -> Self:
        """Return the law integrated by Euler steps as published, if it can be."""
        return self

    def integrated(self, value: Values, has_steps: bool) -> Submodel:
        """Return the law as kernels see it, with how it is integrated; None without cooling.

        Parameters
        ----------
        value
            The ten variables in SI units, by name.
        has_steps
            Whether the engine has time steps; without them the solution is exact.
        """
        law = self.build(value)
        if law is None:
            return None
        return EulerCooling(law) if has_steps and self.by_steps else ExactCooling(law)


Integration = Literal["exact", "euler"]
"""Exact solution, or, as published, an Euler step in each time step of the engine."""


class NoCooling(Cooling):
    """Grains keep their temperature between impacts."""

    law: Literal["none"] = "none"
    summary: ClassVar[str] = "grains keep their temperature"
    is_absent = True


class SteppableCooling(Cooling):
    """Base class of laws with a field `integration`, exact or by Euler steps.

    Attributes
    ----------
    integration
        `exact`, or, as published, an `euler` step in each time step of the engine.
    """

    if TYPE_CHECKING:  # a field of each law, in its own place
        integration: Integration

    @property
    def by_steps(self) -> bool:
        """Whether `integration` is by Euler steps."""
        return self.integration == "euler"

    def stepped(self) -> Self:
        """Return the law integrated by Euler steps."""
        return self.model_copy(update={"integration": "euler"})


class RadiativeCooling(SteppableCooling):
    """m C θ' = −h_c a_s(θ − θ_o) − B ε a_s(θ⁴ − θ_s⁴), a_s = 4πb²  [B 6.19-6.21].

    The emissivity is ε, the temperature of the surroundings θ_s, the `convection` h_c, and θ_o the
    temperature of the ambient gas.

    Attributes
    ----------
    emissivity
        Emissivity ε of the surface.
    surroundings
        Temperature θ_s of the walls that radiate back.
    convection
        Coefficient h_c of the heat that the gas takes; 0 leaves it out.
    ambient
        Temperature θ_o of the gas.
    """

    law: Literal["radiation"] = "radiation"
    example: ClassVar[str] = "{law: radiation, emissivity: 0.9, surroundings: 300 K}"
    emissivity: Annotated[float, In("1", at_least=0, at_most=1, meaning="0 to 1")]
    surroundings: Annotated[float, In("K", at_least=0, meaning="a temperature like '300 K'")]
    convection: Annotated[float, In("W/m^2/K", at_least=0)] = 0.0
    ambient: Annotated[float, In("K", at_least=0)] = 300.0
    integration: Integration = "exact"
    summary: ClassVar[str] = "radiation and convection [B 6.19-6.21]"
    derived = ("equilibrium",)
    constants = ("W/m^2/K^4",)
    longest_step = "mC/(a_s(4Bεθ³ + h_c))"

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield convection without the temperature that it cools to."""
        if self.convection > 0 and "ambient" not in self.model_fields_set:
            yield ("ambient",), "is missing; the temperature that convection cools to, like '300 K'"

    @property
    def equilibrium(self) -> float:
        """Temperature θ_e in K at which radiation and convection balance."""
        return equilibrium_temperature(
            self.emissivity, self.surroundings, self.convection, self.ambient
        )

    def cooling_rate(self, temperature, surface, capacity):
        """Radiated and convected power over the heat capacity, K/s."""
        radiated = STEFAN_BOLTZMANN * self.emissivity * (temperature**4 - self.surroundings**4)
        return surface / capacity * (radiated + self.convection * (temperature - self.ambient))

    def exact_temperature(self, temperature, surface, capacity, time):
        """Panel by panel: the time is the integral of the smooth ln|θ − θ_e| over its rate."""
        remaining = time * surface / capacity
        start = temperature - self.equilibrium
        if remaining <= 0.0 or start == 0.0:
            return temperature
        rate = relaxation_rate(self, start)
        if rate * remaining <= SHORT and abs(start) <= temperature:
            return temperature + start * math.expm1(-short_width(self, start, rate, remaining))
        if self.equilibrium <= COLDEST or relaxation_rate(self, min(start, 0.0)) == 0.0:
            return cooled_towards_zero(self, temperature, remaining)
        distance = start
        taken = panel_time(self, distance, PANEL)
        while taken < remaining:
            remaining -= taken
            distance *= math.exp(-PANEL)
            if abs(distance) <= 1e-17 * self.equilibrium:
                return self.equilibrium
            taken = panel_time(self, distance, PANEL)
        width = panel_width(self, distance, remaining, PANEL * remaining / taken)
        if distance == start:  # counted from where it was, which may be far nearer to zero
            return temperature + start * math.expm1(-width)
        return self.equilibrium + distance * math.exp(-width)

    def rest_temperature(self):
        """θ_e in K."""
        return self.equilibrium

    def rate_slope(self, temperature, surface, capacity):
        """a_s(4Bεθ³ + h_c)/(mC) in 1/s."""
        radiated = 4.0 * STEFAN_BOLTZMANN * self.emissivity * temperature**3
        return surface * (radiated + self.convection) / capacity


class QuarticCooling(SteppableCooling):
    """θ' = −(B/(ρC))(θ − θ₀)⁴ above the starting temperature θ₀, nothing below  [A 18-19].

    As published, with its fault: a length is missing, so the numbers mean nothing outside SI.
    """

    law: Literal["quartic"] = "quartic"
    integration: Integration = "exact"
    summary: ClassVar[str] = "(theta - theta0)^4, bounded at theta0 [A 18-19]"
    constants = ("W/m^2/K^4",)
    breaks: ClassVar[Mapping[str, str]] = {"units": "as published, a length is missing"}
    variables = ("density", "heat_capacity", "temperature")
    longest_step = "ρC/(4B(θ − θ₀)³)"

    def cooling_rate(self, temperature, surface, capacity):
        """(B/(ρC))(θ − θ₀)⁴ in K/s."""
        excess = max(0.0, temperature - self.temperature)
        return quartic_coefficient(self) * excess**4

    def exact_temperature(self, temperature, surface, capacity, time):
        """θ₀ + x with x(t) = x(0) (1 + 3 c x(0)³ t)^(−1/3), the solution of x' = −c x⁴."""
        excess = temperature - self.temperature
        if excess <= 0.0:
            return temperature
        growth = 3.0 * quartic_coefficient(self) * time * excess**3
        return self.temperature + excess * (1.0 + growth) ** (-1.0 / 3.0)

    def euler_step(self, temperature, surface, capacity, step):
        """Return an Euler step held at θ₀, beyond which it would run away."""
        following = temperature - step * cooling_rate(self, temperature, surface, capacity)
        return max(following, min(temperature, self.temperature))

    def rest_temperature(self):
        """θ₀ in K."""
        return self.temperature

    def rate_slope(self, temperature, surface, capacity):
        """4(B/(ρC))(θ − θ₀)³ in 1/s."""
        return 4.0 * quartic_coefficient(self) * (temperature - self.temperature) ** 3


cooling_rate = formula(Cooling, Cooling.cooling_rate)
exact_temperature = formula(Cooling, Cooling.exact_temperature)
euler_step = formula(Cooling, Cooling.euler_step)
rest_temperature = formula(Cooling, Cooling.rest_temperature)
rate_slope = formula(Cooling, Cooling.rate_slope)


def equilibrium_temperature(
    emissivity: float, surroundings: float, convection: float, ambient: float
) -> float:
    """Return the temperature θ_e in K at which radiation and convection balance.

    By bisection to rounding; arguments as the attributes of `RadiativeCooling`.
    """
    low, high = sorted((surroundings, ambient))
    if emissivity == 0.0 or convection == 0.0 or low == high:
        return surroundings if convection == 0.0 else (ambient if emissivity == 0.0 else low)

    def gain(temperature: float) -> float:
        radiated = STEFAN_BOLTZMANN * emissivity * (temperature**4 - surroundings**4)
        return convection * (temperature - ambient) + radiated

    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gain(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


@inlined
def quartic_coefficient(law: Submodel) -> float:
    """B/(ρC) in m/(K³ s), used as if it were 1/(K³ s): the missing length  [A 18]."""
    return STEFAN_BOLTZMANN / (law.density * law.heat_capacity)


@inlined
def relaxation_rate(law: Submodel, distance: float) -> float:
    """−d ln|θ − θ_e|/dt over a_s/(mC), at θ = θ_e + `distance` in K, in W/(m² K).

    By (θ + θ_e)(θ² + θ_e²), the quotient of θ⁴ − θ_e⁴ and θ − θ_e, which does not cancel near θ_e.
    """
    rest = law.equilibrium
    temperature = rest + distance
    radiative = (temperature + rest) * (temperature * temperature + rest * rest)
    return STEFAN_BOLTZMANN * law.emissivity * radiative + law.convection


@inlined
def panel_time(law: Submodel, distance: float, width: float) -> float:
    """Time times a_s/(mC), in m² K/W, in which ln|θ − θ_e| falls by `width` from `distance` in K.

    By 8-point Gauss–Legendre quadrature.
    """
    total = 0.0
    for node, weight in zip(NODES, WEIGHTS):  # noqa: B905
        total += weight / relaxation_rate(law, distance * math.exp(-node * width))
    return total * width


@inlined
def cooled_towards_zero(law: Submodel, temperature: float, remaining: float) -> float:
    """Temperature in K after t·a_s/(mC) = `remaining` where θ_e = 0: θ' ∝ −h_c θ − Bεθ⁴.

    A Bernoulli equation; with h_c = 0 that of a black body in empty space.
    """
    convection = law.convection
    grown = (
        -math.expm1(-3.0 * convection * remaining) / convection
        if convection > 0.0
        else 3.0 * remaining
    )
    radiated = STEFAN_BOLTZMANN * law.emissivity * temperature**3 * grown
    return temperature * math.exp(-convection * remaining) * (1.0 + radiated) ** (-1.0 / 3.0)


@inlined
def panel_width(law: Submodel, distance: float, remaining: float, guess: float) -> float:
    """Width of the panel from `distance` that takes the time `remaining`, by Newton's method."""
    width = guess
    for _ in range(50):
        error = panel_time(law, distance, width) - remaining
        change = error * relaxation_rate(law, distance * math.exp(-width))
        width = min(PANEL, max(0.0, width - change))
        if abs(change) <= 1e-15 * width:
            break
    return width


@inlined
def short_width(law: Submodel, distance: float, rate: float, remaining: float) -> float:
    """Fall of ln|θ − θ_e| in the time `remaining`, where that is short: three terms of its series.

    With the rate k at w = ln of the distance, w falls by kr − kk'r²/2 + k(k'² + kk'')r³/6.
    """
    rest = law.equilibrium
    temperature = rest + distance
    radiated = STEFAN_BOLTZMANN * law.emissivity
    # Derivatives of the rate by the distance, then by its logarithm.
    first = radiated * (3.0 * temperature * temperature + (2.0 * temperature + rest) * rest)
    second = radiated * (6.0 * temperature + 2.0 * rest)
    slope = distance * first
    curvature = slope + distance * distance * second
    cubic = (slope * slope + rate * curvature) * remaining * remaining / 6.0
    return rate * remaining * (1.0 - 0.5 * slope * remaining + cubic)
