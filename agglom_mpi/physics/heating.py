"""Heat of an impact: who gets the kinetic energy that it dissipates.

The search for the smallest root of e = G(e) bounds each heat over an interval of deficits by a
straight line through its upper end, with the least slope that the heat has in the interval.
"""

from collections.abc import Mapping
from typing import ClassVar, Final, Literal

from agglom_mpi.compilation.stages import Submodel, formula, inlined
from agglom_mpi.declaration.laws import Group, Law
from agglom_mpi.declaration.needed import needed
from agglom_mpi.physics.friction import (
    impulse_slopes,
    least_loss_slope,
    normal_loss,
    tangential_impulse,
    tangential_loss,
)
from agglom_mpi.physics.pair import ContactPair

HEATING: Final = Group(
    "v²/(Cθ)",
    "kinetic energy of an impact over heat of the grains",
    {"relative_speed": 2.0, "heat_capacity": -1.0, "temperature": -1.0},
)


class Heating(Law):
    """Law of the heat that the spheres of a pair get from the energy that they lose."""

    @needed
    def impact_heats(
        self, friction: Submodel | None, pair: ContactPair, deficit: float
    ) -> tuple[float, float]:
        """Mechanical heats (q_i, q_j) in J of a bounce with 1 − e = `deficit`."""
        raise NotImplementedError

    @needed
    def least_heat_slopes(
        self, friction: Submodel | None, pair: ContactPair, lower: float, upper: float
    ) -> tuple[float, float]:
        """Lower bounds in J of the slopes of both heats with the deficit, over [lower, upper]."""
        raise NotImplementedError

    @needed
    def merge_heat(self, pair: ContactPair) -> float:
        """Mechanical heat in J of both spheres together when they bond."""
        raise NotImplementedError

    def keeps_root_unique(self) -> bool:
        """Whether heat/deficit never rises with the deficit, friction that rises with e apart."""
        return False


class PairSplit(Heating):
    """Each sphere gets half of the kinetic energy that the pair loses  [A 14–17].

    Closes the first law in every frame.
    """

    law: Literal["pair_split"] = "pair_split"
    summary: ClassVar[str] = "half the energy the pair lost to each [A 14-17]"
    needs = ("heat_capacity", "temperature")
    groups = (HEATING,)

    def impact_heats(self, friction, pair, deficit):
        """Half of what both impulses dissipate, J."""
        impulse = tangential_impulse(friction, pair, deficit)
        half = 0.5 * (normal_loss(pair, deficit) + tangential_loss(friction, pair, impulse))
        return half, half

    def least_heat_slopes(self, friction, pair, lower, upper):
        """Slope of the normal loss, which is concave, at `upper`, and that of friction, J."""
        work = pair.reduced_mass * pair.approach_speed * pair.approach_speed * (1.0 - upper)
        slope = 0.5 * (work + least_loss_slope(friction, pair, lower, upper))
        return slope, slope

    def merge_heat(self, pair):
        """Return what the merge dissipates, J."""
        return merge_dissipation(pair)

    def keeps_root_unique(self):
        """Return True: the loss is concave in the deficit."""
        return True


class OwnEnergy(Heating):
    """Each sphere gets its own kinetic-energy change plus δW = m*w²(1−e²)/3  [B 4.7–4.9, 6.5–6.10].

    As published, with two faults: a sphere's own kinetic-energy change depends on the frame, and
    δW counts dissipated energy again, so the heat is 7/3 of the loss of a frictionless impact.
    """

    law: Literal["own_energy"] = "own_energy"
    summary: ClassVar[str] = "each its own energy change, as published [B 6.5-6.10]"
    breaks: ClassVar[Mapping[str, str]] = {
        "frame": "as published, a sphere's own kinetic-energy change depends on the frame",
        "energy": "as published, the heat is more than the energy that the pair loses",
    }
    needs = ("heat_capacity", "temperature")
    groups = (HEATING,)

    def impact_heats(self, friction, pair, deficit):
        """Own losses of both plus δW, J."""
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

    def least_heat_slopes(self, friction, pair, lower, upper):
        """Return sums of the least slopes of the own losses and of δW, J."""
        momentum = pair.reduced_mass * pair.approach_speed
        impulse = momentum * (2.0 - upper)
        impulses = (
            tangential_impulse(friction, pair, lower),
            tangential_impulse(friction, pair, upper),
        )
        slopes = impulse_slopes(friction, pair, lower, upper)
        work = momentum * pair.approach_speed * (1.0 - upper) * (2.0 / 3.0)
        own_i = least_own_energy_slope(
            pair.mass_i, pair.normal_i, pair.tangent_i, impulse, momentum, impulses, slopes
        )
        own_j = least_own_energy_slope(
            pair.mass_j, -pair.normal_j, -pair.tangent_j, impulse, momentum, impulses, slopes
        )
        return own_i + work, own_j + work

    def merge_heat(self, pair):
        """Return what both lose together in the merge, and δW at e = 0 for each, J."""
        return merge_dissipation(pair) + normal_loss(pair, 1.0) * (4.0 / 3.0)

    def is_frame_dependent(self):
        """Return True: a sphere's own kinetic-energy change is."""
        return True


class NoHeating(Heating):
    """Grains have no temperature, or keep the one that they start with."""

    law: Literal["none"] = "none"
    summary: ClassVar[str] = "grains keep their temperature"
    is_absent = True

    def impact_heats(self, friction, pair, deficit):
        """0."""
        return 0.0, 0.0

    def least_heat_slopes(self, friction, pair, lower, upper):
        """0."""
        return 0.0, 0.0

    def merge_heat(self, pair):
        """0."""
        return 0.0

    def keeps_root_unique(self):
        """Return True: nothing softens."""
        return True


impact_heats = formula(Heating, Heating.impact_heats)
least_heat_slopes = formula(Heating, Heating.least_heat_slopes)
merge_heat = formula(Heating, Heating.merge_heat)
keeps_root_unique = formula(Heating, Heating.keeps_root_unique)


@inlined
def merge_dissipation(pair: ContactPair) -> float:
    """Kinetic energy ½m*(w² + u_t²) that a merge dissipates, J."""
    square = pair.approach_speed * pair.approach_speed + pair.slip_speed * pair.slip_speed
    return 0.5 * pair.reduced_mass * square


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
