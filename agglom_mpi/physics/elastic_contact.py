"""Elastic contact of two spheres: reduced radius and modulus, and the work that adhesion costs.

Two spheres touch as one of the reduced radius R* = R_i R_j/(R_i + R_j) and the contact modulus E*
touches a rigid plane (H. Hertz, J. reine angew. Math. 92, 1881, 156); with adhesion as Johnson,
Kendall and Roberts have it (Proc. R. Soc. A 324, 1971, 301).
"""

from typing import Annotated, Final

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.declaration.components import In

YoungsModulus = Annotated[
    float, In("Pa", above=0, meaning="Young's modulus of the grains, like '70 GPa'")
]
"""Young's modulus E of the material of the grains, Pa."""
PoissonRatio = Annotated[
    float, In("1", at_least=0, at_most=0.5, meaning="Poisson's ratio of the grains")
]
"""Poisson's ratio ν of the material of the grains."""

FIXED_DISPLACEMENT: Final = 7.092195971863959
"""Work of adhesion in (Γ⁵R*⁴/E*²)^⅓, from the first touch to separation at fixed displacement.

∫F dδ along the JKR curve from δ = 0, where two spheres that approach jump into contact, to the
smallest δ at which there is a contact  (Thornton & Ning, Powder Technology 99, 1998, 154).
"""
FIXED_LOAD: Final = 8.104991942898724
"""The same from zero force to separation at fixed load  (Brilliantov et al., PRE 76, 2007, 051302).

It begins with a contact that is compressed, δ > 0, and ends at the largest pull. Spheres that
rebound pass δ = 0 with what the approach gave them, so that the other number is theirs.
"""


@inlined
def reduced_radius(radius_i: float, radius_j: float) -> float:
    """R* = R_i R_j/(R_i + R_j) in m."""
    return radius_i * radius_j / (radius_i + radius_j)


def contact_modulus(youngs_modulus: float, poisson_ratio: float) -> float:
    """Return E* = E/(2(1 − ν²)) of two spheres of one material, Pa."""
    return youngs_modulus / (2.0 * (1.0 - poisson_ratio * poisson_ratio))


@inlined
def separation_work(constant: float, surface_energy: float, radius: float, modulus: float) -> float:
    """W = c (Γ⁵R*⁴/E*²)^⅓ in J, the energy that it costs to part two adhesive spheres.

    Parameters
    ----------
    constant
        c, such as `FIXED_DISPLACEMENT`.
    surface_energy
        γ in J/m² per surface; the work of adhesion is Γ = 2γ.
    radius
        Reduced radius R* in m.
    modulus
        Contact modulus E* in Pa.
    """
    adhesion = 2.0 * surface_energy
    return constant * adhesion * radius * radius * (adhesion / (modulus * radius)) ** (2.0 / 3.0)


def tabor_number(surface_energy: float, radius: float, modulus: float, distance: float) -> float:
    """Return μ = (R*Γ²/(E*²z₀³))^⅓, the elastic neck over the reach z₀ of surface forces.

    D. Tabor, J. Colloid Interface Sci. 58 (1977) 2. Arguments as of `separation_work`, and z₀ in m.
    """
    adhesion = 2.0 * surface_energy
    return (radius / distance) ** (1.0 / 3.0) * (adhesion / (modulus * distance)) ** (2.0 / 3.0)
