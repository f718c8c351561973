"""Cooling of single grains by Euler steps and exactly: many in one compiled loop, timed."""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.physics.cooling import (
    RadiativeCooling,
    cooling_rate,
    euler_step,
    exact_temperature,
    rate_slope,
    rest_temperature,
)
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.stopwatch import Stopwatch, TimeSpent

EXAMPLE_LAW: Final = RadiativeCooling(emissivity=0.5, surroundings=300.0).build({})
"""Radiation as in [B], where a scene has no cooling."""
EXAMPLE_CAPACITY: Final = 1000.0
"""J/(kg K), where a scene has no heat."""
TIMED: Final = 2000
"""Grains of a timed loop."""
REPEATS: Final = 5
"""Number of timed loops; the median and the quartiles are reported."""


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


@kernel
def euler_loop(law, radius, mass, temperature, step, repeats):
    """Take `repeats` Euler steps of every grain, in place, as a stepper does; heat lost in J."""
    lost = 0.0
    for _ in range(repeats):
        for i in range(temperature.size):
            surface, capacity = 4.0 * math.pi * radius[i] ** 2, mass[i]
            after = max(0.0, euler_step(law, temperature[i], surface, capacity, step))
            lost += capacity * (temperature[i] - after)
            temperature[i] = after
    return lost


@kernel
def exact_loop(law, radius, mass, temperature, duration, repeats):
    """Cool every grain exactly for `duration` s, `repeats` times over; heat lost in J."""
    lost = 0.0
    for _ in range(repeats):
        for i in range(temperature.size):
            surface, capacity = 4.0 * math.pi * radius[i] ** 2, mass[i]
            after = exact_temperature(law, temperature[i], surface, capacity, duration)
            lost += capacity * (temperature[i] - after)
    return lost


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


def times_of(loop: Any, grain: Grain, temperature: float, span: float) -> list[TimeSpent]:
    """Return the times in s that `euler_loop` or `exact_loop` takes for one grain and time span."""
    radius = np.full(TIMED, math.sqrt(grain.surface / (4.0 * math.pi)))
    mass, repeats, times = np.full(TIMED, grain.capacity), 10, []
    for _ in range(REPEATS + 1):  # the first one compiles
        temperatures = np.full(TIMED, temperature)
        stopwatch = Stopwatch()
        loop(grain.law, radius, mass, temperatures, span, repeats)
        wall, cpu = stopwatch.read()
        times.append(TimeSpent(wall / (TIMED * repeats), cpu / (TIMED * repeats)))
    return times[1:]
