"""Restitution of elastic–plastic spheres: elastic up to a yield speed, then losing with it.

C. Thornton, J. Applied Mechanics 64 (1997) 383.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Final, Literal

from agglom_mpi.compilation.stages import Submodel, inlined
from agglom_mpi.declaration.components import In, Setting
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.laws import Group, Reported, Values
from agglom_mpi.physics import scales
from agglom_mpi.physics.elastic_contact import (
    PoissonRatio,
    YoungsModulus,
    contact_modulus,
    reduced_radius,
)
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import Restitution, RestitutionSolution

YIELD: Final = Group(
    "v√ρE²/p^(5/2)",
    "approach speed over yield speed",
    {"relative_speed": 1.0, "density": 0.5, "youngs_modulus": 2.0, "yield_pressure": -2.5},
)


@inlined
def yield_speed(limit: float, modulus: float, pair: ContactPair) -> float:
    """Approach speed in m/s at which the largest pressure of a Hertzian contact is `limit` p_y, Pa.

    ½m*w_y² = (8/15) E* R*³ (πp_y/(2E*))⁵, 1.56 √(p_y⁵/(ρE*⁴)) of a sphere on a wall.
    """
    radius = reduced_radius(pair.radius_i, pair.radius_j)
    strain = 0.5 * math.pi * limit / modulus
    mass = pair.reduced_mass / (radius * radius * radius)
    return strain * strain * math.sqrt(16.0 / 15.0 * modulus * strain / mass)


@inlined
def plastic_restitution(ratio: float) -> float:
    """Restitution at w_y/w = `ratio` ≤ 1: plastic flow at the pressure p_y, elastic recovery.

    e² = (6√3/5) (1 − ratio²/6) √(ratio/(ratio + 2√(6/5 − ratio²/5))).
    """
    square = ratio * ratio
    recovery = ratio / (ratio + 2.0 * math.sqrt(1.2 - 0.2 * square))
    return math.sqrt(1.2 * math.sqrt(3.0) * (1.0 - square / 6.0) * math.sqrt(recovery))


class ElasticPlasticRestitution(Restitution):
    """e(w) of elastic–perfectly plastic spheres: 1 up to the yield speed, then falling as w^(−¼).

    The yield pressure p_y, the peak of a contact, is given, or 1.6 times a `yield_stress`.
    Neglected are work hardening, heat, and what earlier impacts have flattened.

    Attributes
    ----------
    yield_pressure
        Pressure p_y in the middle of the contact, where it is largest, at which the contact begins
        to flow; 1.5 times the mean pressure of a Hertzian contact.
    yield_stress
        Yield stress of the material, in place of `yield_pressure`.
    """

    law: Literal["elastic_plastic"] = "elastic_plastic"
    example: ClassVar[str] = "{law: elastic_plastic, youngs_modulus: 70 GPa, yield_stress: 300 MPa}"
    youngs_modulus: YoungsModulus
    poisson_ratio: PoissonRatio = 0.3
    yield_pressure: Annotated[float | None, In("Pa", above=0)] = None
    yield_stress: Annotated[float | None, In("Pa", above=0)] = None
    summary: ClassVar[str] = "elastic up to a yield speed, then plastic [Thornton 1997]"
    derived = ("limit", "modulus")
    groups = (YIELD,)

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield that not one of yield pressure and yield stress is given."""
        given = [n for n in ("yield_pressure", "yield_stress") if getattr(self, n) is not None]
        if len(given) != 1:
            said = "is missing" if not given else "is given beside yield_pressure"
            yield ("yield_stress",), f"{said}; give one of yield_pressure, yield_stress"

    def settings(self) -> Iterator[Setting]:
        """Yield the numbers, without the one of pressure and stress that is not given."""
        return (each for each in super().settings() if each.value is not None)

    def build(self, value: Values) -> Submodel:
        """Return the numbers as kernels see them; nan stands for the one that is not given."""
        built = super().build(value)
        return type(built)(*(math.nan if number is None else number for number in built))

    @property
    def limit(self) -> float:
        """Yield pressure p_y in Pa: as given, or 1.6 times the yield stress."""
        if self.yield_pressure is not None:
            return self.yield_pressure
        return math.nan if self.yield_stress is None else 1.6 * self.yield_stress

    @property
    def modulus(self) -> float:
        """Contact modulus E* in Pa."""
        return contact_modulus(self.youngs_modulus, self.poisson_ratio)

    def reported(self) -> Iterator[Reported]:
        """Yield the yield speed of two mean grains."""

        def evaluate(law: Any, scene: Any, value: Values) -> float:
            return yield_speed(law.limit, law.modulus, scales.mean_pair(scene, value, 1.0))

        yield Reported("yield speed", "m/s", evaluate, "of two mean grains; slower, e is 1")

    def solve_restitution(self, laws, pair):
        """1 − e by the yield speed over the approach speed."""
        ratio = yield_speed(self.limit, self.modulus, pair) / pair.approach_speed
        restitution = 1.0 if ratio >= 1.0 else plastic_restitution(ratio)
        return RestitutionSolution(max(0.0, 1.0 - restitution), False, 0.0, False)
