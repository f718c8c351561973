"""Coefficient of restitution: the laws, and the equation e = G(e) of the pressure law.

All unknowns of an impact are explicit functions of e, so one impact is one scalar equation. It is
written in the deficit d = 1 − e and in logarithms, ln d = ln r(d), where r = I/(2 a^c H) is the
pressure over twice the hardness. So it keeps its relative accuracy from a nearly elastic impact to
bonding, and no Arrhenius factor overflows.
"""

import math
from typing import Any, NamedTuple

from agglom_mpi.compilation.stages import Submodel, dispatch, inlined
from agglom_mpi.physics.contact import (
    ContactArea,
    area_fraction,
    area_slope,
    contact_area,
    force_scale,
    restitution_factor,
    restitution_factor_slope,
)
from agglom_mpi.physics.hardness import log_hardening, softening_rate
from agglom_mpi.physics.heating import impact_heats, least_heat_slopes, reaction_heat
from agglom_mpi.physics.pair import ContactPair


class ImpactLaws(NamedTuple):
    """The submodels of a scene that decide an impact; `None` for what the scene leaves out.

    `heat_capacity` C in J/(kg K) is inf where nothing heats.
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


class RestitutionSolution(NamedTuple):
    """A solved impact equation: deficit 1 − e, whether it bonds, residual |e − G(e)|, capped."""

    deficit: float
    bonds: bool
    residual: float
    capped: bool


@dispatch
def solve_restitution(model: Submodel, laws: ImpactLaws, pair: ContactPair) -> RestitutionSolution:
    """Deficit 1 − e of a pair under the scene's laws, or bonding."""


@dispatch
def is_still_in_contact(model: Submodel, pair: ContactPair) -> bool:
    """Whether the pair is still in its last contact, so that it parts without any loss."""


@dispatch
def solve_pressure_law(
    solver: Submodel, laws: ImpactLaws, pair: ContactPair
) -> RestitutionSolution:
    """Solve e = G(e) by the scene's solver  [A 6] [B 4.13]."""


@is_still_in_contact.register(ConstantRestitution, PressureRestitution)
def _instantaneous(model, pair):
    return False


@is_still_in_contact.register(ContactTimeRestitution)
def _within_contact_time(model, pair):
    return pair.time_since_impact < model.contact_time


@solve_restitution.register(ConstantRestitution, ContactTimeRestitution)
def _constant(model, laws, pair):
    return RestitutionSolution(1.0 - model.value, model.value == 0.0, 0.0, False)


@solve_restitution.register(PressureRestitution)
def _pressure(model, laws, pair):
    return solve_pressure_law(laws.solver, laws, pair)


@inlined
def higher_temperature(
    laws: ImpactLaws, pair: ContactPair, heats: tuple[float, float], deficit: float
) -> float:
    """Higher of the two temperatures in K after `heats` in J and the reaction.

    The hotter sphere is the softer one, and H = min(H_i, H_j).
    """
    reaction = reaction_heat(laws.reaction, contact_area(laws.contact_area, deficit, pair.radius))
    return max(
        pair.temperature_i + (heats[0] + reaction) / (pair.mass_i * laws.heat_capacity),
        pair.temperature_j + (heats[1] + reaction) / (pair.mass_j * laws.heat_capacity),
    )


@inlined
def log_pressure_scale(laws: ImpactLaws, pair: ContactPair) -> float:
    """Ln X with X = I(e=0)/(2πb²H₀), dimensionless; −inf without approach."""
    strength = 2.0 * math.pi * pair.radius * pair.radius * laws.hardness.base
    ratio = force_scale(laws.duration, pair) / strength
    return math.log(ratio) if ratio > 0.0 else -math.inf


@inlined
def log_ratio_at_temperature(
    laws: ImpactLaws, scale: float, temperature: float, deficit: float
) -> float:
    """Ln r from ln X, the temperature after the impact in K, and the deficit; +inf at area 0."""
    area = area_fraction(laws.contact_area, deficit)
    if area <= 0.0:
        return math.inf
    shape = math.log(restitution_factor(laws.duration, 1.0 - deficit) / area)
    return scale + shape - log_hardening(laws.hardness, temperature)


@inlined
def log_pressure_ratio(laws: ImpactLaws, pair: ContactPair, scale: float, deficit: float) -> float:
    """Ln r(d): pressure of an impact with this deficit over twice its hardness; r(1) ≥ 1 bonds."""
    heats = impact_heats(laws.heating, laws.friction, pair, deficit)
    return log_ratio_at_temperature(
        laws, scale, higher_temperature(laws, pair, heats, deficit), deficit
    )


@inlined
def certified_step(
    laws: ImpactLaws, scale: float, temperature: float, slope: float, upper: float, trial: float
) -> float:
    """Way down in ln d from `upper`, at most `trial`, over which r < d holds; 0 if not proven.

    For one sphere whose temperature at d is at most that of the straight line of `slope` in K
    through `temperature` in K at `upper`. Proven either by the highest temperature over the whole
    way, or by the steepest rise of ln r − ln d over it.
    """
    top, bottom = math.exp(upper), math.exp(upper - trial)
    end = temperature - slope * (top - bottom)
    if log_ratio_at_temperature(laws, scale, max(temperature, end), bottom) < upper - trial:
        return trial
    gap = upper - log_ratio_at_temperature(laws, scale, temperature, top)
    if temperature <= 0.0 or gap <= 0.0:
        return 0.0
    softening = top * softening_rate(laws.hardness, temperature)
    if slope > 0.0 and end > 0.0:  # d/θ² rises, then falls along a rising line
        softening = min(softening, bottom * softening_rate(laws.hardness, end))
    area = laws.contact_area
    widening = (area.final - area.initial) * top / area_fraction(area, top)
    rise = 1.0 + restitution_factor_slope(laws.duration, top) + widening - slope * softening
    return min(trial, gap / rise) if rise > 0.0 else trial


@inlined
def root_free_step(
    laws: ImpactLaws, pair: ContactPair, scale: float, upper: float, trial: float
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
        certified_step(laws, scale, warm_i, (slopes[0] + rise) / capacity_i, upper, trial),
        certified_step(laws, scale, warm_j, (slopes[1] + rise) / capacity_j, upper, trial),
    )
