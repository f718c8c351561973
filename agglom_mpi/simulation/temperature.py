"""Changes of particles' temperatures: cooling exactly or by steps, and heat of impacts.

Every change is entered in the ledger, so that the first law can be checked at the end.
"""

import math

from agglom_mpi.compilation.stages import ANY, dispatch
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling, euler_step, exact_temperature
from agglom_mpi.simulation.particles import FLOORED, UNRESOLVED, record_cooling


@dispatch
def cool_until(cooling, scene, particle, ledger, time):
    """Cool a particle exactly up to `time` in s; does nothing where the scene cools by steps."""


@cool_until.register(None, EulerCooling)
def _no_exact_cooling(cooling, scene, particle, ledger, time):
    return None


@cool_until.register(ExactCooling)
def _cool_exactly(cooling, scene, particle, ledger, time):
    surface = 4.0 * math.pi * particle["radius"] ** 2
    capacity = particle["mass"] * scene.laws.heat_capacity
    before = particle["temperature"]
    elapsed = time - particle["cooled_to"]
    after = exact_temperature(cooling.law, before, surface, capacity, elapsed)
    if after != before:
        record_cooling(ledger, capacity * (before - after))
    particle["temperature"] = after
    particle["cooled_to"] = time


@dispatch
def cool_over_step(cooling, scene, particles, ledger, step):
    """Cool every particle over one step in s; does nothing where the scene cools exactly."""


@cool_over_step.register(None, ExactCooling)
def _no_step_cooling(cooling, scene, particles, ledger, step):
    return None


@cool_over_step.register(EulerCooling)
def _euler_steps(cooling, scene, particles, ledger, step):
    for i in range(particles.size[0]):
        particle = particles.records[i]
        before = particle["temperature"]
        surface = 4.0 * math.pi * particle["radius"] ** 2
        capacity = particle["mass"] * scene.laws.heat_capacity
        after = euler_step(cooling.law, before, surface, capacity, step)
        if after < 0.0:
            ledger.counts[FLOORED] += 1
            after = 0.0
        record_cooling(ledger, capacity * (before - after))
        particle["temperature"] = after


@dispatch
def add_heat(heating, scene, particle, ledger, heat):
    """Give a particle `heat` in J; a temperature below zero is set to zero and counted."""


@add_heat.register(None)
def _no_heat(heating, scene, particle, ledger, heat):
    return None


@add_heat.register(ANY)
def _heat(heating, scene, particle, ledger, heat):
    capacity = particle["mass"] * scene.laws.heat_capacity
    before = particle["temperature"]
    temperature = before + heat / capacity
    # A float64 temperature cannot change by less than its last digit; the ledger keeps the rest.
    ledger.energy[UNRESOLVED] += heat - capacity * (temperature - before)
    if temperature < 0.0:
        ledger.counts[FLOORED] += 1
        temperature = 0.0
    particle["temperature"] = temperature
