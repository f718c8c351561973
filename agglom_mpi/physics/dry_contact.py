"""Restitution laws around a dry one: what adhesion or a liquid takes from its rebound."""

import math
from typing import Annotated, Any, Final

from agglom_mpi.compilation.stages import formula, inlined
from agglom_mpi.declaration.choices import Choice
from agglom_mpi.declaration.declared import Meaning
from agglom_mpi.declaration.laws import Values, is_frame_dependent
from agglom_mpi.declaration.needed import needed
from agglom_mpi.physics import scales
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import (
    CriticalSpeeds,
    Restitution,
    RestitutionSolution,
    is_still_in_contact,
    solve_restitution,
)

BRACKET: Final = 64
"""Maximum number of doublings of a speed at which grains stick, until they bounce."""
HALVINGS: Final = 44
"""Number of halvings of the interval between both speeds: to 1e-13 of them."""


class RestitutionAroundDry(Restitution):
    """Base of restitution laws around a `dry` one, any other restitution.

    A pair bonds where the dry law bonds it, or where less than nothing is left of its rebound.

    Attributes
    ----------
    dry
        Restitution of the same grains without it, any law.
    """

    dry: Annotated[
        Restitution,
        Choice(Restitution, is_inner=True),
        Meaning("a restitution of dry grains, like {law: constant, value: 0.9}"),
    ]
    has_critical_speed = True

    @needed
    def sticking_speed(self, pair: ContactPair) -> float:
        """Speed in m/s up to which a pair sticks for sure, even if its dry impact were elastic."""
        raise NotImplementedError

    def is_still_in_contact(self, pair):
        """Whether the dry law has the pair still in its last contact."""
        return is_still_in_contact(self.dry, pair)

    def is_frame_dependent(self):
        """Return whether the dry law is."""
        return is_frame_dependent(self.dry)

    @property
    def keeps_last_impact(self) -> bool:
        """Whether the dry law needs the time of the last impact."""
        return self.dry.keeps_last_impact

    @property
    def always_bonds(self) -> str | None:
        """Why all grains bond, if those of the dry law do."""
        return self.dry.always_bonds

    def critical_speeds(
        self, scene: Any, value: Values, exponent: float | None = None
    ) -> CriticalSpeeds:
        """Return the speed to which two mean grains stick, and that from which the dry law bonds.

        By bisection from `sticking_speed` up to the first doubling of it at which they bounce.
        """
        numbers, laws = self.build(value), scene.impact_laws(value)

        def bonds(speed: float) -> bool:
            pair = scales.mean_pair(scene, value, speed)
            return bool(solve_restitution(numbers, laws, pair).bonds)

        above = self.dry.critical_speeds(scene, value, exponent)
        low = float(sticking_speed(numbers, scales.mean_pair(scene, value, 1.0)))
        if low == 0.0:
            return above
        high = 2.0 * low
        for _ in range(BRACKET):
            if not bonds(high):
                break
            low, high = high, 2.0 * high
        else:
            return CriticalSpeeds(math.inf, above.bonds_from)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if bonds(middle) else (low, middle)
        return CriticalSpeeds(low, above.bonds_from)


sticking_speed = formula(RestitutionAroundDry, RestitutionAroundDry.sticking_speed)


@inlined
def without_energy(solution: RestitutionSolution, lost: float) -> RestitutionSolution:
    """Rebound of a solution of which a fraction of the kinetic energy before the impact is lost.

    e² becomes e² − `lost`; the pair bonds where nothing is left.
    """
    rebound = 1.0 - solution.deficit
    left = rebound * rebound - lost
    if solution.bonds or left <= 0.0:
        return RestitutionSolution(1.0, True, solution.residual, solution.capped)
    # 1 − e by 1 − e², which keeps its relative accuracy where the impact is nearly elastic
    gone = solution.deficit * (1.0 + rebound) + lost
    deficit = gone / (1.0 + math.sqrt(left))
    return RestitutionSolution(deficit, False, solution.residual, solution.capped)
