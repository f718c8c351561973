"""Outputs of a box for a macroscopic model: the homogenised state and the particles  [B 9]."""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.outcome import same_values
from agglom_mpi.simulation.particles import (
    BREAKUPS,
    CAPPED,
    COLLISIONS,
    DISSIPATED,
    FLOORED,
    MERGES,
    RADIATED,
    REACTION,
    SURFACE,
    Ledger,
)
from agglom_mpi.simulation.scene import Scene


class State(NamedTuple):
    """A box averaged over its volume; rates and counts are those of the last step.

    The kinetic energy per volume is that of the mean flow plus 3/2 · mass_density ·
    granular_temperature; the latter falls by the dissipation rate. With the heating `pair_split`
    the thermal energy per volume, mass_density · heat capacity · mean_temperature, rises by
    dissipation + heat release − cooling − surface energy rate. Rough grains start without spin, and
    impacts exchange energy with their rotation, which is in none of these.

    Attributes
    ----------
    time : float
        Since the box was made or reset, s.
    particles : int
        Number of particles.
    mean_radius, radius_deviation : float
        Mean and standard deviation (about the mean, over n) of the radii, m.
    mass_density : float
        kg/m³ of the box, not of the grains.
    momentum_density : array, shape (3,)
        kg/(m² s); over the mass density it is the velocity of the mean flow.
    granular_temperature : float
        A third of the mean squared velocity about that of the mean flow, by mass:
        Σ m|v − V|²/(3 Σ m), m²/s².
    mean_temperature : float
        By mass, K; nan where neither the scene nor the inputs have a temperature.
    dissipation_rate : float
        Kinetic energy that impacts dissipated, W/m³.
    heat_release_rate : float
        Heat of reaction, W/m³.
    cooling_rate : float
        Heat radiated and convected to the surroundings, W/m³.
    surface_energy_rate : float
        Energy that went into new surface, W/m³.
    collisions, merges, breakups : int
        Impacts, merges included; those that bonded; aggregates that broke.
    capped_iterations, floored_temperatures : int
        Impacts whose solver ended at its cap; temperatures that a heating law sent below zero.
    """

    time: float
    particles: int
    mean_radius: float
    radius_deviation: float
    mass_density: float
    momentum_density: npt.NDArray[np.float64]
    granular_temperature: float
    mean_temperature: float
    dissipation_rate: float
    heat_release_rate: float
    cooling_rate: float
    surface_energy_rate: float
    collisions: int
    merges: int
    breakups: int
    capped_iterations: int
    floored_temperatures: int

    def __eq__(self, other: object) -> bool:
        return same_values(self, other)

    def __ne__(self, other: object) -> bool:
        return not same_values(self, other)


class BoxParticles(NamedTuple):
    """The n particles of a box in SI units; copies, free to be changed.

    Attributes
    ----------
    positions, velocities : array, shape (n, 3), m and m/s
        In the box, −D ≤ r ≤ D; in its frame of reference.
    radii, masses, temperatures : array, shape (n,), m, kg and K
    grains : array of int64, shape (n,)
        Grains in each.
    labels : array of int64, shape (n,)
        Identities: 0 … n−1 in the order of the inputs. An aggregate keeps the label of one of the
        two that bonded; pieces that break off get new labels.
    """

    positions: npt.NDArray[np.float64]
    velocities: npt.NDArray[np.float64]
    radii: npt.NDArray[np.float64]
    masses: npt.NDArray[np.float64]
    temperatures: npt.NDArray[np.float64]
    grains: npt.NDArray[np.int64]
    labels: npt.NDArray[np.int64]

    def __eq__(self, other: object) -> bool:
        return same_values(self, other)

    def __ne__(self, other: object) -> bool:
        return not same_values(self, other)


def homogenise(
    scene: Scene,
    observation: Any,
    ledger: Ledger,
    pending: float,
    volume: float,
    time: float,
    step: float,
) -> State:
    """Return the homogenised state of a box.

    Parameters
    ----------
    scene
        The scene of the box.
    observation
        A record of `OBSERVATION`.
    ledger
        Energies and counts of the last step.
    pending
        Heat in J that was radiated before this step and was in no ledger then.
    volume, time, step
        Volume of the box in m³, time since its beginning in s, length of the last step in s, 0
        without one.
    """
    per = 1.0 / (volume * step) if step > 0.0 else 0.0
    energy, counts = (values.tolist() for values in (ledger.energy, ledger.counts))
    mass, temperature = float(observation["mass"]), float(observation["temperature"])
    if temperature == 0.0 and not scene.has_temperature:
        temperature = math.nan
    return State(
        time=time,
        particles=int(observation["particles"]),
        mean_radius=float(observation["mean_radius"]),
        radius_deviation=math.sqrt(observation["radius_variance"]),
        mass_density=mass / volume,
        momentum_density=np.array([observation["x"], observation["y"], observation["z"]]) / volume,
        granular_temperature=2.0 * float(observation["fluctuation"]) / (3.0 * mass),
        mean_temperature=temperature,
        dissipation_rate=energy[DISSIPATED] * per,
        heat_release_rate=energy[REACTION] * per,
        cooling_rate=(energy[RADIATED] + float(observation["pending"]) - pending) * per,
        surface_energy_rate=energy[SURFACE] * per,
        collisions=counts[COLLISIONS],
        merges=counts[MERGES],
        breakups=counts[BREAKUPS],
        capped_iterations=counts[CAPPED],
        floored_temperatures=counts[FLOORED],
    )


def particles_of(particles: Any) -> BoxParticles:
    """Return copies of kernels' `Particles`, which must have no gaps, as a `BoxParticles`."""
    left = int(particles.size[0])
    return BoxParticles(
        positions=particles.position[:, :left].T.copy(),
        velocities=particles.velocity[:, :left].T.copy(),
        radii=particles.radius[:left].copy(),
        masses=particles.mass[:left].copy(),
        temperatures=particles.temperature[:left].copy(),
        grains=np.array(particles.grains[:left]),
        labels=np.array(particles.label[:left]),
    )
