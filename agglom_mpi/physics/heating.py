"""Which part of the energy lost at an impact heats which sphere?

The heats of both spheres are sums of terms that are monotone in e, so the largest heat over an
interval of e is bounded by taking each term at the better end; `impact` searches roots with that.
"""

from typing import NamedTuple

from agglom_mpi.compilation import Submodel, question, stage
from agglom_mpi.physics.encounter import Encounter
from agglom_mpi.physics.friction import friction_loss, normal_loss, tangential_impulse


class PairSplit(NamedTuple):
    """Each sphere gets half of the kinetic energy that the pair loses  [A 14–17].

    Closes the first law in every frame.
    """


class OwnEnergy(NamedTuple):
    """Each sphere gets its own kinetic-energy change plus δW = m*w²(1−e²)/3  [B 4.7–4.9, 6.5–6.10].

    As published, with two faults: a sphere's own kinetic-energy change depends on the frame, and
    δW counts dissipated energy again, so the heat is 7/3 of the loss of a frictionless impact.
    """


@question
def impact_heats(
    model: Submodel | None, friction: Submodel | None, pair: Encounter, deficit: float
) -> tuple[float, float]:
    """Mechanical heats (q_i, q_j) in J of a bounce with 1 − e = `deficit`."""


@question
def largest_heats(
    model: Submodel | None,
    friction: Submodel | None,
    pair: Encounter,
    lower: float,
    upper: float,
) -> tuple[float, float]:
    """Upper bounds in J of both heats over all deficits in [lower, upper]."""


@question
def merge_heat(model: Submodel | None, pair: Encounter) -> float:
    """Mechanical heat in J of both spheres together when they bond."""


@question
def keeps_root_unique(model: Submodel | None) -> bool:
    """Whether heat/deficit never rises with the deficit, friction that rises with e set aside."""


@keeps_root_unique.answer(None, PairSplit)
def _unique(model):  # type: ignore[no-untyped-def]
    return True


@keeps_root_unique.answer(OwnEnergy)
def _not_unique(model):  # type: ignore[no-untyped-def]
    return False


@stage
def merge_loss(pair: Encounter) -> float:
    """Kinetic energy ½m*(w² + u_t²) that a merge dissipates, J."""
    square = pair.approach_speed * pair.approach_speed + pair.slip_speed * pair.slip_speed
    return 0.5 * pair.reduced_mass * square


@impact_heats.answer(None)
def _no_heat(model, friction, pair, deficit):  # type: ignore[no-untyped-def]
    return 0.0, 0.0


@largest_heats.answer(None)
def _no_largest(model, friction, pair, lower, upper):  # type: ignore[no-untyped-def]
    return 0.0, 0.0


@merge_heat.answer(None)
def _no_merge_heat(model, pair):  # type: ignore[no-untyped-def]
    return 0.0


@impact_heats.answer(PairSplit)
def _pair_split(model, friction, pair, deficit):  # type: ignore[no-untyped-def]
    impulse = tangential_impulse(friction, pair, deficit)
    half = 0.5 * (normal_loss(pair, deficit) + friction_loss(pair, impulse))
    return half, half


@largest_heats.answer(PairSplit)
def _pair_split_largest(model, friction, pair, lower, upper):  # type: ignore[no-untyped-def]
    rubbing = max(
        friction_loss(pair, tangential_impulse(friction, pair, lower)),
        friction_loss(pair, tangential_impulse(friction, pair, upper)),
    )
    half = 0.5 * (normal_loss(pair, upper) + rubbing)
    return half, half


@merge_heat.answer(PairSplit)
def _pair_split_merge(model, pair):  # type: ignore[no-untyped-def]
    return merge_loss(pair)


@stage
def own_loss(mass, normal, tangent, normal_impulse, friction_impulse):  # type: ignore[no-untyped-def]
    """Kinetic energy in J that a sphere of this velocity loses to impulses against n and t."""
    work = normal * normal_impulse + tangent * friction_impulse
    square = normal_impulse * normal_impulse + friction_impulse * friction_impulse
    return work - 0.5 * square / mass


@stage
def largest_own_loss(mass, normal, tangent, impulses, rubbing):  # type: ignore[no-untyped-def]
    """Bound of `own_loss` over normal and friction impulses within the given pairs of ends."""
    return (
        max(normal * impulses[0], normal * impulses[1])
        + max(tangent * rubbing[0], tangent * rubbing[1])
        - 0.5 * (min(impulses) ** 2 + min(rubbing) ** 2) / mass
    )


@impact_heats.answer(OwnEnergy)
def _own_energy(model, friction, pair, deficit):  # type: ignore[no-untyped-def]
    impulse = pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
    rubbing = tangential_impulse(friction, pair, deficit)
    work = normal_loss(pair, deficit) * (2.0 / 3.0)
    return (
        own_loss(pair.mass_i, pair.normal_i, pair.tangent_i, impulse, rubbing) + work,
        own_loss(pair.mass_j, -pair.normal_j, -pair.tangent_j, impulse, rubbing) + work,
    )


@largest_heats.answer(OwnEnergy)
def _own_energy_largest(model, friction, pair, lower, upper):  # type: ignore[no-untyped-def]
    momentum = pair.reduced_mass * pair.approach_speed
    impulses = (momentum * (2.0 - lower), momentum * (2.0 - upper))
    rubbing = (
        tangential_impulse(friction, pair, lower),
        tangential_impulse(friction, pair, upper),
    )
    work = normal_loss(pair, upper) * (2.0 / 3.0)
    return (
        largest_own_loss(pair.mass_i, pair.normal_i, pair.tangent_i, impulses, rubbing) + work,
        largest_own_loss(pair.mass_j, -pair.normal_j, -pair.tangent_j, impulses, rubbing) + work,
    )


@merge_heat.answer(OwnEnergy)
def _own_energy_merge(model, pair):  # type: ignore[no-untyped-def]
    return merge_loss(pair) + normal_loss(pair, 1.0) * (4.0 / 3.0)
