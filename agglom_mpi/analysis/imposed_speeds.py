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
from agglom_mpi.analysis.population_balance import Grid, PairRates, solve
from agglom_mpi.errors import UserError
from agglom_mpi.physics.impact_tests import ImpactTests
from agglom_mpi.physics.kinetic_theory import mixture_contact_values
from agglom_mpi.simulation.collision_counts import MASS, NUMBER
from agglom_mpi.simulation.impact import solve_impacts

Floats = npt.NDArray[np.float64]

Speed = Callable[[Floats, Floats], Floats]
"""Root mean square relative speed in m/s of pairs of masses in kg, each shape (pairs,)."""

TIMES: Final = np.geomspace(1e-3, 1.0, 16)
"""Times at which growth is returned, over the last one."""
MARGIN: Final = 100.0
"""Mass at the end of the first grid over that which equal particles reach."""
EDGE_SHARE: Final = 1e-3
"""Largest share of the mass in the last decade of a grid; with more, a longer grid is taken."""
MOST_BINS: Final = 240
"""Largest number of bins of the grid unless samples have more; the equations then take minutes."""


class ImposedGrowth(NamedTuple):
    """Growth at imposed relative speeds; bands are of two errors, the slowest growth first.

    Attributes
    ----------
    times
        Shape (times,), s.
    particles
        Particles left, relative to the start: lower bound of growth, value, bound; (3, times).
    mean_mass
        Σm²/Σm in kg, the mean mass weighted by mass, shape (3, times).
    extrapolated
        Share of the mass in particles larger than any pair with a measured efficiency, (times,).
    barrier
        Mass in kg from which fewer than half of the impacts of equal particles stick; nan where
        there is none.
    efficiency
        Mean collision efficiency of the measured pairs, and the scatter of pairs about it.
    masses, sticking
        Masses in kg, and the share of the impacts of two equal ones that stick, each (bins,).
    """

    times: Floats
    particles: Floats
    mean_mass: Floats
    extrapolated: Floats
    barrier: float
    efficiency: tuple[float, float]
    masses: Floats
    sticking: Floats


def power_law(grain_mass: float, speed: float, exponent: float) -> Speed:
    """Return Δv = v ((r_i + r_j)/2b₀)^p, v = `speed` in m/s, p = `exponent`, b₀ of a grain in kg.

    By p = 1/2 for grains whose stopping time grows with their radius, in turbulence; 1 in shear.
    """

    def imposed(first: Floats, second: Floats) -> Floats:
        radii = np.cbrt(first / grain_mass) + np.cbrt(second / grain_mass)
        return np.asarray(speed * (0.5 * radii) ** exponent)

    return imposed


def require_unbreakable(tests: ImpactTests) -> None:
    """Raise a UserError if particles break, which is not in the equations."""
    if tests.laws.fragmentation is not None:
        message = "is a law by which particles break; must be none where speeds are imposed"
        raise UserError(f"scene.fragmentation: {message}")


def imposed_growth(kernels: CollisionKernels, speed: Speed, until: float) -> ImposedGrowth:
    """Return how the grains of a string grow for a time in s at imposed relative speeds.

    Raises
    ------
    UserError
        If the string has a law of breakage, no pair collided often enough, or particles grow beyond
        the largest grid.
    """
    assert kernels.tests is not None
    require_unbreakable(kernels.tests)
    if not np.isfinite(kernels.rate.value).any():
        raise UserError("no two masses have enough collisions; must be more samples")
    most = max(MOST_BINS, len(kernels.masses))
    longest = kernels.masses[0] * (kernels.masses[1] / kernels.masses[0]) ** np.arange(most)
    speeds, equal = _rates(kernels, np.array([longest, longest]), speed)
    size = max(len(kernels.masses), _size(kernels, longest, speeds * equal, until))
    decade = math.ceil(math.log(10.0) / math.log(longest[1] / longest[0]))
    while True:
        masses, last = longest[:size], slice(size - decade, size)
        numbers, efficiency, largest = _solved(kernels, Grid(masses), speed, until)
        mass = numbers @ masses
        if np.all(numbers[..., last] @ masses[last] <= EDGE_SHARE * mass):
            break
        if size == most:
            raise _beyond(kernels, masses[last][0], until)
        size = min(2 * size, most)
    beyond = slice(largest + 1, None)
    return ImposedGrowth(
        until * TIMES,
        numbers.sum(axis=2) / _start(kernels, len(kernels.masses)).sum(),
        numbers @ masses**2 / mass,
        numbers[1, :, beyond] @ masses[beyond] / mass[1],
        _barrier(longest, equal),
        efficiency,
        longest,
        equal,
    )


def _solved(
    kernels: CollisionKernels, grid: Grid, speed: Speed, until: float
) -> tuple[Floats, tuple[float, float], int]:
    """Return numbers of particles, (3, times, bins), with the efficiencies that they rest on.

    These are the mean and the scatter of those measured, and the largest bin of them.
    """
    of_pairs, error, efficiency, largest = _efficiencies(kernels, grid)
    speeds, sticking = _rates(kernels, grid.masses[grid.pairs], speed)
    rates = [speeds * sticking * (of_pairs + k * error).clip(0.0) for k in (-2.0, 0.0, 2.0)]
    start = _start(kernels, len(grid.masses))
    try:
        numbers = [_numbers(kernels, grid, each, start, until * TIMES) for each in rates]
    except RuntimeError as reason:
        raise UserError(f"until {until:g} s {reason}; must be less time") from None
    return np.array(numbers), efficiency, largest


def _start(kernels: CollisionKernels, bins: int) -> Floats:
    """Return the numbers of particles that a sample begins with, in the bins of a grid."""
    numbers = kernels.sums.start[..., NUMBER].sum(axis=0) / kernels.sums.samples.sum()
    return np.pad(numbers, (0, bins - len(numbers)))


def _beyond(kernels: CollisionKernels, mass: float, until: float) -> UserError:
    """Return the error of particles that grow beyond a mass in kg."""
    grains = f"{mass / kernels.grain_mass:.1e} grains"
    return UserError(f"until {until:g} s particles grow beyond {grains}; must be less time")


def _efficiencies(
    kernels: CollisionKernels, grid: Grid
) -> tuple[Floats, Floats, tuple[float, float], int]:
    """Return efficiencies over all windows and their errors, each (pairs,).

    Last come the mean and the scatter of those measured, which the others get, and the largest bin
    of them.
    """
    value, error = kernels.efficiency
    known = np.isfinite(value)
    weights = np.where(known, kernels.expected, 0.0)
    place = first, second = np.nonzero(weights.sum(axis=0))
    of_windows = np.where(known, [value, error], 0.0) * weights
    whole = weights.sum(axis=0)[place]
    found = of_windows[0].sum(axis=0)[place] / whole
    errors = np.sqrt(np.sum(of_windows[1] ** 2, axis=0))[place] / whole
    mean, of_mean = map(float, kernels.mean_efficiency)
    scatter = math.hypot(of_mean, math.sqrt(np.average((found - mean) ** 2, weights=whole)))
    # Pairs of the grid in a row follow each other, those of the first bin first.
    at = first * len(grid.masses) - first * (first - 1) // 2 + second - first
    values = np.full((2, grid.pairs.shape[1]), [[mean], [scatter]])
    values[:, at] = found, errors
    return values[0], values[1], (mean, scatter), int(second.max())


def _rates(kernels: CollisionKernels, pairs: Floats, speed: Speed) -> tuple[Floats, Floats]:
    """Return mean relative speeds in m/s of pairs of masses, (2, pairs), and shares that stick."""
    first, second = kernels.radii(pairs)
    variance = np.broadcast_to(speed(*pairs), len(first)) ** 2 / 3.0
    assert kernels.tests is not None
    sticking = kernels.tests.maxwellian_sticking(first, second, variance, solve_impacts)
    return np.sqrt(8.0 / math.pi * variance), sticking


def _size(kernels: CollisionKernels, masses: Floats, rates: Floats, until: float) -> int:
    """Return how many of the masses a grid needs, by what equal particles reach, and `MARGIN`.

    `rates` are mean relative speeds in m/s of equal masses, times the share that sticks.
    """
    held = kernels.sums.start[..., MASS].sum() / kernels.sums.samples.sum() / kernels.volume
    with np.errstate(divide="ignore"):  # equal particles: m' = ½Kρ, K of those that stick
        slopes = 2.0 * math.pi * kernels.radii(masses) ** 2 * held * rates
        grain = int(np.searchsorted(masses, kernels.grain_mass))
        ages = np.cumsum(np.diff(masses)[grain:] / slopes[grain:-1])
    reached = grain + int(np.searchsorted(ages, until)) + 2
    margin = math.ceil(math.log(MARGIN) / math.log(masses[1] / masses[0]))
    if reached + margin > len(masses):
        raise _beyond(kernels, masses[-margin], until)
    return reached + margin


def _numbers(
    kernels: CollisionKernels, grid: Grid, rates: Floats, start: Floats, times: Floats
) -> Floats:
    """Return numbers at times in s, shape (times, bins), by mean relative speeds that stick."""
    radii, nothing = kernels.radii(grid.masses), np.zeros((2, len(rates)))
    rates = rates * grid.cross_sections(radii) / kernels.volume
    first, second = grid.pairs

    def law(numbers: Floats, _: Floats) -> PairRates:
        chi = mixture_contact_values(numbers / kernels.volume, 2.0 * radii)[first, second]
        sticking = rates * chi * numbers[first] * numbers[second]
        return PairRates(sticking, nothing, nothing[0], nothing)

    found = [start]
    for duration in np.diff(times, prepend=0.0).tolist():
        found.append(solve(grid, law, found[-1], np.zeros_like(start), duration)[0][:, -1])
    return np.array(found[1:])


def _barrier(masses: Floats, sticking: Floats) -> float:
    """Return the mass in kg at which the sticking of equal particles falls below one half."""
    falls = np.flatnonzero((sticking[:-1] >= 0.5) & (sticking[1:] < 0.5))
    if not len(falls):
        return math.nan
    k = slice(falls[0], falls[0] + 2)
    return float(np.exp(np.interp(-0.5, -sticking[k], np.log(masses[k]))))
