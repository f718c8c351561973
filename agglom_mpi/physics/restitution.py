"""Coefficient of restitution: the laws, and the equation e = G(e) of the pressure law.

All unknowns of an impact are explicit functions of e, so one impact is one scalar equation. It is
written in the deficit d = 1 − e and in logarithms, ln d = ln r(d), where r = I/(2 a^c H) is the
pressure over twice the hardness. So it keeps its relative accuracy from a nearly elastic impact to
bonding, and no Arrhenius factor overflows.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple

from agglom_mpi.compilation.stages import Submodel, formula, inlined
from agglom_mpi.declaration.components import In, Setting
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.laws import Group, Law, Values
from agglom_mpi.declaration.needed import needed
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
from agglom_mpi.physics.heating import impact_heats, least_heat_slopes
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.reaction import contact_heat

IMPACT_PRESSURE: Final = Group(
    "ρv²/H",
    "impact pressure over hardness",
    {"density": 1.0, "relative_speed": 2.0, "hardness": -1.0},
)


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


class CriticalSpeeds(NamedTuple):
    """Approach speeds in m/s between which two mean grains bounce; nan where there is none.

    Attributes
    ----------
    sticks_to
        They bond at this speed and below.
    bonds_from
        They bond at this speed and above.
    """

    sticks_to: float = math.nan
    bonds_from: float = math.nan


class RestitutionSolution(NamedTuple):
    """A solved impact equation: deficit 1 − e, whether it bonds, residual |e − G(e)|, capped."""

    deficit: float
    bonds: bool
    residual: float
    capped: bool


class Restitution(Law):
    """Law of the coefficient of restitution e of an impact, and of bonding.

    Attributes
    ----------
    needs_contact_pressure
        Whether it solves e = G(e) by the pressure of the contact, so that duration, hardness and
        solver are of use.
    contacts_last
        Whether it asks for the time since the last impact, which particles then keep.
    has_critical_speed
        Whether `critical_speeds` gives one, for the characteristic end time.
    """

    needs_contact_pressure: ClassVar[bool] = False
    contacts_last: ClassVar[bool] = False
    has_critical_speed: ClassVar[bool] = False

    @needed
    def solve_restitution(self, laws: ImpactLaws, pair: ContactPair) -> RestitutionSolution:
        """Deficit 1 − e of a pair under the scene's laws, or bonding."""
        raise NotImplementedError

    def is_still_in_contact(self, pair: ContactPair) -> bool:
        """Whether the pair is still in its last contact, so that it parts without any loss."""
        return False

    def dissipative_time(self, modulus: float) -> float:
        """Return A in s, by which viscosity adds A dF/dt to the elastic force F; 0 without it.

        `modulus` is the contact modulus E* in Pa.
        """
        return 0.0

    def lets_particles_bond(self) -> bool:
        """Whether grains may bond, as far as it is known when a kernel is compiled."""
        return True

    @property
    def keeps_last_impact(self) -> bool:
        """Whether particles of the scene keep the time of their last impact."""
        return False

    @property
    def uses_contact_pressure(self) -> bool:
        """Whether it, or a law within it, solves e = G(e)."""
        laws = (law for _, law in self.with_inner_laws(""))
        return any(isinstance(law, Restitution) and law.needs_contact_pressure for law in laws)

    @property
    def never_bonds(self) -> str | None:
        """Why no grains bond, whatever their speed, in words; None where they may."""
        return None

    @property
    def always_bonds(self) -> str | None:
        """Why all grains bond, whatever their speed, in words; None where they may bounce."""
        return None

    def critical_speeds(
        self, scene: Any, value: Values, exponent: float | None = None
    ) -> CriticalSpeeds:
        """Return the approach speeds that separate bonding from bouncing for two mean grains.

        Parameters
        ----------
        scene
            The `scene` section of a campaign.
        value
            The variables in SI units, by name.
        exponent
            ln(H/H₀), where a hardness decides; that of the starting temperature by default.

        Raises
        ------
        OverflowError
            If the hardness at the starting temperature is no number.
        """
        return CriticalSpeeds()


class PressureRestitution(Restitution):
    """e = max(0, 1 − I/(2 a^c H)), bonding where the pressure reaches 2H  [A 6] [B 3.1, 4.13]."""

    law: Literal["pressure"] = "pressure"
    summary: ClassVar[str] = "by contact pressure over hardness [A 6] [B 3.1, 4.13]"
    groups = (IMPACT_PRESSURE,)
    needs_contact_pressure = True
    has_critical_speed = True

    def critical_speeds(
        self, scene: Any, value: Values, exponent: float | None = None
    ) -> CriticalSpeeds:
        """Return the speed from which two grains bond, at the starting temperature."""
        exponent = scene.hardness.exponent(value) if exponent is None else exponent
        hardness = value["hardness"] * math.exp(exponent)
        duration, area = scene.duration, scene.contact_area.final
        speed = float(duration.bonding_speed(area, hardness, value["density"]))
        return CriticalSpeeds(bonds_from=speed)

    def solve_restitution(self, laws, pair):
        """Root of e = G(e) by the scene's solver."""
        return solve_pressure_law(laws.solver, laws, pair)


class ConstantRestitution(Restitution):
    """The same restitution in every impact; 0 bonds every contact.

    An impact less than `contact_time` (s) after the last one of either partner is elastic, which
    prevents inelastic collapse (TC model, Luding & McNamara, Granular Matter 1, 1998, 113): hard
    spheres that lose energy can collide infinitely often in finite time, and an impact that lasts
    cannot be told from the next one. 0 turns this off.

    Attributes
    ----------
    value
        The restitution e.
    contact_time
        Time after an impact in which the next one of either partner is elastic.
    """

    law: Literal["constant"] = "constant"
    example: ClassVar[str] = "{law: constant, value: 0.8}"
    value: Annotated[float, In("1", at_least=0, at_most=1, meaning="the restitution, 0 to 1")]
    contact_time: Annotated[float, In("s", at_least=0)] = 0.0

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.contact_time > 0.0:
            return "the same, but elastic within contact_time (s) of either's last impact"
        return "the same in every impact"

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield a contact time where nothing bounces."""
        if self.value == 0 and self.contact_time > 0:
            message = f"is {self.contact_time:g} s; must be 0 with value 0, where nothing bounces"
            yield ("contact_time",), message

    def settings(self) -> Iterator[Setting]:
        """Yield the numbers, without a contact time of 0."""
        return (each for each in super().settings() if each[:2] != ("contact_time", 0.0))

    def build(self, value: Values) -> Submodel:
        """Return the numbers as kernels see them, of `LastingContact` if contacts last."""
        if self.contact_time > 0.0:
            return LastingContact.Numbers(self.value, self.contact_time)
        return super().build(value)

    def solve_restitution(self, laws, pair):
        """1 − e is given."""
        return RestitutionSolution(1.0 - self.value, self.value == 0.0, 0.0, False)

    def lets_particles_bond(self):
        """Return False: that would need e = 0."""
        return False

    @property
    def keeps_last_impact(self) -> bool:
        """Whether contacts last."""
        return self.contact_time > 0.0

    @property
    def never_bonds(self) -> str | None:
        """Why no grains bond unless e is 0."""
        return f"a constant restitution of {self.value:g}" if self.value > 0.0 else None

    @property
    def always_bonds(self) -> str | None:
        """Why all grains bond if e is 0."""
        return None if self.value > 0.0 else "a constant restitution of 0"


class LastingContact(ConstantRestitution):
    """Constant restitution as kernels see it where contacts last for `contact_time` in s.

    Elastic means without friction and reaction too. With time steps, all impacts of one step have
    the same time, so that the second of a particle in a step is elastic.
    """

    in_files = False
    contacts_last = True

    def is_still_in_contact(self, pair):
        """Whether either partner had its last impact less than the contact time ago."""
        return pair.time_since_impact < self.contact_time


class Solver(Law):
    """How e = G(e) is solved  [A 6] [B 4.13].

    Attributes
    ----------
    largest_residual
        Largest |e − G(e)| that it leaves where the laws are smooth; inf if it promises none.
    """

    may_be_own = False
    largest_residual: ClassVar[float] = math.inf

    @needed
    def solve_pressure_law(self, laws: ImpactLaws, pair: ContactPair) -> RestitutionSolution:
        """Solution of e = G(e) for a pair, or bonding."""
        raise NotImplementedError


solve_restitution = formula(Restitution, Restitution.solve_restitution)
is_still_in_contact = formula(Restitution, Restitution.is_still_in_contact)
dissipative_time = formula(Restitution, Restitution.dissipative_time)
lets_particles_bond = formula(Restitution, Restitution.lets_particles_bond)
solve_pressure_law = formula(Solver, Solver.solve_pressure_law)


@inlined
def higher_temperature(
    laws: ImpactLaws, pair: ContactPair, heats: tuple[float, float], deficit: float
) -> float:
    """Higher of the two temperatures in K after `heats` in J and the reaction.

    The hotter sphere is the softer one, and H = min(H_i, H_j).
    """
    reaction = contact_heat(laws.reaction, contact_area(laws.contact_area, deficit, pair.radius))
    return max(
        pair.temperature_i + (heats[0] + reaction) / (pair.mass_i * laws.heat_capacity),
        pair.temperature_j + (heats[1] + reaction) / (pair.mass_j * laws.heat_capacity),
    )


@inlined
def log_pressure_scale(laws: ImpactLaws, pair: ContactPair) -> float:
    """Ln X with X = I(e=0)/(2πb²H₀), dimensionless; −inf without approach."""
    strength = 2.0 * math.pi * pair.radius * pair.radius * laws.hardness.hardness
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
    reaction = contact_heat(laws.reaction, contact_area(laws.contact_area, top, pair.radius))
    rise = contact_heat(laws.reaction, area_slope(laws.contact_area, pair.radius))
    capacity_i = pair.mass_i * laws.heat_capacity
    capacity_j = pair.mass_j * laws.heat_capacity
    warm_i = pair.temperature_i + (heats[0] + reaction) / capacity_i
    warm_j = pair.temperature_j + (heats[1] + reaction) / capacity_j
    return min(
        certified_step(laws, scale, warm_i, (slopes[0] + rise) / capacity_i, upper, trial),
        certified_step(laws, scale, warm_j, (slopes[1] + rise) / capacity_j, upper, trial),
    )
