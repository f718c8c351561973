"""Breaking of aggregates contact by contact: grains that adhesion holds together.

C. Dominik and A. G. G. M. Tielens, Astrophysical Journal 480 (1997) 647.
"""

import math
from typing import Annotated, ClassVar, Final, Literal

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.laws import Group
from agglom_mpi.physics.elastic_contact import (
    FIXED_DISPLACEMENT,
    PoissonRatio,
    YoungsModulus,
    contact_modulus,
    separation_work,
)
from agglom_mpi.physics.fragmentation import Fragmentation, FragmentCount

BREAKING: Final = Group(
    "ρv²(a⁵E²/γ⁵)^⅓",
    "kinetic energy of a grain over that of a contact",
    {
        "density": 1.0,
        "relative_speed": 2.0,
        "grain_radius": 5.0 / 3.0,
        "youngs_modulus": 2.0 / 3.0,
        "surface_energy": -5.0 / 3.0,
    },
)


class ContactBreaking(Fragmentation):
    """1 + floor(E/E_break) equal pieces, at most one per grain, each contact costing E_break.

    E is half of the energy that the pair dissipated, as each aggregate absorbs, over
    `energy_per_contact`, and E_break = c (Γ⁵R*⁴/E*²)^⅓ the work to part two of its grains, as
    law `adhesive` has it. So nothing breaks below the onset, and all N grains come apart from
    N − 1 times E_break. Dominik & Tielens find the onset at some 3 contacts' energy, and the end at
    some 10 N E_break, as part of the energy goes into rolling: `energy_per_contact` 10 has that.

    Limits: the aggregate is one compact sphere, whose structure and number of contacts per grain
    are not known; its grains count as equal ones of the mean volume; pieces are equal, where
    real ones range from single grains to a large remnant.

    Attributes
    ----------
    work_constant
        c of the work W_s that it costs to part two grains.
    energy_per_contact
        Absorbed energy for each contact that breaks, over the work to part it.
    """

    law: Literal["contact_breaking"] = "contact_breaking"
    example: ClassVar[str] = "{law: contact_breaking, youngs_modulus: 70 GPa}"
    youngs_modulus: YoungsModulus
    poisson_ratio: PoissonRatio = 0.3
    work_constant: Annotated[float, In("1", above=0)] = FIXED_DISPLACEMENT
    energy_per_contact: Annotated[float, In("1", at_least=1)] = 1.0
    summary: ClassVar[str] = "one contact after the other [Dominik & Tielens 1997]"
    variables = ("surface_energy",)
    derived = ("modulus",)
    groups = (BREAKING,)

    @property
    def modulus(self) -> float:
        """Contact modulus E* in Pa."""
        return contact_modulus(self.youngs_modulus, self.poisson_ratio)

    def breakage(self, pair_loss, own_change, radius, grains):
        """Pieces by half of the pair's loss over the work of a contact."""
        grain = radius / grains ** (1.0 / 3.0)
        work = separation_work(self.work_constant, self.surface_energy, 0.5 * grain, self.modulus)
        return broken_contacts(0.5 * pair_loss, self.energy_per_contact, work, grains)


@inlined
def broken_contacts(absorbed: float, share: float, work: float, grains: int) -> FragmentCount:
    """Pieces and energy in J of an aggregate that absorbs energy; each contact takes `work` in J.

    A contact breaks for each `share` times `work`; the rest of the energy is heat.
    """
    most = float(grains - 1)
    contacts = absorbed / (share * work)
    broken = most if contacts >= most else math.floor(contacts)
    if broken < 1.0:
        return FragmentCount(1, 0.0)
    return FragmentCount(int(broken) + 1, broken * work)
