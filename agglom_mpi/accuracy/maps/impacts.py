"""Impacts of one pair of spheres: solved by any solver, timed, and known without the package.

The references are closed forms, and a search by brute force. Everything in them is dimensionless.
`X` is the pressure of a perfectly plastic impact over the one that bonds it, both at the
temperature that such an impact reaches, so that every pair bonds from X = 1. The final contact area
is the cross section of the smaller sphere, a_f = 1.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from agglom_mpi.stopwatch import Stopwatch, TimeSpent

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
"""Equal spheres, head on; X is set by the hardness, which alone differs between the impacts."""

REPEATS: Final = 3
"""Number of timed loops; the median is reported."""


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


def solve_all(laws: ImpactLaws, hardness: NDArray[np.float64], repeats: int = 1) -> tuple[Any, ...]:
    """Solve the impact of `PAIR` at every H₀ in Pa, shape (n,), `repeats` times over.

    Returns
    -------
    tuple
        Deficit 1 − e, whether they bond, and whether they end at the cap, each (n,).
    """
    count = len(hardness)
    found = np.empty(count), np.empty(count, np.bool_), np.empty(count, np.bool_)
    solve_repeatedly(laws, PAIR, hardness, repeats, *found)
    return found


def times_of_impact(laws: ImpactLaws, hardness: NDArray[np.float64], least: int) -> list[TimeSpent]:
    """Return the times in s of an impact, of loops over at least `least` impacts."""
    repeats = -(-least // len(hardness))
    solve_all(laws, hardness)  # compiles
    times = []
    for _ in range(REPEATS):
        stopwatch = Stopwatch()
        solve_all(laws, hardness, repeats)
        wall, cpu = stopwatch.read()
        count = repeats * len(hardness)
        times.append(TimeSpent(wall / count, cpu / count))
    return times
