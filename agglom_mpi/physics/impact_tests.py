"""Coefficients of restitution as they are measured: of single impacts without slip."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ImpactLaws, solve_restitution

Floats = NDArray[np.float64]


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


def impact_tests(scene: Any, value: Mapping[str, float]) -> ImpactTests:
    """Return the laws of a string; arguments as for `scales.half_width`."""
    temperature = 0.0 if math.isnan(value["temperature"]) else value["temperature"]
    return ImpactTests(scene.impact_laws(value), value["density"], temperature)
