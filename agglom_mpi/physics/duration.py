"""How long do two spheres touch?  The duration sets the mean force of an impact."""

from typing import NamedTuple

from agglom_mpi.compilation import Submodel, question
from agglom_mpi.physics.encounter import Encounter


class MeanSpeedDuration(NamedTuple):
    """δt = 2εb / ((1+e)w): the mean of approach and separation speed over a length εb  [A 12]."""

    length_ratio: float


class CompressionRecoveryDuration(NamedTuple):
    """δt = (1+e)·2βb/w: compression over βb, then e times as long to recover  [B 4.10]."""

    length_ratio: float


@question
def force_scale(model: Submodel, pair: Encounter) -> float:
    """Mean force J/δt of a perfectly plastic impact, m*w²/(2εb), in N  [A 6, 12] [B 3.1, 4.10]."""


@question
def force_shape(model: Submodel, restitution: float) -> float:
    """Mean force over that of a perfectly plastic impact, dimensionless; never falls with e."""


@question
def force_fall(model: Submodel, deficit: float) -> float:
    """−d ln(force shape)/d ln d at the deficit d = 1 − e, dimensionless; never falls with d."""


@force_scale.answer(MeanSpeedDuration, CompressionRecoveryDuration)
def _plastic_force(model, pair):  # type: ignore[no-untyped-def]
    energy = pair.reduced_mass * pair.approach_speed * pair.approach_speed
    return energy / (2.0 * model.length_ratio * pair.radius)


@force_shape.answer(MeanSpeedDuration)
def _mean_speed_shape(model, restitution):  # type: ignore[no-untyped-def]
    return (1.0 + restitution) * (1.0 + restitution)


@force_shape.answer(CompressionRecoveryDuration)
def _compression_recovery_shape(model, restitution):  # type: ignore[no-untyped-def]
    return 1.0


@force_fall.answer(MeanSpeedDuration)
def _mean_speed_fall(model, deficit):  # type: ignore[no-untyped-def]
    return 2.0 * deficit / (2.0 - deficit)


@force_fall.answer(CompressionRecoveryDuration)
def _compression_recovery_fall(model, deficit):  # type: ignore[no-untyped-def]
    return 0.0
