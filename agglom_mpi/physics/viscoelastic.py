"""Restitution of viscoelastic spheres: dry impacts that lose more, the faster they are.

[SP]  T. Schwager and T. Pöschel, Phys. Rev. E 57 (1998) 650; 78 (2008) 051304.
[R]   R. Ramírez, T. Pöschel, N. V. Brilliantov and T. Schwager, Phys. Rev. E 60 (1999) 4465.
[MP]  P. Müller and T. Pöschel, Phys. Rev. E 84 (2011) 021302.
"""

import math
from typing import Annotated, ClassVar, Final, Literal

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.laws import Group
from agglom_mpi.physics.elastic_contact import (
    PoissonRatio,
    YoungsModulus,
    contact_modulus,
    reduced_radius,
)
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import Restitution, RestitutionSolution

PADE: Final = (0.501086, 1.15345, 0.577977, 0.532178)
"""b₁ = c₁, b₂, b₃ and b₄ of the Padé approximant of e  [MP]."""

DAMPING: Final = Group(
    "A(E²v/(ρ²R⁵))^⅕",
    "dissipative time over the time of a contact",
    {
        "dissipative_constant": 1.0,
        "youngs_modulus": 0.4,
        "density": -0.4,
        "grain_radius": -1.0,
        "relative_speed": 0.2,
    },
)


@inlined
def pade_deficit(root: float) -> float:
    """1 − e at v* = β^½ w^(1/10), dimensionless; e = (1 + b₁v*)/(1 + b₁v* + … + b₄v*⁴)  [MP]."""
    first, second, third, fourth = PADE
    lost = root * root * (second + root * (third + root * fourth))
    return lost / (1.0 + first * root + lost)


@inlined
def stiffness_rate(pair: ContactPair) -> float:
    """√R*/m* in m^½/kg, by which the contact of a pair is faster than that of another."""
    return math.sqrt(reduced_radius(pair.radius_i, pair.radius_j)) / pair.reduced_mass


@inlined
def scaled_deficit(scale: float, pair: ContactPair) -> float:
    """1 − e where v*² = β w^⅕ is `scale` (√R*/m* √w)^⅖."""
    rate = stiffness_rate(pair) * math.sqrt(pair.approach_speed)
    return pade_deficit(math.sqrt(scale) * rate**0.2)


@inlined
def measured_rate(density: float, radius: float, speed: float) -> float:
    """√R*/m* √w of two equal spheres, from kg/m³, m and m/s."""
    mass = 2.0 / 3.0 * math.pi * density * radius * radius * radius
    return math.sqrt(0.5 * radius * speed) / mass


class ViscoelasticRestitution(Restitution):
    """e(w) of viscoelastic spheres, by β w^⅕ with β = (3/2) A (ρ/m*)^⅖, ρ = (4/3) E* √R*.

    The force at the overlap ξ is ρ√ξ (ξ + (3/2) A ξ'), and grains part where it, not the overlap,
    is zero  [SP] [R]. The Padé form is within 1 % of the e of that equation of motion up to
    v* = √(β w^⅕) = 0.9, where e is 0.46, and within 0.009 for all speeds. Impacts are quasistatic,
    and strains small.

    Attributes
    ----------
    dissipative_constant
        Dissipative constant A of the material.
    """

    law: Literal["viscoelastic"] = "viscoelastic"
    example: ClassVar[str] = (
        "{law: viscoelastic, youngs_modulus: 70 GPa, dissipative_constant: 1 us}"
    )
    youngs_modulus: YoungsModulus
    poisson_ratio: PoissonRatio = 0.3
    dissipative_constant: Annotated[
        float,
        In("s", at_least=0, meaning="A, like '1 us'; from a measured e: law viscoelastic_measured"),
    ]
    summary: ClassVar[str] = "viscoelastic spheres [Schwager & Pöschel 2008, Müller & Pöschel 2011]"
    derived = ("scale",)
    groups = (DAMPING,)

    @property
    def scale(self) -> float:
        """(3/2) A ((4/3) E*)^⅖, in s Pa^⅖."""
        modulus = contact_modulus(self.youngs_modulus, self.poisson_ratio)
        return 1.5 * self.dissipative_constant * (4.0 / 3.0 * modulus) ** 0.4

    def dissipative_time(self, modulus):
        """Return A as given."""
        return self.dissipative_constant

    def solve_restitution(self, laws, pair):
        """1 − e by the Padé form."""
        return RestitutionSolution(scaled_deficit(self.scale, pair), False, 0.0, False)


class MeasuredViscoelasticRestitution(Restitution):
    """e(w) of viscoelastic spheres, by one measured restitution.

    `restitution` at `speed`, of two equal spheres of `radius` and of the material of the grains;
    other speeds and sizes follow, as v*² ∝ (√R*/m* √w)^⅖ for one material.

    Attributes
    ----------
    restitution
        The measured restitution.
    speed
        Approach speed at which it was measured.
    radius
        Radius of the two equal spheres that were measured.
    """

    law: Literal["viscoelastic_measured"] = "viscoelastic_measured"
    example: ClassVar[str] = (
        "{law: viscoelastic_measured, restitution: 0.9, speed: 1 m/s, radius: 1 mm}"
    )
    restitution: Annotated[float, In("1", above=0, at_most=1, meaning="the measured one, 0 to 1")]
    speed: Annotated[
        float, In("m/s", above=0, meaning="the approach speed in the measurement, like '1 m/s'")
    ]
    radius: Annotated[
        float,
        In("m", above=0, meaning="the radius of the two spheres in the measurement, like '1 mm'"),
    ]
    summary: ClassVar[str] = "viscoelastic spheres, by a measured restitution [Müller & Pöschel]"
    variables = ("density",)
    derived = ("root",)
    groups = (
        Group(
            "v/w(a/R)^5",
            "speed over that of the measurement",
            {"relative_speed": 1.0, "speed": -1.0, "grain_radius": -5.0, "radius": 5.0},
        ),
    )

    @property
    def root(self) -> float:
        """v* of the measurement, by bisection."""
        low, high = 0.0, 1.0
        while 1.0 - pade_deficit(high) > self.restitution:
            low, high = high, 2.0 * high
        for _ in range(60):
            middle = 0.5 * (low + high)
            above = 1.0 - pade_deficit(middle) > self.restitution
            low, high = (middle, high) if above else (low, middle)
        return 0.5 * (low + high)

    def dissipative_time(self, modulus):
        """Return A by v*² = (3/2) A ((4/3) E* √R*/m* √w)^⅖ of the measurement."""
        rate = measured_rate(self.density, self.radius, self.speed)
        return self.root * self.root / (1.5 * (4.0 / 3.0 * modulus * rate) ** 0.4)

    def solve_restitution(self, laws, pair):
        """1 − e by the Padé form, scaled from the measurement."""
        rate = measured_rate(self.density, self.radius, self.speed)
        ratio = stiffness_rate(pair) * math.sqrt(pair.approach_speed) / rate
        return RestitutionSolution(pade_deficit(self.root * ratio**0.2), False, 0.0, False)
