"""Hardness of a grain as a function of its temperature."""

import math
from typing import NamedTuple

from agglom_mpi.compilation.stages import Submodel, dispatch
from agglom_mpi.physics.constants import GAS_CONSTANT


class ConstantHardness(NamedTuple):
    """H = H₀, Pa."""

    base: float


class ArrheniusHardness(NamedTuple):
    """H = H₀ exp(U/(Rθ)), Pa; H₀ is the hot limit  [A section 4] [B section 6]."""

    base: float
    activation_energy: float


@dispatch
def log_hardening(model: Submodel, temperature: float) -> float:
    """ln(H/H₀) at `temperature` in K, dimensionless; +inf at and below 0 K if U > 0."""


@dispatch
def softening_rate(model: Submodel, temperature: float) -> float:
    """−d ln H/dθ in 1/K at `temperature` > 0 K."""


@log_hardening.register(ConstantHardness)
def _not_hardened(model, temperature):
    return 0.0


@log_hardening.register(ArrheniusHardness)
def _arrhenius(model, temperature):
    if model.activation_energy == 0.0:
        return 0.0
    if temperature <= 0.0:
        return math.inf
    return model.activation_energy / (GAS_CONSTANT * temperature)


@softening_rate.register(ConstantHardness)
def _constant_softening(model, temperature):
    return 0.0


@softening_rate.register(ArrheniusHardness)
def _arrhenius_rate(model, temperature):
    return model.activation_energy / (GAS_CONSTANT * temperature) / temperature
