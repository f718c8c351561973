"""The outcome of one impact: restitution or bonding, impulses, heats."""

from typing import Final, NamedTuple

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.physics.contact import contact_area
from agglom_mpi.physics.friction import normal_loss, tangential_impulse, tangential_loss
from agglom_mpi.physics.heating import impact_heats
from agglom_mpi.physics.impact_tests import impact_coefficients
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.reaction import contact_heat
from agglom_mpi.physics.restitution import ImpactLaws, is_still_in_contact, solve_restitution


class ImpactResult(NamedTuple):
    """Outcome of an impact; impulses act on i against n and t, on j along them.

    Attributes
    ----------
    bonds
        Whether the two become one sphere; everything else is then left to the merge.
    deficit
        1 − e.
    normal_impulse, friction_impulse
        In N s.
    heat_i, heat_j
        Mechanical and reaction heat, before fragments take their surface energy, J.
    reaction
        Reaction heat in both together, J.
    loss
        Kinetic energy dissipated, J.
    residual, capped
        |e − G(e)| that the solver left, and whether it ended at its cap.
    """

    bonds: bool
    deficit: float
    normal_impulse: float
    friction_impulse: float
    heat_i: float
    heat_j: float
    reaction: float
    loss: float
    residual: float
    capped: bool


@kernel
def solve_impact(laws: ImpactLaws, pair: ContactPair) -> ImpactResult:
    """Return the outcome of the impact of a pair under the scene's laws  [A 4–17] [B 2–6]."""
    if is_still_in_contact(laws.restitution, pair):
        # Elastic, e = 1: no heat, no reaction, no friction.
        normal_impulse = 2.0 * pair.reduced_mass * pair.approach_speed
        return ImpactResult(False, 0.0, normal_impulse, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)
    solution = solve_restitution(laws.restitution, laws, pair)
    deficit = solution.deficit
    if solution.bonds:
        return ImpactResult(True, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)
    reaction = contact_heat(laws.reaction, contact_area(laws.contact_area, deficit, pair.radius))
    normal_impulse = pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
    friction_impulse = tangential_impulse(laws.friction, pair, deficit)
    heats = impact_heats(laws.heating, laws.friction, pair, deficit)
    loss = normal_loss(pair, deficit) + tangential_loss(laws.friction, pair, friction_impulse)
    return ImpactResult(
        False,
        deficit,
        normal_impulse,
        friction_impulse,
        heats[0] + reaction,
        heats[1] + reaction,
        2.0 * reaction,
        loss,
        solution.residual,
        solution.capped,
    )


solve_impacts: Final = kernel(impact_coefficients)
"""Kernel of `physics.impact_tests.impact_coefficients`."""
