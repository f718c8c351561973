"""Impacts of one pair of spheres solved by any solver, many in one compiled loop, and timed."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.impact_reference import Material
from agglom_mpi.accuracy.run_times import WALL_OVER_CPU, ratio_of_clocks, time_columns
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.physics.constants import GAS_CONSTANT
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import (
    ImpactLaws,
    PressureRestitution,
    solve_restitution,
)
from agglom_mpi.stopwatch import Stopwatch

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
"""Equal spheres, head on; X is set by the hardness, which alone differs between the impacts."""

REPEATS: Final = 3
"""Number of timed loops; the median is reported."""


class Solutions(NamedTuple):
    """Solved impacts, shape (n,): deficit 1 − e, whether they bond, whether they end at the cap."""

    deficit: NDArray[np.float64]
    bonds: NDArray[np.bool_]
    capped: NDArray[np.bool_]


def impact_laws(material: Material, solver: Any) -> ImpactLaws:
    """Return the laws of a material for `PAIR`; the kernels fill in the hardness."""
    energy = material.softening * GAS_CONSTANT * TEMPERATURE
    # Each sphere gets half of ½m*w², and m* is half its mass.
    heated = SPEED**2 / (8.0 * TEMPERATURE)
    return ImpactLaws(
        restitution=PressureRestitution.Numbers(),
        duration=MeanSpeedDuration.Numbers(1e-6)
        if material.mean_speed
        else CompressionRecoveryDuration.Numbers(1.0),
        contact_area=ContactArea.Numbers(material.initial, 1.0),
        hardness=ArrheniusHardness.Numbers(1.0, energy),
        friction=None,
        heating=PairSplit.Numbers(),
        reaction=None,
        fragmentation=None,
        solver=solver,
        heat_capacity=heated / material.rise if material.rise > 0.0 else math.inf,
    )


def hardness_of(material: Material, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return H₀ in Pa at which `PAIR` has these X, shape (n,)."""
    length = (1e-6 if material.mean_speed else 1.0) * RADIUS
    force = PAIR.reduced_mass * SPEED**2 / (2.0 * length)
    hardening = math.exp(material.softening / (1.0 + material.rise))
    return force / (2.0 * math.pi * RADIUS**2) / (hardening * x)


HARDNESS: Final = ArrheniusHardness.Numbers
"""Numbers of the hardness law of all impacts, by a name that kernels know."""


@kernel
def with_hardness(laws, base):
    """Return the same laws with another H₀ in Pa."""
    return ImpactLaws(
        laws.restitution,
        laws.duration,
        laws.contact_area,
        HARDNESS(base, laws.hardness.activation_energy),
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


def solve_all(laws: ImpactLaws, hardness: NDArray[np.float64]) -> Solutions:
    """Solve the impact of `PAIR` at every H₀ in Pa, shape (n,)."""
    count = len(hardness)
    found = Solutions(np.empty(count), np.empty(count, np.bool_), np.empty(count, np.bool_))
    solve_repeatedly(laws, PAIR, hardness, 1, *found)
    return found


def time_of_impact(laws: ImpactLaws, hardness: NDArray[np.float64], least: int) -> dict[str, float]:
    """Return the processor time of an impact as columns, of loops over at least `least` impacts."""
    repeats = -(-least // len(hardness))
    found = solve_all(laws, hardness)
    times = []
    for _ in range(REPEATS):
        stopwatch = Stopwatch()
        solve_repeatedly(laws, PAIR, hardness, repeats, *found)
        times.append(stopwatch.read())
    seconds = np.array([spent.cpu for spent in times]) / (repeats * len(hardness))
    return time_columns("impact", seconds) | {WALL_OVER_CPU: ratio_of_clocks(times)}
