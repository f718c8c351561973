"""How much of the approach speed comes back?  One impact is one scalar equation e = G(e).

Everything here works with the deficit d = 1 − e and with logarithms: the equation of the pressure
law is ln d = ln r(d), where r = I/(2 a^c H) is the pressure over twice the hardness. It keeps its
relative accuracy from a nearly elastic impact to bonding, and no Arrhenius factor overflows.
"""

import math
from typing import Any, NamedTuple

from agglom_mpi.compilation import Submodel, question, stage
from agglom_mpi.physics.contact_area import (
    ContactArea,
    area_fraction,
    area_slope,
    contact_area,
)
from agglom_mpi.physics.duration import force_fall, force_scale, force_shape
from agglom_mpi.physics.encounter import Encounter
from agglom_mpi.physics.hardness import log_hardening, softening_rate
from agglom_mpi.physics.heating import impact_heats, least_heat_slopes
from agglom_mpi.physics.reaction import reaction_heat


class ImpactLaws(NamedTuple):
    """The submodels of a scene that decide an impact; `None` for what the scene leaves out.

    `heat_capacity` in J/(kg K) is inf where nothing heats.
    """

    restitution: Submodel
    duration: Submodel | None
    contact_area: ContactArea
    hardness: Any
    friction: Submodel | None
    heating: Submodel | None
    reaction: Submodel | None
    fragmentation: Submodel | None
    solver: Submodel | None
    heat_capacity: float


class PressureRestitution(NamedTuple):
    """e = max(0, 1 − I/(2 a^c H)), bonding where the pressure reaches 2H  [A 6] [B 3.1, 4.13]."""


class ConstantRestitution(NamedTuple):
    """A given coefficient of restitution; 0 bonds. For verification and comparison."""

    value: float


class ContactTimeRestitution(NamedTuple):
    """As `ConstantRestitution`, but elastic within `contact_time` in s of either's last impact.

    Elastic means without friction and reaction too. With time steps, all impacts of one step have
    the same time, so that the second of a particle in a step is elastic.

    Hard spheres that lose energy can collide infinitely often in finite time; an impact that lasts
    cannot be told from the next one: the TC model (Luding & McNamara, Granular Matter 1, 1998,
    113).
    """

    value: float
    contact_time: float


class Solution(NamedTuple):
    """A solved impact equation: deficit 1 − e, whether it bonds, residual |e − G(e)|, capped."""

    deficit: float
    bonds: bool
    residual: float
    capped: bool


@question
def solve_restitution(model: Submodel, laws: ImpactLaws, pair: Encounter) -> Solution:
    """Restitution of a pair under the scene's laws."""


@question
def lasts(model: Submodel, pair: Encounter) -> bool:
    """Whether the pair is still in its last contact, so that it parts without any loss."""


@question
def solve_pressure_law(solver: Submodel, laws: ImpactLaws, pair: Encounter) -> Solution:
    """Solve e = G(e) by the scene's solver."""


@lasts.answer(ConstantRestitution, PressureRestitution)
def _instantaneous(model, pair):  # type: ignore[no-untyped-def]
    return False


@lasts.answer(ContactTimeRestitution)
def _within_contact_time(model, pair):  # type: ignore[no-untyped-def]
    return pair.since < model.contact_time


@solve_restitution.answer(ConstantRestitution, ContactTimeRestitution)
def _constant(model, laws, pair):  # type: ignore[no-untyped-def]
    return Solution(1.0 - model.value, model.value == 0.0, 0.0, False)


@solve_restitution.answer(PressureRestitution)
def _pressure(model, laws, pair):  # type: ignore[no-untyped-def]
    return solve_pressure_law(laws.solver, laws, pair)


@stage
def hottest(laws: ImpactLaws, pair: Encounter, heats: tuple[float, float], deficit: float) -> float:
    """Higher of the two temperatures in K after `heats` and the reaction; the softer decides."""
    reaction = reaction_heat(laws.reaction, contact_area(laws.contact_area, deficit, pair.radius))
    return max(
        pair.temperature_i + (heats[0] + reaction) / (pair.mass_i * laws.heat_capacity),
        pair.temperature_j + (heats[1] + reaction) / (pair.mass_j * laws.heat_capacity),
    )


@stage
def log_pressure_scale(laws: ImpactLaws, pair: Encounter) -> float:
    """Ln X with X = I(e=0)/(2πb²H₀), dimensionless; −inf without approach."""
    strength = 2.0 * math.pi * pair.radius * pair.radius * laws.hardness.base
    ratio = force_scale(laws.duration, pair) / strength
    return math.log(ratio) if ratio > 0.0 else -math.inf


@stage
def log_bracketed(laws: ImpactLaws, scale: float, temperature: float, deficit: float) -> float:
    """Ln r from ln X, the temperature after the impact in K, and the deficit; +inf at area 0."""
    area = area_fraction(laws.contact_area, deficit)
    if area <= 0.0:
        return math.inf
    shape = math.log(force_shape(laws.duration, 1.0 - deficit) / area)
    return scale + shape - log_hardening(laws.hardness, temperature)


@stage
def log_pressure_ratio(laws: ImpactLaws, pair: Encounter, scale: float, deficit: float) -> float:
    """Ln r(d): pressure of an impact with this deficit over twice its hardness; r(1) ≥ 1 bonds."""
    heats = impact_heats(laws.heating, laws.friction, pair, deficit)
    return log_bracketed(laws, scale, hottest(laws, pair, heats, deficit), deficit)


@stage
def proven_step(
    laws: ImpactLaws, scale: float, temperature: float, slope: float, upper: float, trial: float
) -> float:
    """Way down in ln d from `upper`, at most `trial`, over which r < d holds; 0 if not proven.

    For one sphere whose temperature at d is at most that of the straight line of `slope` in K
    through `temperature` in K at `upper`. Proven either by the highest temperature over the whole
    way, or by the steepest rise of ln r − ln d over it.
    """
    top, bottom = math.exp(upper), math.exp(upper - trial)
    end = temperature - slope * (top - bottom)
    if log_bracketed(laws, scale, max(temperature, end), bottom) < upper - trial:
        return trial
    gap = upper - log_bracketed(laws, scale, temperature, top)
    if temperature <= 0.0 or gap <= 0.0:
        return 0.0
    softening = top * softening_rate(laws.hardness, temperature)
    if slope > 0.0 and end > 0.0:  # d/θ² rises, then falls along a rising line
        softening = min(softening, bottom * softening_rate(laws.hardness, end))
    area = laws.contact_area
    widening = (area.final - area.initial) * top / area_fraction(area, top)
    rise = 1.0 + force_fall(laws.duration, top) + widening - slope * softening
    return min(trial, gap / rise) if rise > 0.0 else trial


@stage
def rootless_step(
    laws: ImpactLaws, pair: Encounter, scale: float, upper: float, trial: float
) -> float:
    """Way down in ln d from `upper`, at most `trial`, that holds no root; 0 if not proven."""
    top, bottom = math.exp(upper), math.exp(upper - trial)
    heats = impact_heats(laws.heating, laws.friction, pair, top)
    slopes = least_heat_slopes(laws.heating, laws.friction, pair, bottom, top)
    reaction = reaction_heat(laws.reaction, contact_area(laws.contact_area, top, pair.radius))
    rise = reaction_heat(laws.reaction, area_slope(laws.contact_area, pair.radius))
    capacity_i = pair.mass_i * laws.heat_capacity
    capacity_j = pair.mass_j * laws.heat_capacity
    warm_i = pair.temperature_i + (heats[0] + reaction) / capacity_i
    warm_j = pair.temperature_j + (heats[1] + reaction) / capacity_j
    return min(
        proven_step(laws, scale, warm_i, (slopes[0] + rise) / capacity_i, upper, trial),
        proven_step(laws, scale, warm_j, (slopes[1] + rise) / capacity_j, upper, trial),
    )
