"""Wet grains: a viscous film and a liquid bridge take from the rebound; slow grains stick.

[BD]  G. Barnocky and R. H. Davis, Phys. Fluids 31 (1988) 1324.
[DRG] R. H. Davis, D. A. Rager and B. T. Good, J. Fluid Mech. 468 (2002) 107.
[E]   B. J. Ennis, G. Tardos and R. Pfeffer, Powder Technology 65 (1991) 257.
[P]   O. Pitois, P. Moucheront and X. Chateau, J. Colloid Interface Sci. 231 (2000) 26.
[L]   G. Lian, C. Thornton and M. J. Adams, J. Colloid Interface Sci. 161 (1993) 138.
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
from agglom_mpi.physics.elastic_contact import reduced_radius
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import RestitutionSolution, solve_restitution

STOKES: Final = Group(
    "ρva/η",
    "inertia of an impact over the drag of the film (Stokes)",
    {"density": 1.0, "relative_speed": 1.0, "grain_radius": 1.0, "viscosity": -1.0},
)
WEBER: Final = Group(
    "ρv²a/σ",
    "kinetic energy of an impact over the energy of a bridge (Weber)",
    {"density": 1.0, "relative_speed": 2.0, "grain_radius": 1.0, "surface_tension": -1.0},
)

THIN: Final = 0.3
"""Thickest film relative to the radius of a grain: lubrication asks for gaps well below it."""


@inlined
def drag_speed(viscosity: float, pair: ContactPair) -> float:
    """6πηR*²/m* in m/s, the approach speed at which the Stokes number is 1."""
    radius = reduced_radius(pair.radius_i, pair.radius_j)
    return 6.0 * math.pi * viscosity * radius * radius / pair.reduced_mass


@inlined
def bridge_work(tension: float, angle: float, ratio: float, radius: float) -> float:
    """Energy in J that it takes to rupture a liquid bridge between two spheres, from contact.

    The integral of F = 2πσR cos θ (1 − D/√(D² + 2V/(πR)))  [P] up to the rupture at
    D = (1 + θ/2) V^⅓  [L].

    Parameters
    ----------
    tension
        Surface tension σ in N/m.
    angle
        Contact angle θ in rad.
    ratio
        V/R³ of the bridge.
    radius
        Radius R in m; of two unequal spheres 2R*.
    """
    width = 2.0 * ratio / math.pi
    rupture = (1.0 + 0.5 * angle) * ratio ** (1.0 / 3.0)
    # D + √k − √(D² + k), without the cancellation of a bridge of little liquid
    root = math.sqrt(width)
    length = 2.0 * rupture * root / (rupture + root + math.sqrt(rupture * rupture + width))
    return 2.0 * math.pi * tension * math.cos(angle) * radius * radius * length


class WetRestitution(RestitutionAroundDry):
    """A liquid film around a dry law: e = e_dry (1 − St_c/St), less the loss to a liquid bridge.

    St = m*w/(6πηR*²), 4ρaw/(9η) of two equal spheres, and St_c = ln(film/roughness) with the sum of
    both films, by lubrication up to the roughness; the film cavitates on the way out  [BD] [DRG].
    [E] write the same number as 8ρau/(9η), u half of the approach speed, and St_c as
    (1 + 1/e) ln(h/h_a) of one film and one roughness, as their film resists on the way out, too. A
    bridge costs W: e² becomes [e_dry (1 − St_c/St)]² − 2W/(m*w²). The dry law is evaluated at the
    approach speed w.

    Every sphere, an aggregate too, has a film of the same thickness, and bridges the same ratio of
    liquid volume V/R³: what an aggregate has more per surface is in its pores.

    Attributes
    ----------
    viscosity
        Viscosity η of the liquid.
    film_thickness
        Thickness of the film on each grain.
    roughness
        Gap at which the solids touch.
    surface_tension
        Surface tension σ of the liquid; 0 leaves the bridge out.
    contact_angle
        Contact angle θ of the liquid, in rad.
    liquid_ratio
        Liquid of a bridge over the cube of the radius, V/R³.
    """

    law: Literal["wet"] = "wet"
    example: ClassVar[str] = (
        "{law: wet, dry: {law: constant, value: 0.9}, viscosity: 1 mPa*s, "
        "film_thickness: 1 um, roughness: 100 nm}"
    )
    viscosity: Annotated[float, In("Pa*s", at_least=0, meaning="of the liquid, like '1 mPa*s'")]
    film_thickness: Annotated[
        float, In("m", above=0, meaning="of the film on each grain, like '1 um'")
    ]
    roughness: Annotated[
        float, In("m", above=0, meaning="gap at which the solids touch, like '100 nm'")
    ]
    surface_tension: Annotated[float, In("N/m", at_least=0)] = 0.0
    contact_angle: Annotated[float, In("1", at_least=0, at_most=1.5)] = 0.0
    liquid_ratio: Annotated[float, In("1", above=0, at_most=1)] = 0.01
    summary: ClassVar[str] = "a viscous film and a bridge [Davis et al. 2002, Pitois et al. 2000]"
    derived = ("critical_stokes",)
    groups = (STOKES, WEBER)

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield a roughness that sticks out of both films."""
        if self.roughness > 2.0 * self.film_thickness:
            yield (
                ("roughness",),
                f"is {self.roughness:g} m; must be at most both films together, "
                f"{2.0 * self.film_thickness:g} m",
            )

    @property
    def critical_stokes(self) -> float:
        """St_c = ln(film/roughness), with the sum of both films; 0 where roughness is larger."""
        return max(0.0, math.log(2.0 * self.film_thickness / self.roughness))

    def sticking_speed(self, pair):
        """Higher of the speed at which St is St_c and that of the energy of the bridge, m/s."""
        radius = 2.0 * reduced_radius(pair.radius_i, pair.radius_j)
        work = bridge_work(self.surface_tension, self.contact_angle, self.liquid_ratio, radius)
        viscous = self.critical_stokes * drag_speed(self.viscosity, pair)
        return max(viscous, math.sqrt(2.0 * work / pair.reduced_mass))

    def solve_restitution(self, laws, pair):
        """Rebound of the dry law behind the film, without the energy of the bridge; or bonding."""
        dry = solve_restitution(self.dry, laws, pair)
        speed = pair.approach_speed
        slowed = self.critical_stokes * drag_speed(self.viscosity, pair) / speed  # St_c/St
        radius = 2.0 * reduced_radius(pair.radius_i, pair.radius_j)
        work = bridge_work(self.surface_tension, self.contact_angle, self.liquid_ratio, radius)
        deficit = min(1.0, dry.deficit + slowed * (1.0 - dry.deficit))
        behind = RestitutionSolution(deficit, dry.bonds or slowed >= 1.0, dry.residual, dry.capped)
        return without_energy(behind, 2.0 * work / (pair.reduced_mass * speed * speed))

    def cautions(self, scene: Any, value: Values) -> Iterator[tuple[FieldPath, str]]:
        """Yield a film that is not thin."""
        radius = scales.grain_radius(scene, value)
        if self.film_thickness > THIN * radius:
            yield (
                ("film_thickness",),
                f"is {self.film_thickness:.3g} m on grains of radius {radius:.3g} m; lubrication "
                f"describes films of up to {THIN:g} of the radius",
            )

    def stokes(self, scene: Any, value: Values) -> float:
        """Return the Stokes number of two mean grains at their mean approach speed."""
        speed = scales.mean_approach(scene, value)
        drag = drag_speed(self.viscosity, scales.mean_pair(scene, value, speed))
        return speed / drag if drag > 0.0 else math.inf

    def reported(self) -> Iterator[Reported]:
        """Yield the Stokes number and its critical value."""
        yield Reported("Stokes number", "1", type(self).stokes, "of the mean pair")
        yield Reported(
            "critical Stokes number",
            "1",
            lambda law, scene, value: law.critical_stokes,
            "ln(2 film_thickness/roughness)",
        )
