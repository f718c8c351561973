"""The temperature-dependent Smoluchowski equations: numbers and energies of sizes that stick.

In a gas that cools and sticks each size has a granular temperature of its own, on which its rates
depend, so numbers alone are not closed [OB]. The equations are those of both on a geometric grid of
masses; a pair that sticks is shared between the two masses of the grid around it, which conserves
number, mass and energy [KR]. Velocities of each size are taken as Maxwellian.

[OB] A. I. Osinsky and N. V. Brilliantov, arXiv:2110.00465 (2021).
[KR] S. Kumar and D. Ramkrishna, Chem. Eng. Sci. 51 (1996) 1311: the fixed pivot.
"""

import itertools
import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from agglom_mpi.physics.kinetic_theory import mixture_contact_values

Floats = npt.NDArray[np.float64]

POINTS: Final = 65
"""Points of a window between which means over it are taken."""

TOLERANCE: Final = 1e-7
"""Of the integration, relative, and absolute over what there is at the start."""

MAX_EVALUATIONS: Final = 20_000
"""Maximum number of evaluations of the rates in a window; more have no end."""


class PairRates(NamedTuple):
    """Rates of the pairs, and energies in them, each shape (pairs,) in the order of `Grid`.

    Attributes
    ----------
    sticking
        Pairs that stick in a second, in the box.
    taken
        Mean energies in J that both bring along, shape (2, pairs).
    made
        Mean energy in J of what they become.
    gained
        Energies in W that both sizes gain by impacts after which they part, shape (2, pairs).
    """

    sticking: Floats
    taken: Floats
    made: Floats
    gained: Floats


class Grid:
    """Masses of a grid, the pairs of them, and where a pair goes that sticks.

    Attributes
    ----------
    masses
        Ascending, shape (bins,), kg.
    pairs
        Places of both masses of each pair, the first not above the second, shape (2, pairs).
    """

    def __init__(self, masses: Floats) -> None:
        self.masses = masses
        self.pairs = np.array(np.triu_indices(len(masses)))
        joint = masses[self.pairs].sum(axis=0)
        above = np.searchsorted(masses, joint).clip(1, len(masses) - 1)
        beyond = joint > masses[-1]
        share = (joint - masses[above - 1]) / (masses[above] - masses[above - 1])
        share = np.where(beyond, 1.0, share)
        # Beyond the grid mass is conserved, and number is not.
        number = np.where(beyond, joint / masses[-1], share)
        # Where a pair goes, and the parts of its number and its energy that do.
        self._sides = (above - 1, 1.0 - share, 1.0 - share), (above, number, share)

    def cross_sections(self, radii: Floats) -> Floats:
        """Return π(r_i + r_j)² of the pairs in m², half of it in a bin; radii in m, (bins,)."""
        first, second = self.pairs
        whole = math.pi * (radii[first] + radii[second]) ** 2
        return np.asarray(whole * np.where(first == second, 0.5, 1.0))

    def change(self, rates: PairRates) -> tuple[Floats, Floats]:
        """Return the changes of numbers, (bins,), in 1/s and of energies, (bins,), in W."""
        first, second = self.pairs
        sticking, taken, made, gained = rates
        bins = len(self.masses)

        def summed(places: npt.NDArray[np.int64], values: Floats) -> Floats:
            return np.asarray(np.bincount(places, values, bins), np.float64)

        numbers = -summed(first, sticking) - summed(second, sticking)
        energies = summed(first, gained[0] - sticking * taken[0])
        energies += summed(second, gained[1] - sticking * taken[1])
        for place, number, share in self._sides:
            numbers += summed(place, number * sticking)
            energies += summed(place, share * sticking * made)
        return numbers, energies


Law = Callable[[Floats, Floats], PairRates]
"""Returns rates for numbers and energies in J in the box, (bins,)."""


def solve(
    grid: Grid, law: Law, numbers: Floats, energies: Floats, duration: float
) -> tuple[Floats, Floats]:
    """Return numbers and energies in J at even times from 0 to `duration` in s, (bins, times).

    Parameters
    ----------
    grid
    law
        Rates of the pairs.
    numbers, energies
        At the start, shape (bins,).
    duration
        In s.

    Raises
    ------
    RuntimeError
        If the integration fails.
    """
    bins, most, whole = len(grid.masses), numbers.sum(), energies.sum() or 1.0

    evaluations = itertools.count()

    def derivative(_: float, state: Floats) -> Floats:
        if next(evaluations) > MAX_EVALUATIONS:
            raise RuntimeError("the population balance cannot be integrated in reasonable time")
        present, energy = state[:bins].clip(0.0) * most, state[bins:].clip(0.0) * whole
        changed = grid.change(law(present, energy))
        return np.concatenate((changed[0] / most, changed[1] / whole))

    begun = np.concatenate((numbers / most, energies / whole))
    times = np.linspace(0.0, duration, POINTS)
    found = solve_ivp(
        derivative,
        (0.0, duration),
        begun,
        method="LSODA",
        t_eval=times,
        rtol=TOLERANCE,
        atol=TOLERANCE * 1e-3,
    )
    if not found.success:
        raise RuntimeError(f"the population balance cannot be integrated: {found.message}")
    return found.y[:bins] * most, found.y[bins:] * whole


class Impacts(NamedTuple):
    """Measured properties of the impacts of pairs, each shape (pairs,).

    Attributes
    ----------
    efficiency
        Rate over that of Maxwellian gases in Enskog's approximation.
    sticking
        Share of the impacts that stick.
    normal
        Mean square of the normal speed of the others over T_i/m_i + T_j/m_j.
    relative
        Mean square of the relative speed of those that stick over the same.
    restitution
        Coefficient of restitution that gives the energy which the others lose.
    """

    efficiency: Floats
    sticking: Floats
    normal: Floats
    relative: Floats
    restitution: Floats


def maxwellian_law(grid: Grid, impacts: Impacts, density: float, volume: float) -> Law:
    """Return the rates of pairs whose velocities are Maxwellian, with measured impacts.

    Parameters
    ----------
    grid, impacts
    density
        Of the grains, kg/m³.
    volume
        Of the box, m³.
    """
    radii = np.cbrt(3.0 * grid.masses / (4.0 * math.pi * density))
    first, second = grid.pairs
    mass, other = grid.masses[first], grid.masses[second]
    reduced, joint = mass * other / (mass + other), mass + other
    section = impacts.efficiency * grid.cross_sections(radii) / volume
    bounce = (1.0 + impacts.restitution) * reduced

    def law(numbers: Floats, energies: Floats) -> PairRates:
        per_mass = np.zeros_like(numbers)
        np.divide(energies, 1.5 * numbers * grid.masses, out=per_mass, where=numbers > 1e-12)
        a, b = per_mass[first], per_mass[second]
        total = a + b
        chi = mixture_contact_values(numbers / volume, 2.0 * radii)[first, second]
        pairs = numbers[first] * numbers[second]
        rate = section * chi * np.sqrt(8.0 / math.pi * total) * pairs
        inverse = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0.0)
        centre, squared = 3.0 * a * b * inverse, impacts.relative * inverse
        # Of the relative velocity, one has the part a/(a + b) and the other −b/(a + b).
        taken = 0.5 * np.array(
            [mass * (centre + squared * a**2), other * (centre + squared * b**2)]
        )
        made = 0.5 * joint * (centre + squared * ((mass * a - other * b) / joint) ** 2)
        parting = rate * (1.0 - impacts.sticking) * impacts.normal * bounce
        gained = parting * np.array(
            [0.5 * bounce / mass * total - a, 0.5 * bounce / other * total - b]
        )
        return PairRates(rate * impacts.sticking, taken, made, gained)

    return law
