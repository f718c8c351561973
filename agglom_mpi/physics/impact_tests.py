"""Coefficients of restitution as they are measured: of single impacts without slip."""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ImpactLaws, solve_restitution

Floats = NDArray[np.float64]

SCALED_SPEEDS: Final = np.geomspace(1e-4, 6.0, 64)
"""Speeds, over that of a component of the motion, between which pairs begin or cease to bond."""
HALVINGS: Final = 40
"""Number of halvings of the interval in which they do."""


def impact_coefficients(
    laws: ImpactLaws, density: float, temperature: float, impacts: Floats, found: Floats
) -> None:
    """Fill in the coefficient of each impact, shape (q,); the others as of `ImpactTests`."""
    for k in range(found.size):
        speed, first, second = impacts[k, 0], impacts[k, 1], impacts[k, 2]
        own = temperature if math.isnan(impacts[k, 3]) else impacts[k, 3]
        one = 4.0 / 3.0 * math.pi * density * first**3
        other = 4.0 / 3.0 * math.pi * density * second**3
        share = other / (one + other)
        pair = ContactPair(
            approach_speed=speed,
            slip_speed=0.0,
            mass_i=one,
            mass_j=other,
            reduced_mass=one * share,
            radius=min(first, second),
            radius_i=first,
            radius_j=second,
            temperature_i=own,
            temperature_j=own,
            normal_i=share * speed,  # in the frame of the centre of mass
            normal_j=-(1.0 - share) * speed,
            tangent_i=0.0,
            tangent_j=0.0,
        )
        solution = solve_restitution(laws.restitution, laws, pair)
        found[k] = 0.0 if solution.bonds else 1.0 - float(solution.deficit)


class ImpactTests(NamedTuple):
    """The laws of a string, which give the coefficients of single impacts without samples.

    Attributes
    ----------
    laws
        Laws of an impact.
    density
        Of the grains in kg/m³.
    temperature
        Of the grains in K where an impact states none; 0 where the scene has none.
    """

    laws: ImpactLaws
    density: float
    temperature: float

    def coefficients(
        self, impacts: Floats, solve: Callable[..., None] = impact_coefficients
    ) -> Floats:
        """Return the coefficient of each impact, shape (q,); it is 0 where the pair bonds.

        Parameters
        ----------
        impacts
            Approach speed in m/s, both radii in m and the temperature in K, nan if it is not
            stated, shape (q, 4).
        solve
            `impact_coefficients`, or its kernel in `simulation.impact`, which compiles for seconds.
        """
        found = np.empty(len(impacts))
        solve(self.laws, self.density, self.temperature, impacts, found)
        return found

    def maxwellian_sticking(
        self,
        first: Floats,
        second: Floats,
        variance: Floats,
        solve: Callable[..., None] = impact_coefficients,
    ) -> Floats:
        """Return the share of impacts that bond if relative velocities are Maxwellian, (pairs,).

        Normal speeds w of impacts then have the density (w/s²) exp(−w²/2s²) on each interval of
        speeds at which the law bonds the pair; its ends are found by bisection.

        Parameters
        ----------
        first, second
            Radii in m, shape (pairs,).
        variance
            Of a component of the relative velocity, s² = T_i/m_i + T_j/m_j in m²/s², (pairs,).
        solve
            As of `coefficients`.
        """
        speed, unknown = np.sqrt(variance), math.nan

        def bonds(pair: NDArray[np.intp], scaled: Floats) -> NDArray[np.bool_]:
            states = scaled * speed[pair], first[pair], second[pair], np.full(len(pair), unknown)
            return np.asarray(self.coefficients(np.column_stack(states), solve) == 0.0)

        pair, place = np.indices((len(speed), len(SCALED_SPEEDS))).reshape(2, -1)
        bonded = bonds(pair, SCALED_SPEEDS[place]).reshape(len(speed), len(SCALED_SPEEDS))
        pair, place = np.nonzero(bonded[:, 1:] != bonded[:, :-1])
        low, high, below = SCALED_SPEEDS[place], SCALED_SPEEDS[place + 1], bonded[pair, place]
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            same = bonds(pair, middle) == below
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        faster = np.where(below, -1.0, 1.0) * np.exp(-0.5 * low * high)
        return np.asarray(bonded[:, 0] + np.bincount(pair, faster, len(speed)))


def impact_tests(scene: Any, value: Mapping[str, float]) -> ImpactTests:
    """Return the laws of a string; arguments as for `scales.half_width`."""
    temperature = 0.0 if math.isnan(value["temperature"]) else value["temperature"]
    return ImpactTests(scene.impact_laws(value), value["density"], temperature)
