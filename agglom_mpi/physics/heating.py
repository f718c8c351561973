"""Heat of an impact: shares of the dissipated energy, and the heat of reaction.

The search for the smallest root of e = G(e) bounds each heat over an interval of deficits by a
straight line through its upper end, with the least slope that the heat has in the interval.
"""

from typing import NamedTuple

from agglom_mpi.compilation.stages import Submodel, dispatch, inlined
from agglom_mpi.physics.friction import (
    friction_loss,
    impulse_slopes,
    normal_loss,
    tangential_impulse,
)
from agglom_mpi.physics.pair import ContactPair, is_frame_dependent


class PairSplit(NamedTuple):
    """Each sphere gets half of the kinetic energy that the pair loses  [A 14–17].

    Closes the first law in every frame.
    """


class OwnEnergy(NamedTuple):
    """Each sphere gets its own kinetic-energy change plus δW = m*w²(1−e²)/3  [B 4.7–4.9, 6.5–6.10].

    As published, with two faults: a sphere's own kinetic-energy change depends on the frame, and
    δW counts dissipated energy again, so the heat is 7/3 of the loss of a frictionless impact.
    """


@dispatch
def impact_heats(
    model: Submodel | None, friction: Submodel | None, pair: ContactPair, deficit: float
) -> tuple[float, float]:
    """Mechanical heats (q_i, q_j) in J of a bounce with 1 − e = `deficit`."""


@dispatch
def least_heat_slopes(
    model: Submodel | None,
    friction: Submodel | None,
    pair: ContactPair,
    lower: float,
    upper: float,
) -> tuple[float, float]:
    """Lower bounds in J of the slopes of both heats with the deficit, over [lower, upper]."""


@dispatch
def merge_heat(model: Submodel | None, pair: ContactPair) -> float:
    """Mechanical heat in J of both spheres together when they bond."""


@dispatch
def keeps_root_unique(model: Submodel | None) -> bool:
    """Whether heat/deficit never rises with the deficit, apart from friction that rises with e."""


@is_frame_dependent.register(PairSplit)
def _in_every_frame(model):
    return False


@is_frame_dependent.register(OwnEnergy)
def _in_one_frame(model):
    return True


@keeps_root_unique.register(None, PairSplit)
def _unique(model):
    return True


@keeps_root_unique.register(OwnEnergy)
def _not_unique(model):
    return False


@inlined
def merge_dissipation(pair: ContactPair) -> float:
    """Kinetic energy ½m*(w² + u_t²) that a merge dissipates, J."""
    square = pair.approach_speed * pair.approach_speed + pair.slip_speed * pair.slip_speed
    return 0.5 * pair.reduced_mass * square


@impact_heats.register(None)
def _no_heat(model, friction, pair, deficit):
    return 0.0, 0.0


@least_heat_slopes.register(None)
def _no_slopes(model, friction, pair, lower, upper):
    return 0.0, 0.0


@merge_heat.register(None)
def _no_merge_heat(model, pair):
    return 0.0


@impact_heats.register(PairSplit)
def _pair_split(model, friction, pair, deficit):
    impulse = tangential_impulse(friction, pair, deficit)
    half = 0.5 * (normal_loss(pair, deficit) + friction_loss(pair, impulse))
    return half, half


@least_heat_slopes.register(PairSplit)
def _pair_split_slopes(model, friction, pair, lower, upper):
    # Both parts are concave in the deficit and without a corner where friction stops the slip.
    work = pair.reduced_mass * pair.approach_speed * pair.approach_speed * (1.0 - upper)
    left = pair.slip_speed - tangential_impulse(friction, pair, upper) / pair.reduced_mass
    slope = 0.5 * (work + left * impulse_slopes(friction, pair, upper, upper)[0])
    return slope, slope


@merge_heat.register(PairSplit)
def _pair_split_merge(model, pair):
    return merge_dissipation(pair)


@inlined
def own_energy_loss(mass, normal, tangent, normal_impulse, friction_impulse):
    """Kinetic energy in J that one sphere loses to impulses in N s against n and t  [B 6.5–6.10].

    `normal` and `tangent` are its velocity components in m/s along the two impulses.
    """
    work = normal * normal_impulse + tangent * friction_impulse
    square = normal_impulse * normal_impulse + friction_impulse * friction_impulse
    return work - 0.5 * square / mass


@inlined
def least_own_energy_slope(mass, normal, tangent, impulse, momentum, friction_impulses, slopes):
    """Lower bound in J of the slope of `own_energy_loss` with the deficit.

    `impulse` is the normal impulse at the upper end, where its part of the slope is least, and
    −`momentum` its slope; `friction_impulses` and `slopes` are ranges of the friction impulse and
    of its slope; all in N s.
    """
    left = (tangent - friction_impulses[0] / mass, tangent - friction_impulses[1] / mass)
    return momentum * (impulse / mass - normal) + min(
        min(left[0] * slopes[0], left[0] * slopes[1]),
        min(left[1] * slopes[0], left[1] * slopes[1]),
    )


@impact_heats.register(OwnEnergy)
def _own_energy(model, friction, pair, deficit):
    normal_impulse = pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
    friction_impulse = tangential_impulse(friction, pair, deficit)
    work = normal_loss(pair, deficit) * (2.0 / 3.0)  # δW = m*w²(1−e²)/3
    return (
        own_energy_loss(
            pair.mass_i, pair.normal_i, pair.tangent_i, normal_impulse, friction_impulse
        )
        + work,
        own_energy_loss(
            pair.mass_j, -pair.normal_j, -pair.tangent_j, normal_impulse, friction_impulse
        )
        + work,
    )


@least_heat_slopes.register(OwnEnergy)
def _own_energy_slopes(model, friction, pair, lower, upper):
    momentum = pair.reduced_mass * pair.approach_speed
    impulse = momentum * (2.0 - upper)
    friction_impulses = (
        tangential_impulse(friction, pair, lower),
        tangential_impulse(friction, pair, upper),
    )
    slopes = impulse_slopes(friction, pair, lower, upper)
    work = momentum * pair.approach_speed * (1.0 - upper) * (2.0 / 3.0)
    own_i = least_own_energy_slope(
        pair.mass_i, pair.normal_i, pair.tangent_i, impulse, momentum, friction_impulses, slopes
    )
    own_j = least_own_energy_slope(
        pair.mass_j, -pair.normal_j, -pair.tangent_j, impulse, momentum, friction_impulses, slopes
    )
    return own_i + work, own_j + work


@merge_heat.register(OwnEnergy)
def _own_energy_merge(model, pair):
    # Both lose together what the merge dissipates, and each gets δW at e = 0.
    return merge_dissipation(pair) + normal_loss(pair, 1.0) * (4.0 / 3.0)


class ContactAreaReaction(NamedTuple):
    """κ a^c for each sphere of the pair; `heat` κ in J/m²  [A 16] [B 6.9]."""

    heat: float


@dispatch
def reaction_heat(model: Submodel | None, area: float) -> float:
    """Reaction heat of one sphere in J, from the contact area in m²  [A 16] [B 6.9]."""


@reaction_heat.register(None)
def _inert(model, area):
    return 0.0


@reaction_heat.register(ContactAreaReaction)
def _contact_area(model, area):
    return model.heat * area
