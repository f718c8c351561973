"""Coefficients of restitution as they are measured: of single impacts without slip."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ImpactLaws, solve_restitution

Floats = NDArray[np.float64]


class ImpactTests(NamedTuple):
    """The laws of a string, which give the coefficients of single impacts without samples.

    They are evaluated in plain Python, by the formulas that kernels compile.

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

    def coefficients(self, impacts: Floats) -> Floats:
        """Return the coefficient of each impact, shape (q,); it is 0 where the pair bonds.

        Parameters
        ----------
        impacts
            Approach speed in m/s, both radii in m and the temperature in K, nan if it is not
            stated, shape (q, 4).
        """
        return np.array([self._coefficient(*row) for row in impacts.tolist()])

    def _coefficient(self, speed: float, first: float, second: float, stated: float) -> float:
        temperature = self.temperature if math.isnan(stated) else stated
        one, other = (4.0 / 3.0 * math.pi * self.density * radius**3 for radius in (first, second))
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
            temperature_i=temperature,
            temperature_j=temperature,
            normal_i=share * speed,  # in the frame of the centre of mass
            normal_j=-(1.0 - share) * speed,
            tangent_i=0.0,
            tangent_j=0.0,
        )
        solution = solve_restitution(self.laws.restitution, self.laws, pair)
        return 0.0 if solution.bonds else 1.0 - float(solution.deficit)


def impact_tests(scene: Any, value: Mapping[str, float]) -> ImpactTests:
    """Return the laws of a string; arguments as for `scales.half_width`."""
    temperature = 0.0 if math.isnan(value["temperature"]) else value["temperature"]
    return ImpactTests(scene.impact_laws(value), value["density"], temperature)
