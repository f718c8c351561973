"""Single impacts and cooling grains: solved as the package does, and known without it.

The references of impacts are closed forms and a search by brute force, all dimensionless.
`X` is the pressure of a perfectly plastic impact over the one that bonds it, both at the
temperature that such an impact reaches, so that every pair bonds from X = 1. The final contact area
is the cross section of the smaller sphere, a_f = 1.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.physics.constants import GAS_CONSTANT
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.physics.cooling import (
    RadiativeCooling,
    cooling_rate,
    euler_step,
    exact_temperature,
    rate_slope,
    rest_temperature,
)
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import (
    ImpactLaws,
    PressureRestitution,
    solve_restitution,
)
from agglom_mpi.simulation.scene import Scene

LOWEST: Final = -60.0
"""Logarithm of the deficit d = 1 − e down to which the brute force looks for roots."""

POINTS: Final = 12_001
"""Points of a scan."""
NEAR: Final = 1e-3
"""A maximum of ln r − ln d this near below zero is scanned finely: two roots may touch there."""


class Material(NamedTuple):
    """Quantities that decide restitution, besides X.

    Attributes
    ----------
    mean_speed : bool
        Duration of the contact by [A 12]; else by [B 4.10].
    initial : float
        a₀, contact area of an elastic impact over the cross section.
    softening : float
        U/(Rθ) before the impact.
    rise : float
        Rise of the temperature by a perfectly plastic impact, over the temperature.
    """

    mean_speed: bool
    initial: float
    softening: float
    rise: float


def exact_deficit(material: Material, x: float) -> float:
    """Return the deficit 1 − e by the smallest root in e; 1 from X = 1 on, where pairs bond."""
    if x >= 1.0:
        return 1.0
    if material.softening * material.rise == 0.0:
        return closed_form(material, x)
    return brute_force(material, x)


def closed_form(material: Material, x: float) -> float:
    """Return the deficit of an impact without softening; for a₀ = 0 that of [B 4.14]."""
    a = material.initial
    if material.mean_speed:
        return 8.0 * x / (a + 4.0 * x + math.sqrt(a * a - 8.0 * a * x + 16.0 * x))
    return 2.0 * x / (a + math.sqrt(a * a + 4.0 * (1.0 - a) * x))


def excess(material: Material, x: float, logarithm: Any) -> Any:
    """Return ln r − ln d at ln d, an array of any precision, frictionless [A 6, 11–17] [B 3–4]."""
    d = np.exp(logarithm)
    area = material.initial + (1.0 - material.initial) * d
    force = (2.0 - d) ** 2 if material.mean_speed else np.ones_like(d)
    warm = 1.0 + material.rise * d * (2.0 - d)
    hardening = material.softening / warm - material.softening / (1.0 + material.rise)
    return np.log(np.longdouble(x)) + np.log(force / area) - hardening - logarithm


def brute_force(material: Material, x: float) -> float:
    """Return the deficit by a dense scan from e = 0 up and bisection, in extended precision."""
    grid = np.linspace(np.longdouble(0.0), np.longdouble(LOWEST), POINTS)
    values = excess(material, x, grid)
    first = int(np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))[0])
    above, below = grid[first], grid[first + 1]
    # Maxima before the crossing that nearly are roots: two may touch there.
    start = values[: first + 1]
    peaks = (start[1:-1] > start[:-2]) & (start[1:-1] >= start[2:]) & (start[1:-1] > -NEAR)
    for k in np.flatnonzero(peaks) + 1:
        fine = np.linspace(grid[k - 1], grid[k + 1], POINTS)
        touching = np.flatnonzero(excess(material, x, fine) >= 0.0)
        if len(touching):
            above, below = fine[touching[0] - 1], fine[touching[0]]
            break
    while (middle := (above + below) / 2) not in (above, below):
        if excess(material, x, middle) < 0.0:
            above = middle
        else:
            below = middle
    return float(np.exp(below))


DENSITY: Final = 5000.0
RADIUS: Final = 1e-3
SPEED: Final = 1.0
TEMPERATURE: Final = 300.0
PAIR: Final = ContactPair(
    approach_speed=SPEED,
    slip_speed=0.0,
    mass_i=DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3,
    mass_j=DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3,
    reduced_mass=DENSITY * 2.0 / 3.0 * math.pi * RADIUS**3,
    radius=RADIUS,
    radius_i=RADIUS,
    radius_j=RADIUS,
    temperature_i=TEMPERATURE,
    temperature_j=TEMPERATURE,
    normal_i=SPEED,
    normal_j=0.0,
    tangent_i=0.0,
    tangent_j=0.0,
)
"""Equal spheres, head on; X is set by the hardness."""


def impact_laws(material: Material, solver: Any, x: float) -> ImpactLaws:
    """Return the laws with which `PAIR` has the X of an impact of a material."""
    energy = material.softening * GAS_CONSTANT * TEMPERATURE
    length = 1e-6 if material.mean_speed else 1.0
    force = PAIR.reduced_mass * SPEED**2 / (2.0 * length * RADIUS)
    hardening = math.exp(material.softening / (1.0 + material.rise))
    hardness = force / (2.0 * math.pi * RADIUS**2) / (hardening * x)
    # Each sphere gets half of ½m*w², and m* is half its mass.
    heated = SPEED**2 / (8.0 * TEMPERATURE)
    duration = MeanSpeedDuration if material.mean_speed else CompressionRecoveryDuration
    return ImpactLaws(
        restitution=PressureRestitution.Numbers(),
        duration=duration.Numbers(length),
        contact_area=ContactArea.Numbers(material.initial, 1.0),
        hardness=ArrheniusHardness.Numbers(hardness, energy),
        friction=None,
        heating=PairSplit.Numbers(),
        reaction=None,
        fragmentation=None,
        solver=solver,
        heat_capacity=heated / material.rise if material.rise > 0.0 else math.inf,
    )


@kernel
def solve_impact(laws, pair):
    """Return the deficit 1 − e of a pair, whether it bonds, and whether it ends at the cap."""
    solution = solve_restitution(laws.restitution, laws, pair)
    return solution.deficit, solution.bonds, solution.capped


EXAMPLE_LAW: Final = RadiativeCooling(emissivity=0.5, surroundings=300.0).build({})
"""Radiation as in [B], where a scene has no cooling."""
EXAMPLE_CAPACITY: Final = 1000.0
"""J/(kg K), where a scene has no heat."""


class Grain(NamedTuple):
    """A grain that cools: law, surface in m², heat capacity in J/K, rest temperature in K."""

    law: Any
    surface: float
    capacity: float
    rest: float


class EulerRun(NamedTuple):
    """Temperature in K after Euler steps; whether any overshot the rest or went below 0 K."""

    temperature: float
    overshoots: bool
    negative: bool


def grain_of(scene: Scene) -> Grain:
    """Return a grain of the scene; [B]'s radiation is the example if the scene has no cooling."""
    capacity = scene.laws.heat_capacity
    specific = capacity if math.isfinite(capacity) else EXAMPLE_CAPACITY
    law = EXAMPLE_LAW if scene.cooling is None else scene.cooling.law
    return Grain(law, 4.0 * math.pi * scene.radius**2, scene.mass * specific, rest_temperature(law))


@kernel
def step_on(law, rest, surface, capacity, temperature, step, steps):
    """Take Euler steps in s; temperature in K, whether one overshot `rest`, went below zero.

    What a step does is judged before the package holds it at the rest of the quartic law, and puts
    what is below zero to zero.
    """
    overshoots = negative = False
    for _ in range(steps):
        free = temperature - step * cooling_rate(law, temperature, surface, capacity)
        overshoots = overshoots or (free - rest) * (temperature - rest) < 0.0
        negative = negative or free < 0.0
        temperature = max(0.0, euler_step(law, temperature, surface, capacity, step))
    return temperature, overshoots, negative


@kernel
def cool_on(law, surface, capacity, temperature, step, steps):
    """Exact temperature in K after `steps` intervals of `step` s each."""
    for _ in range(steps):
        temperature = exact_temperature(law, temperature, surface, capacity, step)
    return temperature


def euler(grain: Grain, temperature: float, step: float, steps: int) -> EulerRun:
    """Take `steps` Euler steps of `step` in s from a temperature in K."""
    law, surface, capacity, rest = grain
    return EulerRun(*step_on(law, rest, surface, capacity, temperature, step, steps))


def exact(grain: Grain, temperature: float, duration: float, intervals: int = 1) -> float:
    """Return the exact temperature in K after a duration in s, taken in equal intervals."""
    step = duration / intervals
    return float(cool_on(grain.law, grain.surface, grain.capacity, temperature, step, intervals))


def linear_limit(grain: Grain, temperature: float) -> float:
    """Return the inverse in s of the slope of the rate with the temperature.

    The linear law of that slope overshoots with any longer Euler step.
    """
    return 1.0 / rate_slope(grain.law, temperature, grain.surface, grain.capacity)
