"""Steady uniform shear of smooth inelastic grains: samples, and what kinetic theory says of them.

Navier–Stokes order with the Enskog coefficients of V. Garzó and J. W. Dufty, Phys. Rev. E 59
(1999) 5895, for which shear is weak: the rate times the mean free time is of the order of √(1 − e).
Beyond that the Enskog equation itself, solved by pairs drawn at random as J. M. Montanero,
V. Garzó, A. Santos and J. J. Brey, J. Fluid Mech. 389 (1999) 391, do: velocities about the flow
alone, which lose a V_y in x with time, collide along directions drawn at random, with the velocity
of the flow between both centres. The unit of length is the diameter σ, of mass that of a grain, of
time 1/a, a the rate of shear.
"""

import math

import numpy as np
from sheared_runs import sheared

from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.particles import DISSIPATED, WORK, new_ledger, new_particles
from agglom_mpi.simulation.sample import place_grains
from agglom_mpi.simulation.sample_kernels import INITIAL, run_engine
from agglom_mpi.simulation.scene import new_engine_state
from agglom_mpi.simulation.trajectory import new_observer, observe_particles

RATE = 100.0


def started(e, fraction, particles, speed, strain):
    """Return a scene of grains in shear, whose speeds about the flow have the width √(3T/m)."""
    size = (6.0 * fraction / math.pi) ** (1.0 / 3.0)
    scene = sheared(RATE, e, particles=particles, size_ratio=size, end_time=strain / RATE)
    velocities = scene.velocities._replace(relative_speed=speed)
    return scene._replace(velocities=velocities, engine=EventDriven.Numbers(10**6))


def history(scene, seed, strains):
    """Return T/(m(aσ)²) of a sample at strains, and what the shear gave and impacts took, in ma²σ².

    Shape (3, n); the two are per grain.
    """
    count, unit = scene.particles, (2.0 * scene.radius * RATE) ** 2
    particles, ledger, never = new_particles(scene, count), new_ledger(), np.zeros(1, np.uint8)
    state, initial = new_engine_state(scene.engine, scene, count), np.zeros(1, INITIAL)
    assert place_grains(scene, np.random.default_rng(seed), particles, never)
    observer, found = new_observer(scene, count), np.empty((3, len(strains)))
    for k, strain in enumerate(strains):
        time = strain / RATE
        assert run_engine(scene, particles, ledger, state, initial, time, never) >= time
        observe_particles(scene, particles, state, observer, time)
        velocity = observer.copy.velocity.copy()
        velocity[0] -= RATE * observer.copy.position[1]
        velocity -= velocity.mean(axis=1, keepdims=True)
        energies = ledger.energy[WORK], ledger.energy[DISSIPATED]
        found[0, k] = np.mean(velocity**2) / unit
        found[1:, k] = np.array(energies) / (scene.mass * unit * count)
    return found


def steady_state(e, fraction, particles, seed, strains=(15.0, 75.0)):
    """Return T/(m(aσ)²) and −P_xy/(ma²/σ) of a sample; the stress by what impacts take."""
    temperature, _ = navier_stokes(e, fraction)
    scene = started(e, fraction, particles, 1.0, strains[1] * 1.001)
    speed = math.sqrt(3.0 * temperature) * 2.0 * scene.radius * RATE
    scene = started(e, fraction, particles, speed, strains[1] * 1.001)
    found = history(scene, seed, np.linspace(*strains, 100))
    loss = (found[2, -1] - found[2, 0]) / (strains[1] - strains[0])
    return found[0].mean(), 6.0 * fraction / math.pi * loss


def contact_value(fraction):
    """Pair correlation at contact by Carnahan and Starling."""
    return (1.0 - 0.5 * fraction) / (1.0 - fraction) ** 3


def coefficients(e, fraction):
    """Return η/η₀ and ζ/ν₀ of Garzó and Dufty; η₀ = 5√(mT/π)/(16σ²) and ν₀ = nT/η₀."""
    chi = contact_value(fraction)
    dense = fraction * chi * (1.0 + e)
    kurtosis = 32.0 * (1.0 - e) * (1.0 - 2.0 * e * e) / (81.0 - 17.0 * e + 30.0 * e * e * (1.0 - e))
    frequency = chi * (1.0 - 0.25 * (1.0 - e) ** 2) * (1.0 - kurtosis / 64.0)
    cooling = 5.0 / 12.0 * chi * (1.0 - e * e) * (1.0 + 3.0 * kurtosis / 32.0)
    bulk = 128.0 / (5.0 * math.pi) * fraction * dense * (1.0 - kurtosis / 32.0)
    kinetic = (1.0 - 0.4 * dense * (1.0 - 3.0 * e)) / (frequency - 0.5 * cooling)
    return kinetic * (1.0 + 0.8 * dense) + 0.6 * bulk, cooling


def navier_stokes(e, fraction):
    """Return T/(m(aσ)²) and −P_xy/(m a² /σ) of the steady state, where ηa² = (3/2)nTζ."""
    viscosity, cooling = coefficients(e, fraction)
    density = 6.0 * fraction / math.pi
    frequency = math.sqrt(viscosity / (1.5 * cooling))  # ν₀/a
    speed = frequency / (3.2 * math.sqrt(math.pi) * density)  # √(T/m)
    return speed**2, viscosity * 0.3125 * speed / math.sqrt(math.pi)


def enskog(e, fraction, seed, count=2000, strains=(10.0, 40.0)):
    """Return the same of the Enskog equation, by `count` velocities over strains after a first one.

    A pair at a direction drawn at random collides with the probability w/w_most, w = 4πnχ(g·k).
    """
    random = np.random.default_rng(seed)
    density, chi = 6.0 * fraction / math.pi, contact_value(fraction)
    temperature, _ = navier_stokes(e, fraction)
    velocity = math.sqrt(temperature) * random.normal(size=(count, 3))
    per_time = 4.0 * density * chi * math.sqrt(math.pi * temperature)
    step, time, loss, taken = 0.02 / per_time, 0.0, 0.0, []
    most = 4.0 * math.pi * density * chi * 8.0 * math.sqrt(temperature)
    while time < sum(strains):
        velocity[:, 0] -= step * velocity[:, 1]
        time += step
        pairs = random.permutation(count)[: 2 * random.binomial(count // 2, most * step)]
        i, j = pairs[0::2], pairs[1::2]
        normal = random.normal(size=(len(i), 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        relative = velocity[i] - velocity[j]
        relative[:, 0] -= normal[:, 1]
        approach = np.einsum("ij,ij->i", relative, normal)
        chosen = 4.0 * math.pi * density * chi * approach > most * random.random(len(i))
        impulse = (0.5 * (1.0 + e) * approach[chosen])[:, None] * normal[chosen]
        velocity[i[chosen]] -= impulse
        velocity[j[chosen]] += impulse
        velocity -= velocity.mean(axis=0)
        if time > strains[0]:
            loss += 0.25 * (1.0 - e * e) * np.sum(approach[chosen] ** 2)
            taken.append(np.mean(velocity**2))
    return float(np.mean(taken)), density * loss / count / strains[1]
