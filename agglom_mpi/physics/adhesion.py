"""Adhesive grains: they stick below a speed, as the contact costs energy when it breaks.

[TN]  C. Thornton and Z. Ning, Powder Technology 99 (1998) 154.
[BA]  N. V. Brilliantov, N. Albers, F. Spahn and T. Pöschel, Phys. Rev. E 76 (2007) 051302.
[JG]  K. L. Johnson and J. A. Greenwood, J. Colloid Interface Sci. 192 (1997) 326.
[G]   J. A. Greenwood, Proc. R. Soc. A 453 (1997) 1277.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Final, Literal

from agglom_mpi.compilation.stages import inlined
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
from agglom_mpi.physics.restitution import Restitution, dissipative_time, solve_restitution

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
VISCOUS: Final = 3.0
"""Largest viscous number α of the contacts to which the viscous loss is fitted."""
PARTING: Final = (5.17, 5.289, 16.60, 4.596, 2.143)
"""Coefficients of f_v(α), fitted to integrated contacts of α from 0.003 to `VISCOUS`."""


@inlined
def viscous_number(
    time: float, surface_energy: float, radius: float, modulus: float, mass: float
) -> float:
    """α = A (ΓE*²R*²/m*³)^(1/6), A over the time in which adhesion moves the grains.

    That time is √(m*L/(ΓR*)), L = R*(Γ/(E*R*))^⅔ the length by which the contact stretches.
    Arguments as of `separation_work`, with A in s and m* in kg.
    """
    stiffness = modulus * radius
    return time * math.sqrt((2.0 * surface_energy * stiffness * stiffness) ** (1.0 / 3.0) / mass)


@inlined
def parting_factor(number: float) -> float:
    """f_v: rebound speed of the dry law at which grains just part, over w_s; 1 where α is 0."""
    first, second, third, fourth, fifth = PARTING
    number = min(number, 1e9)  # whose square is finite
    raised = first + number * (second + number * third)
    return 1.0 + number * raised / (1.0 + number * (fourth + number * fifth))


class AdhesiveRestitution(RestitutionAroundDry):
    """Adhesion around a dry law: e² = e_dry² − (w_s/w)², sticking where that is not positive.

    The contact costs W_s = c (Γ⁵R*⁴/E*²)^⅓ = ½m*w_s²  [TN], Γ = 2γ; c is `work_constant`, 7.0922
    from the first touch to separation at fixed displacement  [TN]; 8.1050 is that of [BA], from
    zero force to separation at fixed load. An aggregate is one compact sphere of the summed volume,
    and sticks as a grain of its size. Plastic flattening, which raises W_s, is neglected.

    Around a viscoelastic law, the pull of adhesion adds to the viscous loss. With s = w_s/w,

        e² = (e_dry − f s)(e_dry + (0.3 f + 0.7) s),   f = f_v(α),

    α the `viscous_number`. It is fitted to the equation of motion of the contact, in which the
    force is F + A dF/dt of the JKR force F  [BA], for α ≤ 3: sticking speeds are within 0.6 %, and
    e is within 0.013 from 1.1 times that speed. The contact parts at fixed displacement, where [BA]
    end it at the largest pull; the total pull is at most the pull-off force (3/2)πΓR*. So the limit
    without viscosity is that of [TN], and the limit without adhesion is the dry law.

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
        """f_v w_s in m/s, w_s = √(2W_s/m*)."""
        radius = reduced_radius(pair.radius_i, pair.radius_j)
        work = separation_work(self.work_constant, self.surface_energy, radius, self.modulus)
        time, energy = dissipative_time(self.dry, self.modulus), self.surface_energy
        number = viscous_number(time, energy, radius, self.modulus, pair.reduced_mass)
        return parting_factor(number) * math.sqrt(2.0 * work / pair.reduced_mass)

    def solve_restitution(self, laws, pair):
        """Rebound of the dry law without the loss to adhesion, or bonding."""
        dry = solve_restitution(self.dry, laws, pair)
        radius = reduced_radius(pair.radius_i, pair.radius_j)
        work = separation_work(self.work_constant, self.surface_energy, radius, self.modulus)
        speed = pair.approach_speed
        lost = 2.0 * work / (pair.reduced_mass * speed * speed)
        time, energy = dissipative_time(self.dry, self.modulus), self.surface_energy
        if time > 0.0:
            number = viscous_number(time, energy, radius, self.modulus, pair.reduced_mass)
            factor, rebound = parting_factor(number), 1.0 - dry.deficit
            viscous = 0.7 * (factor - 1.0) * rebound * math.sqrt(lost)
            lost = factor * (0.3 * factor + 0.7) * lost + viscous
        return without_energy(dry, lost)

    def tabor(self, scene: Any, value: Values) -> float:
        """Return the Tabor number of two mean grains."""
        radius = 0.5 * scales.grain_radius(scene, value)
        return tabor_number(value["surface_energy"], radius, self.modulus, self.attraction_range)

    def viscous_number(self, scene: Any, value: Values) -> float:
        """Return the viscous number of two mean grains."""
        pair, numbers = scales.mean_pair(scene, value, 1.0), self.build(value)
        time = dissipative_time(numbers.dry, self.modulus)
        radius, energy = reduced_radius(pair.radius_i, pair.radius_j), value["surface_energy"]
        return viscous_number(time, energy, radius, self.modulus, pair.reduced_mass)

    @property
    def is_viscous(self) -> bool:
        """Whether the dry law is viscoelastic."""
        return type(self.dry).dissipative_time is not Restitution.dissipative_time

    def reported(self) -> Iterator[Reported]:
        """Yield the Tabor number, and the viscous number of a viscoelastic contact."""
        if self.is_viscous:
            note = f"of two mean grains; the viscous loss is fitted up to {VISCOUS:g}"
            yield Reported("viscous number", "1", type(self).viscous_number, note)
        note = f"of two mean grains; JKR adhesion applies from {JKR:g}"
        yield Reported("Tabor number", "1", type(self).tabor, note)

    def cautions(self, scene: Any, value: Values) -> Iterator[tuple[FieldPath, str]]:
        """Yield numbers outside the range of the JKR theory and of the viscous loss."""
        viscous = self.viscous_number(scene, value) if self.is_viscous else 0.0
        if viscous > VISCOUS:
            message = (
                f"gives a viscous number of {viscous:.2g}; the loss is fitted up to {VISCOUS:g}"
            )
            yield ("dry",), message
        tabor = self.tabor(scene, value)
        if tabor < JKR:
            yield (
                ("youngs_modulus",),
                f"gives a Tabor number of {tabor:.2g}; JKR adhesion applies from {JKR:g}, and "
                f"below {HYSTERESIS:g} an elastic contact has no hysteresis, so that W_s is too "
                "large",
            )
