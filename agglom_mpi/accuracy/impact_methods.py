"""Impacts solved by the package's methods: many of them in one compiled loop, timed and counted."""

import math
import statistics
import time
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.impact_reference import Material
from agglom_mpi.kernels import kernel
from agglom_mpi.physics.constants import GAS_CONSTANT
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import (
    ImpactLaws,
    PressureRestitution,
    log_pressure_ratio,
    log_pressure_scale,
    solve_restitution,
)

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
    temperature_i=TEMPERATURE,
    temperature_j=TEMPERATURE,
    normal_i=SPEED,
    normal_j=0.0,
    tangent_i=0.0,
    tangent_j=0.0,
)
"""Equal spheres, head on; X is set by the hardness, which alone differs between the impacts."""

REPEATS: Final = 3


class Solutions(NamedTuple):
    """Solved impacts, arrays of shape (n,): deficit 1 − e, whether it bonds, whether capped."""

    deficit: NDArray[np.float64]
    bonds: NDArray[np.bool_]
    capped: NDArray[np.bool_]


def impact_laws(material: Material, solver: Any) -> ImpactLaws:
    """Laws of a material for `PAIR`; the hardness is filled in by the kernels."""
    energy = material.softening * GAS_CONSTANT * TEMPERATURE
    # Each sphere gets half of ½m*w², and m* is half its mass.
    heated = SPEED**2 / (8.0 * TEMPERATURE)
    return ImpactLaws(
        restitution=PressureRestitution(),
        duration=MeanSpeedDuration(1e-6)
        if material.mean_speed
        else CompressionRecoveryDuration(1.0),
        contact_area=ContactArea(material.initial, 1.0),
        hardness=ArrheniusHardness(1.0, energy),
        friction=None,
        heating=PairSplit(),
        reaction=None,
        fragmentation=None,
        solver=solver,
        heat_capacity=heated / material.rise if material.rise > 0.0 else math.inf,
    )


def hardness_of(material: Material, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """H₀ in Pa at which `PAIR` has these X, shape (n,)."""
    length = (1e-6 if material.mean_speed else 1.0) * RADIUS
    force = PAIR.reduced_mass * SPEED**2 / (2.0 * length)
    hardening = math.exp(material.softening / (1.0 + material.rise))
    return force / (2.0 * math.pi * RADIUS**2) / (hardening * x)


@kernel
def with_hardness(laws, base):
    """Return the same laws with another H₀ in Pa."""
    return ImpactLaws(
        laws.restitution,
        laws.duration,
        laws.contact_area,
        ArrheniusHardness(base, laws.hardness.activation_energy),
        laws.friction,
        laws.heating,
        laws.reaction,
        laws.fragmentation,
        laws.solver,
        laws.heat_capacity,
    )


@kernel
def solve_repeatedly(laws, pair, hardness, repeats, deficit, bonds, capped):
    """Solve the impact of a pair at every H₀ in Pa, `repeats` times over; fills the last three."""
    for _ in range(repeats):
        for i in range(hardness.size):
            own = with_hardness(laws, hardness[i])
            solution = solve_restitution(own.restitution, own, pair)
            deficit[i] = solution.deficit
            bonds[i] = solution.bonds
            capped[i] = solution.capped


@kernel
def iterate_as_published(laws, pair, hardness, deficit, count):
    """Count the iterations of the published method, which the package does not report.

    The same loop as `FixedPointIteration`: e ← G(e) from e = 0  [A 20] [B 6b].
    """
    for i in range(hardness.size):
        own = with_hardness(laws, hardness[i])
        scale = log_pressure_scale(own, pair)
        deficit[i] = 1.0
        count[i] = 0
        if log_pressure_ratio(own, pair, scale, 1.0) >= 0.0:
            continue
        change = math.inf
        while change > laws.solver.tolerance and count[i] < laws.solver.cap:
            log_ratio = log_pressure_ratio(own, pair, scale, deficit[i])
            following = math.exp(log_ratio) if log_ratio < 0.0 else 1.0
            change = abs(following - deficit[i])
            deficit[i] = following
            count[i] += 1


def solve_all(laws: ImpactLaws, hardness: NDArray[np.float64]) -> Solutions:
    """Solve the impact of `PAIR` at every H₀ in Pa, shape (n,)."""
    count = len(hardness)
    found = Solutions(np.empty(count), np.empty(count, np.bool_), np.empty(count, np.bool_))
    solve_repeatedly(laws, PAIR, hardness, 1, *found)
    return found


def published_iterations(laws: ImpactLaws, hardness: NDArray[np.float64]) -> NDArray[np.int64]:
    """Count the iterations of the published method at every H₀ in Pa, shape (n,)."""
    count = np.empty(len(hardness), np.int64)
    iterate_as_published(laws, PAIR, hardness, np.empty(len(hardness)), count)
    return count


def seconds_per_impact(laws: ImpactLaws, hardness: NDArray[np.float64], least: int) -> float:
    """Median time of an impact in s, over loops of at least `least` impacts at these H₀ in Pa."""
    repeats = -(-least // len(hardness))
    found = solve_all(laws, hardness)
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        solve_repeatedly(laws, PAIR, hardness, repeats, *found)
        times.append(time.perf_counter() - begin)
    return statistics.median(times) / (repeats * len(hardness))
