"""Adhesive grains: they stick below a speed, as the contact costs energy when it breaks.

[TN]  C. Thornton and Z. Ning, Powder Technology 99 (1998) 154.
[BA]  N. V. Brilliantov, N. Albers, F. Spahn and T. Pöschel, Phys. Rev. E 76 (2007) 051302.
[JG]  K. L. Johnson and J. A. Greenwood, J. Colloid Interface Sci. 192 (1997) 326.
[G]   J. A. Greenwood, Proc. R. Soc. A 453 (1997) 1277.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Final, Literal

from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.laws import Group, Reported, Values
from agglom_mpi.physics import scales
from agglom_mpi.physics.dry_contact import RestitutionAroundDry, without_energy
from agglom_mpi.physics.elastic_contact import (
    FIXED_DISPLACEMENT,
    PoissonRatio,
    YoungsModulus,
    contact_modulus,
    reduced_radius,
    separation_work,
    tabor_number,
)
from agglom_mpi.physics.restitution import solve_restitution

STICKING: Final = Group(
    "v√ρ(R/γ)^(5/6)E^⅓",
    "approach speed over sticking speed",
    {
        "relative_speed": 1.0,
        "density": 0.5,
        "grain_radius": 5.0 / 6.0,
        "surface_energy": -5.0 / 6.0,
        "youngs_modulus": 1.0 / 3.0,
    },
)
TABOR: Final = Group(
    "(Rγ²/(E²z³))^⅓",
    "elastic neck over the reach of surface forces (Tabor)",
    {
        "grain_radius": 1.0 / 3.0,
        "surface_energy": 2.0 / 3.0,
        "youngs_modulus": -2.0 / 3.0,
        "attraction_range": -1.0,
    },
)

JKR: Final = 5.0
"""Lowest Tabor number of contacts that the JKR theory describes  [JG]."""
HYSTERESIS: Final = 1.0
"""Tabor number below which contacts are made and broken without a jump, so that elastic ones lose
nothing  [G]."""


class AdhesiveRestitution(RestitutionAroundDry):
    """Adhesion around a dry law: e² = e_dry² − (w_s/w)², sticking where that is not positive.

    The contact costs W_s = c (Γ⁵R*⁴/E*²)^⅓ = ½m*w_s²  [TN], Γ = 2γ; c is `work_constant`, 7.0922
    from the first touch to separation at fixed displacement  [TN]; 8.1050 is that of [BA], from
    zero force to separation at fixed load. An aggregate is one compact sphere of the summed volume,
    and sticks as a grain of its size. Plastic flattening, which raises W_s, is neglected.

    Attributes
    ----------
    work_constant
        c of the work W_s that it costs to part two grains.
    attraction_range
        Reach z₀ of the surface forces, for the Tabor number alone.
    """

    law: Literal["adhesive"] = "adhesive"
    example: ClassVar[str] = (
        "{law: adhesive, dry: {law: constant, value: 0.9}, youngs_modulus: 70 GPa}"
    )
    youngs_modulus: YoungsModulus
    poisson_ratio: PoissonRatio = 0.3
    work_constant: Annotated[float, In("1", above=0)] = FIXED_DISPLACEMENT
    attraction_range: Annotated[float, In("m", above=0)] = 0.2e-9
    summary: ClassVar[str] = "sticks below a speed, by JKR adhesion [Thornton & Ning 1998]"
    variables = ("surface_energy",)
    derived = ("modulus",)
    groups = (STICKING, TABOR)

    @property
    def modulus(self) -> float:
        """Contact modulus E* in Pa."""
        return contact_modulus(self.youngs_modulus, self.poisson_ratio)

    def sticking_speed(self, pair):
        """w_s = √(2W_s/m*) in m/s."""
        radius = reduced_radius(pair.radius_i, pair.radius_j)
        work = separation_work(self.work_constant, self.surface_energy, radius, self.modulus)
        return math.sqrt(2.0 * work / pair.reduced_mass)

    def solve_restitution(self, laws, pair):
        """Rebound of the dry law without the work of separation, or bonding."""
        dry = solve_restitution(self.dry, laws, pair)
        radius = reduced_radius(pair.radius_i, pair.radius_j)
        work = separation_work(self.work_constant, self.surface_energy, radius, self.modulus)
        speed = pair.approach_speed
        return without_energy(dry, 2.0 * work / (pair.reduced_mass * speed * speed))

    def tabor(self, scene: Any, value: Values) -> float:
        """Return the Tabor number of two mean grains."""
        radius = 0.5 * scales.grain_radius(scene, value)
        return tabor_number(value["surface_energy"], radius, self.modulus, self.attraction_range)

    def reported(self) -> Iterator[Reported]:
        """Yield the Tabor number."""
        note = f"of two mean grains; JKR adhesion applies from {JKR:g}"
        yield Reported("Tabor number", "1", type(self).tabor, note)

    def cautions(self, scene: Any, value: Values) -> Iterator[tuple[FieldPath, str]]:
        """Yield a Tabor number below the range of the JKR theory."""
        tabor = self.tabor(scene, value)
        if tabor < JKR:
            yield (
                ("youngs_modulus",),
                f"gives a Tabor number of {tabor:.2g}; JKR adhesion applies from {JKR:g}, and "
                f"below {HYSTERESIS:g} an elastic contact has no hysteresis, so that W_s is too "
                "large",
            )
