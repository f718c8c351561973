"""Cooling of a grain between impacts: the laws, their exact solutions and published Euler steps.

A temperature does not depend on how the grain moves, so each can be integrated on its own.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import Submodel, dispatch, inlined
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


class RadiativeCooling(NamedTuple):
    """m C θ' = −h_c a_s(θ − θ_o) − B ε a_s(θ⁴ − θ_s⁴), a_s = 4πb²  [B 6.19–6.20].

    Attributes
    ----------
    emissivity
        ε.
    surroundings
        θ_s that it radiates to, K.
    convection
        h_c, W/(m² K).
    ambient
        θ_o of the gas, K.
    equilibrium
        θ_e where the right side vanishes, K; `equilibrium_temperature` computes it.
    """

    emissivity: float
    surroundings: float
    convection: float
    ambient: float
    equilibrium: float


class QuarticCooling(NamedTuple):
    """θ' = −(B/(ρC))(θ − θ₀)⁴ above the starting temperature θ₀, nothing below  [A 18].

    As published, with its fault: a length is missing, so the numbers mean nothing outside SI.
    `density` ρ in kg/m³, `heat_capacity` C in J/(kg K), `start` θ₀ in K.
    """

    density: float
    heat_capacity: float
    start: float


class EulerCooling(NamedTuple):
    """One explicit Euler step of a law per time step, as published  [A 19] [B 6.21].

    It may oscillate about the surroundings and go below zero. The quartic law is held at θ₀, which
    the exact solution never crosses and beyond which an Euler step runs away.
    """

    law: Submodel


class ExactCooling(NamedTuple):
    """The exact solution of a law, applied to a particle only when its temperature is needed."""

    law: Submodel


@dispatch
def cooling_rate(law: Submodel, temperature: float, surface: float, capacity: float) -> float:
    """−θ' in K/s at `temperature` in K; `surface` 4πb² in m², `capacity` mC in J/K."""


@dispatch
def exact_temperature(
    law: Submodel, temperature: float, surface: float, capacity: float, time: float
) -> float:
    """Exact temperature in K after `time` in s; other arguments as for `cooling_rate`."""


@dispatch
def euler_step(
    law: Submodel, temperature: float, surface: float, capacity: float, step: float
) -> float:
    """Temperature in K after one explicit Euler step of `step` in s  [A 19] [B 6.21]."""


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


@cooling_rate.register(RadiativeCooling)
def _radiative_rate(law, temperature, surface, capacity):
    radiated = STEFAN_BOLTZMANN * law.emissivity * (temperature**4 - law.surroundings**4)
    return surface / capacity * (radiated + law.convection * (temperature - law.ambient))


@cooling_rate.register(QuarticCooling)
def _quartic_rate(law, temperature, surface, capacity):
    excess = max(0.0, temperature - law.start)
    return quartic_coefficient(law) * excess**4


@inlined
def quartic_coefficient(law: QuarticCooling) -> float:
    """B/(ρC) in m/(K³ s), used as if it were 1/(K³ s): the missing length  [A 18]."""
    return STEFAN_BOLTZMANN / (law.density * law.heat_capacity)


@inlined
def relaxation_rate(law: RadiativeCooling, distance: float) -> float:
    """−d ln|θ − θ_e|/dt over a_s/(mC), at θ = θ_e + `distance` in K, in W/(m² K).

    By (θ + θ_e)(θ² + θ_e²), the quotient of θ⁴ − θ_e⁴ and θ − θ_e, which does not cancel near θ_e.
    """
    rest = law.equilibrium
    temperature = rest + distance
    radiative = (temperature + rest) * (temperature * temperature + rest * rest)
    return STEFAN_BOLTZMANN * law.emissivity * radiative + law.convection


@inlined
def panel_time(law: RadiativeCooling, distance: float, width: float) -> float:
    """Time times a_s/(mC), in m² K/W, in which ln|θ − θ_e| falls by `width` from `distance` in K.

    By 8-point Gauss–Legendre quadrature.
    """
    total = 0.0
    for node, weight in zip(NODES, WEIGHTS):  # noqa: B905
        total += weight / relaxation_rate(law, distance * math.exp(-node * width))
    return total * width


@inlined
def cooled_towards_zero(law: RadiativeCooling, temperature: float, remaining: float) -> float:
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
def panel_width(law: RadiativeCooling, distance: float, remaining: float, guess: float) -> float:
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
def short_width(law: RadiativeCooling, distance: float, rate: float, remaining: float) -> float:
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


@exact_temperature.register(RadiativeCooling)
def _radiative_exact(law, temperature, surface, capacity, time):
    # ln|θ − θ_e| falls smoothly: the time is its integral over the rate, panel by panel.
    remaining = time * surface / capacity
    start = temperature - law.equilibrium
    if remaining <= 0.0 or start == 0.0:
        return temperature
    rate = relaxation_rate(law, start)
    if rate * remaining <= SHORT and abs(start) <= temperature:
        return temperature + start * math.expm1(-short_width(law, start, rate, remaining))
    if law.equilibrium <= COLDEST or relaxation_rate(law, min(start, 0.0)) == 0.0:
        return cooled_towards_zero(law, temperature, remaining)
    distance = start
    taken = panel_time(law, distance, PANEL)
    while taken < remaining:
        remaining -= taken
        distance *= math.exp(-PANEL)
        if abs(distance) <= 1e-17 * law.equilibrium:
            return law.equilibrium
        taken = panel_time(law, distance, PANEL)
    width = panel_width(law, distance, remaining, PANEL * remaining / taken)
    if distance == start:  # counted from where it was, which may be far nearer to zero
        return temperature + start * math.expm1(-width)
    return law.equilibrium + distance * math.exp(-width)


@exact_temperature.register(QuarticCooling)
def _quartic_exact(law, temperature, surface, capacity, time):
    excess = temperature - law.start
    if excess <= 0.0:
        return temperature
    # x' = −c x⁴ is solved by x(0) (1 + 3 c x(0)³ t)^(−1/3).
    growth = 3.0 * quartic_coefficient(law) * time * excess**3
    return law.start + excess * (1.0 + growth) ** (-1.0 / 3.0)


@euler_step.register(RadiativeCooling)
def _radiative_euler(law, temperature, surface, capacity, step):
    return temperature - step * cooling_rate(law, temperature, surface, capacity)


@euler_step.register(QuarticCooling)
def _quartic_euler(law, temperature, surface, capacity, step):
    following = temperature - step * cooling_rate(law, temperature, surface, capacity)
    return max(following, min(temperature, law.start))
