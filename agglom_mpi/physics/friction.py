"""Tangential impulse of friction at an impact, and the energies that both impulses dissipate."""

from typing import NamedTuple

from agglom_mpi.compilation.stages import Submodel, dispatch, inlined
from agglom_mpi.physics.pair import ContactPair


class RestitutionScaledFriction(NamedTuple):
    """μ = μ₀(1 − e)  [A 7]."""

    base: float


class ConstantFriction(NamedTuple):
    """μ = μ₀  [B 4.17]."""

    base: float


@dispatch
def tangential_impulse(model: Submodel | None, pair: ContactPair, deficit: float) -> float:
    """Friction impulse min(μJ, m*|u_t|) in N s, against the slip.

    Neither paper caps it; without the cap friction reverses the slip and makes energy.
    """


@dispatch
def impulse_slopes(
    model: Submodel | None, pair: ContactPair, lower: float, upper: float
) -> tuple[float, float]:
    """Least and largest slope in N s of the friction impulse over the deficits [lower, upper]."""


@inlined
def is_sticking(coefficient: float, pair: ContactPair, deficit: float) -> bool:
    """Whether the Coulomb impulse μJ reaches the one that stops the slip."""
    return coefficient * (2.0 - deficit) * pair.approach_speed >= pair.slip_speed


@inlined
def capped_impulse(coefficient: float, pair: ContactPair, deficit: float) -> float:
    """Coulomb impulse μJ, J = m*(1+e)w, capped at the m*|u_t| that stops the slip; N s."""
    sliding = coefficient * pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
    return min(sliding, pair.reduced_mass * pair.slip_speed)


@tangential_impulse.register(None)
def _frictionless(model, pair, deficit):
    return 0.0


@tangential_impulse.register(RestitutionScaledFriction)
def _restitution_scaled(model, pair, deficit):
    return capped_impulse(model.base * deficit, pair, deficit)


@tangential_impulse.register(ConstantFriction)
def _constant(model, pair, deficit):
    return capped_impulse(model.base, pair, deficit)


@impulse_slopes.register(None)
def _no_slopes(model, pair, lower, upper):
    return 0.0, 0.0


@impulse_slopes.register(RestitutionScaledFriction)
def _restitution_scaled_slopes(model, pair, lower, upper):
    sliding = 2.0 * model.base * pair.reduced_mass * pair.approach_speed
    least = 0.0 if is_sticking(model.base * upper, pair, upper) else sliding * (1.0 - upper)
    most = 0.0 if is_sticking(model.base * lower, pair, lower) else sliding * (1.0 - lower)
    return least, most


@impulse_slopes.register(ConstantFriction)
def _constant_slopes(model, pair, lower, upper):
    sliding = -model.base * pair.reduced_mass * pair.approach_speed
    least = 0.0 if is_sticking(model.base, pair, upper) else sliding
    most = 0.0 if is_sticking(model.base, pair, lower) else sliding
    return least, most


@inlined
def normal_loss(pair: ContactPair, deficit: float) -> float:
    """Kinetic energy ½m*w²(1−e²) that the normal impulse dissipates, J."""
    speed = pair.approach_speed
    return 0.5 * pair.reduced_mass * speed * speed * deficit * (2.0 - deficit)


@inlined
def friction_loss(pair: ContactPair, impulse: float) -> float:
    """Kinetic energy P|u_t| − P²/(2m*) that a tangential impulse P in N s dissipates, J."""
    if impulse == 0.0:  # known when it is compiled for a scene without friction
        return 0.0
    return impulse * (pair.slip_speed - 0.5 * impulse / pair.reduced_mass)
