"""Tangential impulse of friction at an impact, and the energies that both impulses dissipate."""

from typing import ClassVar, Literal

from agglom_mpi.compilation.stages import Submodel, formula, inlined
from agglom_mpi.declaration.laws import Law
from agglom_mpi.declaration.needed import needed
from agglom_mpi.physics.pair import ContactPair


class Friction(Law):
    """Law of the tangential impulse, which acts against the slip and at most ends it.

    Neither paper caps it; without the cap friction reverses the slip and makes energy.
    """

    @needed
    def tangential_impulse(self, pair: ContactPair, deficit: float) -> float:
        """Friction impulse in N s of a bounce with 1 − e = `deficit`."""
        raise NotImplementedError

    @needed
    def impulse_slopes(self, pair: ContactPair, lower: float, upper: float) -> tuple[float, float]:
        """Least and largest slope in N s of the impulse over the deficits [lower, upper]."""
        raise NotImplementedError

    def tangential_mass(self, pair: ContactPair) -> float:
        """Impulse in N s per change of the slip in m/s: m* of spheres that do not spin, kg."""
        return pair.reduced_mass

    def least_loss_slope(self, pair: ContactPair, lower: float, upper: float) -> float:
        """Least slope in J of the dissipated tangential energy over the deficits [lower, upper].

        That at `upper`: the loss is concave, without a corner where friction ends the slip.
        """
        left = pair.slip_speed - tangential_impulse(self, pair, upper) / pair.reduced_mass
        return left * impulse_slopes(self, pair, upper, upper)[0]

    def keeps_loss_concave(self) -> bool:
        """Whether the dissipated tangential energy is concave in the deficit."""
        return True


class RestitutionScaledFriction(Friction):
    """μ = μ₀(1 − e)  [A 7]."""

    law: Literal["restitution_scaled"] = "restitution_scaled"
    summary: ClassVar[str] = "mu0 (1 - e), capped where slip ends [A 7]"
    variables = ("friction",)

    def tangential_impulse(self, pair, deficit):
        """min(μJ, m*|u_t|) in N s."""
        return capped_impulse(self.friction * deficit, pair, deficit)

    def impulse_slopes(self, pair, lower, upper):
        """Slopes of μ₀(1 − e)J, 0 where friction ends the slip."""
        sliding = 2.0 * self.friction * pair.reduced_mass * pair.approach_speed
        least = 0.0 if is_sticking(self.friction * upper, pair, upper) else sliding * (1.0 - upper)
        most = 0.0 if is_sticking(self.friction * lower, pair, lower) else sliding * (1.0 - lower)
        return least, most


class ConstantFriction(Friction):
    """μ = μ₀  [B 4.17]."""

    law: Literal["constant"] = "constant"
    summary: ClassVar[str] = "mu0, capped where slip ends [B]"
    variables = ("friction",)

    def tangential_impulse(self, pair, deficit):
        """min(μJ, m*|u_t|) in N s."""
        return capped_impulse(self.friction, pair, deficit)

    def impulse_slopes(self, pair, lower, upper):
        """Slopes of μ₀J, 0 where friction ends the slip."""
        sliding = -self.friction * pair.reduced_mass * pair.approach_speed
        least = 0.0 if is_sticking(self.friction, pair, upper) else sliding
        most = 0.0 if is_sticking(self.friction, pair, lower) else sliding
        return least, most


class NoFriction(Friction):
    """Smooth spheres."""

    law: Literal["none"] = "none"
    summary: ClassVar[str] = "smooth spheres"
    is_absent = True

    def tangential_impulse(self, pair, deficit):
        """0."""
        return 0.0

    def impulse_slopes(self, pair, lower, upper):
        """0."""
        return 0.0, 0.0


tangential_impulse = formula(Friction, Friction.tangential_impulse)
impulse_slopes = formula(Friction, Friction.impulse_slopes)
tangential_mass = formula(Friction, Friction.tangential_mass)
least_loss_slope = formula(Friction, Friction.least_loss_slope)
keeps_loss_concave = formula(Friction, Friction.keeps_loss_concave)


@inlined
def is_sticking(coefficient: float, pair: ContactPair, deficit: float) -> bool:
    """Whether the Coulomb impulse μJ reaches the one that stops the slip."""
    return coefficient * (2.0 - deficit) * pair.approach_speed >= pair.slip_speed


@inlined
def capped_impulse(coefficient: float, pair: ContactPair, deficit: float) -> float:
    """Coulomb impulse μJ, J = m*(1+e)w, capped at the m*|u_t| that stops the slip; N s."""
    sliding = coefficient * pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
    return min(sliding, pair.reduced_mass * pair.slip_speed)


@inlined
def normal_loss(pair: ContactPair, deficit: float) -> float:
    """Kinetic energy ½m*w²(1−e²) that the normal impulse dissipates, J."""
    speed = pair.approach_speed
    return 0.5 * pair.reduced_mass * speed * speed * deficit * (2.0 - deficit)


@inlined
def friction_loss(pair: ContactPair, impulse: float) -> float:
    """Kinetic energy P|u_t| − P²/(2m*) that a tangential impulse P in N s dissipates, J.

    Of spheres that do not spin; `tangential_loss` is that of any law of friction.
    """
    if impulse == 0.0:  # known when it is compiled for a scene without friction
        return 0.0
    return impulse * (pair.slip_speed - 0.5 * impulse / pair.reduced_mass)


@inlined
def tangential_loss(friction: Submodel | None, pair: ContactPair, impulse: float) -> float:
    """Kinetic energy in J, that of spins included, that a tangential impulse P dissipates."""
    if impulse == 0.0:
        return 0.0
    return impulse * (pair.slip_speed - 0.5 * impulse / tangential_mass(friction, pair))
