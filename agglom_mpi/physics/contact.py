"""Area, duration and mean force of the contact of two spheres."""

import math
from typing import NamedTuple

from agglom_mpi.compilation.stages import Submodel, dispatch, inlined
from agglom_mpi.physics.pair import ContactPair


class ContactArea(NamedTuple):
    """a^c = A(e)·πb², A(e) = a₀ + (a_f − a₀)(1 − e), with 0 ≤ a₀ ≤ a_f  [A 11] [B 4.12]."""

    initial: float
    final: float


@inlined
def area_fraction(model: ContactArea, deficit: float) -> float:
    """A(e): contact area over the cross section πb² of the smaller sphere, at 1 − e = `deficit`."""
    return model.initial + (model.final - model.initial) * deficit


@inlined
def area_slope(model: ContactArea, radius: float) -> float:
    """Change of the contact area with the deficit, (a_f − a₀)πb², in m²."""
    return (model.final - model.initial) * math.pi * radius * radius


@inlined
def contact_area(model: ContactArea, deficit: float, radius: float) -> float:
    """Contact area A(e)·πb² in m², b the smaller `radius` in m  [A 11] [B 4.12]."""
    return area_fraction(model, deficit) * math.pi * radius * radius


class MeanSpeedDuration(NamedTuple):
    """δt = 2εb/((1+e)w): a length εb at the mean of approach and separation speed  [A 12]."""

    length_ratio: float


class CompressionRecoveryDuration(NamedTuple):
    """δt = (1+e)·2βb/w: compression over βb, then e times as long to recover  [B 4.10]."""

    length_ratio: float


@dispatch
def force_scale(model: Submodel, pair: ContactPair) -> float:
    """Mean force J/δt at e = 0, m*w²/(2εb), in N  [A 6, 12] [B 3.1, 4.10]."""


@dispatch
def restitution_factor(model: Submodel, restitution: float) -> float:
    """Mean force over that at e = 0, dimensionless; does not fall with e."""


@dispatch
def restitution_factor_slope(model: Submodel, deficit: float) -> float:
    """−d ln(restitution factor)/d ln d, dimensionless; does not fall with the deficit d."""


@force_scale.register(MeanSpeedDuration, CompressionRecoveryDuration)
def _plastic_force(model, pair):
    energy = pair.reduced_mass * pair.approach_speed * pair.approach_speed
    return energy / (2.0 * model.length_ratio * pair.radius)


@restitution_factor.register(MeanSpeedDuration)
def _mean_speed_factor(model, restitution):
    return (1.0 + restitution) * (1.0 + restitution)


@restitution_factor.register(CompressionRecoveryDuration)
def _compression_recovery_factor(model, restitution):
    return 1.0


@restitution_factor_slope.register(MeanSpeedDuration)
def _mean_speed_slope(model, deficit):
    return 2.0 * deficit / (2.0 - deficit)


@restitution_factor_slope.register(CompressionRecoveryDuration)
def _compression_recovery_slope(model, deficit):
    return 0.0
