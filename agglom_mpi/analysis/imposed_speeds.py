"""Growth where relative speeds are imposed, as by a turbulent gas or a mixer: where dust stops.

A gas of grains that stick cools, so that larger ones are slower and go on to stick. Where something
else moves them, their relative speeds are known: Smoluchowski's equations take them instead of
granular temperatures. Relative velocities of a pair are Maxwellian with a root mean square
Δv(m_i, m_j). Its rate is that of kinetic theory, times the collision efficiency that samples have,
times the probability by which the law bonds it at these speeds.

Samples have efficiencies of few masses. All other pairs get the mean of those measured, and the
scatter of pairs about it as its error: an extrapolation, whose band is that of two standard errors.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.analysis.collision_kernels import CollisionKernels
from agglom_mpi.analysis.population_balance import Grid, Law, PairRates, solve
from agglom_mpi.errors import FAILURE, UserError
from agglom_mpi.physics.impact_tests import ImpactTests
from agglom_mpi.physics.kinetic_theory import mixture_contact_values
from agglom_mpi.simulation.collision_counts import MASS, NUMBER
from agglom_mpi.simulation.impact import solve_impacts

Floats = npt.NDArray[np.float64]

Speed = Callable[[Floats, Floats], Floats]
"""Root mean square relative speed in m/s of pairs of masses in kg, each shape (pairs,)."""

TIMES: Final = 16
"""Times at which growth is returned."""

FIRST: Final = 1e-3
"""First of them, over the last one."""

MARGIN: Final = 100.0
"""Mass at the end of the grid over that which equal particles reach."""

MOST_BINS: Final = 240
"""Largest number of bins of the grid, on which the equations take some minutes."""


class GrowthError(UserError, RuntimeError):
    """Growth that cannot be computed."""

    exit_code = FAILURE


class ImposedGrowth(NamedTuple):
    """Growth at imposed relative speeds, with its band: lower bound, value, upper bound.

    Attributes
    ----------
    times
        Shape (times,), s.
    particles
        Particles left, relative to the start, shape (3, times); the upper bound grows least.
    mean_mass
        Σm²/Σm, the mean mass weighted by mass, shape (3, times), kg.
    extrapolated
        Share of the mass in particles larger than any pair with a measured efficiency, (times,).
    masses, sticking
        Masses of the grid in kg, and the probability that two equal particles stick, (bins,).
    barrier
        Mass in kg from which fewer than half of the impacts of equal particles stick; nan where
        there is none.
    efficiency
        Mean collision efficiency of the measured pairs, and the scatter of pairs about it.
    """

    times: Floats
    particles: Floats
    mean_mass: Floats
    extrapolated: Floats
    masses: Floats
    sticking: Floats
    barrier: float
    efficiency: tuple[float, float]


def power_law(kernels: CollisionKernels, speed: float, exponent: float) -> Speed:
    """Return Δv = v ((r_i + r_j)/2b₀)^p with v = `speed` in m/s, p = `exponent`, b₀ of a grain.

    By p = 1/2 for grains whose stopping time grows with their radius, in turbulence; 1 in shear.
    """

    def imposed(first: Floats, second: Floats) -> Floats:
        radii = np.cbrt(first / kernels.grain_mass) + np.cbrt(second / kernels.grain_mass)
        return np.asarray(speed * (0.5 * radii) ** exponent)

    return imposed


def require_unbreakable(tests: ImpactTests) -> None:
    """Raise a GrowthError if particles break, which is not in the equations."""
    if tests.laws.fragmentation is not None:
        message = "is a law by which particles break; must be none where speeds are imposed"
        raise GrowthError(f"scene.fragmentation: {message}")


def imposed_growth(kernels: CollisionKernels, speed: Speed, until: float) -> ImposedGrowth:
    """Return how the grains of a string grow where relative speeds are imposed.

    Parameters
    ----------
    kernels
        From `campaign.collision_kernels`.
    speed
        Root mean square relative speed of two masses.
    until
        Time in s.

    Raises
    ------
    GrowthError
        If the string has a law of breakage, which is not in the equations, no pair collided often
        enough, or particles grow beyond the largest grid.
    """
    assert kernels.tests is not None
    require_unbreakable(kernels.tests)
    longest = kernels.masses[0] * (kernels.masses[1] / kernels.masses[0]) ** np.arange(MOST_BINS)
    speeds, equal = _rates(kernels, np.array([longest, longest]), speed)
    bins, size = len(kernels.masses), _size(kernels, longest, speeds * equal, until)
    masses = longest[: max(bins, size)]
    grid = Grid(masses)
    of_pairs, error, efficiency, largest = _efficiencies(kernels, grid)
    speeds, sticking = _rates(kernels, masses[grid.pairs], speed)
    start = np.zeros(len(masses))
    start[:bins] = kernels.sums.start[..., NUMBER].sum(axis=0) / kernels.sums.samples.sum()
    times = np.geomspace(FIRST * until, until, TIMES)
    rates = [speeds * sticking * (of_pairs + k * error).clip(0.0) for k in (-2.0, 0.0, 2.0)]
    numbers = np.array([_numbers(grid, _law(kernels, grid, k), start, times) for k in rates])
    mass = numbers @ masses
    return ImposedGrowth(
        times,
        numbers.sum(axis=2) / start.sum(),
        numbers @ masses**2 / mass,
        numbers[1, :, largest + 1 :] @ masses[largest + 1 :] / mass[1],
        longest,
        equal,
        _barrier(longest, equal),
        efficiency,
    )


def _efficiencies(
    kernels: CollisionKernels, grid: Grid
) -> tuple[Floats, Floats, tuple[float, float], int]:
    """Return efficiencies over all windows.

    Returns
    -------
    tuple
        Of each pair with its error, (pairs,); the mean and the scatter of those measured, which
        the others get; the largest bin of a pair with a measured one.
    """
    value, error = kernels.efficiency
    known = np.isfinite(value)
    if not known.any():
        raise GrowthError("no two masses have enough collisions; simulate more samples")
    hits = np.where(known, kernels.hits, 0.0)
    expected = np.divide(hits, value, out=np.zeros_like(hits), where=known)
    errors = np.sqrt(np.sum(np.where(known, expected * error, 0.0) ** 2, axis=0))
    hits, expected = hits.sum(axis=0), expected.sum(axis=0)
    mean = hits.sum() / expected.sum()
    place = first, second = np.nonzero(expected)
    found, error = hits[place] / expected[place], errors[place] / expected[place]
    scatter = math.sqrt(np.average((found - mean) ** 2, weights=expected[place]))
    # Pairs of the grid in a row follow each other, those of the first bin first.
    at = first * len(grid.masses) - first * (first - 1) // 2 + second - first
    values = np.full((2, grid.pairs.shape[1]), [[mean], [scatter]])
    values[:, at] = found, error
    return values[0], values[1], (float(mean), scatter), int(second.max())


def _rates(kernels: CollisionKernels, pairs: Floats, speed: Speed) -> tuple[Floats, Floats]:
    """Return mean relative speeds in m/s of pairs of masses, (2, pairs), and sticking shares."""
    radii = np.cbrt(3.0 * pairs / (4.0 * math.pi * kernels.density))
    variance = np.broadcast_to(speed(*pairs), len(pairs[0])) ** 2 / 3.0
    assert kernels.tests is not None
    sticking = kernels.tests.maxwellian_sticking(radii[0], radii[1], variance, solve_impacts)
    return np.sqrt(8.0 / math.pi * variance), sticking


def _size(kernels: CollisionKernels, masses: Floats, rates: Floats, until: float) -> int:
    """Return how many of the masses a grid needs, by what equal particles reach, and `MARGIN`.

    `rates` are mean relative speeds in m/s of equal masses, times the share that sticks.
    """
    step = masses[1] / masses[0]
    radii = np.cbrt(3.0 * masses / (4.0 * math.pi * kernels.density))
    held = kernels.sums.start[..., MASS].sum() / kernels.sums.samples.sum() / kernels.volume
    with np.errstate(divide="ignore"):  # the mass m of n grows as m' = ½Knm P
        ages = np.cumsum(np.diff(masses) / (2.0 * math.pi * radii**2 * held * rates)[:-1])
    grain = int(np.searchsorted(masses, kernels.grain_mass))
    reached = int(np.searchsorted(ages, until + ages[grain])) + 1
    margin = math.ceil(math.log(MARGIN) / math.log(step))
    if reached + margin > MOST_BINS:
        grains = masses[-margin] / kernels.grain_mass
        raise GrowthError(
            f"particles grow beyond {grains:.1e} grains until {until:g} s; choose less time, or "
            "fewer bins a decade"
        )
    return reached + margin


def _law(kernels: CollisionKernels, grid: Grid, rates: Floats) -> Law:
    """Return the law of pairs that stick at mean relative speeds in m/s, (pairs,)."""
    radii = np.cbrt(3.0 * grid.masses / (4.0 * math.pi * kernels.density))
    first, second = grid.pairs
    rates = rates * grid.cross_sections(radii) / kernels.volume
    nothing = np.zeros((2, len(rates)))

    def law(numbers: Floats, _: Floats) -> PairRates:
        chi = mixture_contact_values(numbers / kernels.volume, 2.0 * radii)[first, second]
        sticking = rates * chi * numbers[first] * numbers[second]
        return PairRates(sticking, nothing, nothing[0], nothing)

    return law


def _numbers(grid: Grid, law: Law, start: Floats, times: Floats) -> Floats:
    """Return the numbers of particles at the times in s, shape (times, bins)."""
    found, nothing = [start], np.zeros_like(start)
    for duration in np.diff(times, prepend=0.0).tolist():
        found.append(solve(grid, law, found[-1], nothing, duration)[0][:, -1])
    return np.array(found[1:])


def _barrier(masses: Floats, sticking: Floats) -> float:
    """Return the mass in kg at which the sticking of equal particles falls below one half."""
    falls = np.flatnonzero((sticking[:-1] >= 0.5) & (sticking[1:] < 0.5))
    if not len(falls):
        return math.nan
    k = slice(falls[0], falls[0] + 2)
    return float(np.exp(np.interp(-0.5, -sticking[k], np.log(masses[k]))))
