"""Laws that the package does not have: two restitutions, a friction and a cooling.

A campaign beside this file names them `laws.py:Class`. Formulas are compiled into the kernels,
where `self` has the numbers of the law and its variables alone.
"""

import math
from typing import Annotated, ClassVar

from agglom_mpi.components import (
    Cooling,
    Friction,
    In,
    Restitution,
    RestitutionSolution,
    inlined,
)


class SpeedRestitution(Restitution):
    """e = min(1, (w₁/w)^¼) of the approach speed w, `speed` w₁ in m/s  (Johnson 1985, § 11.5)."""

    speed: Annotated[float, In("m/s", above=0)] = 1.0
    summary: ClassVar[str] = "falls with the fourth root of the approach speed"

    def solve_restitution(self, laws, pair):
        """Return e by the approach speed alone."""
        deficit = 1.0 - min(1.0, (self.speed / pair.approach_speed) ** 0.25)
        return RestitutionSolution(deficit, False, 0.0, False)


class DustSticking(Restitution):
    """e = √(1 − (w_s/w)²), sticking at and below the speed w_s  (Thornton & Ning 1998).

    An elastic adhesive sphere loses the energy ½m*w_s² when the contact breaks, whatever its
    speed. They derive w_s from surface energy, modulus and size; here it is the number `sticking`.
    C. Thornton and Z. Ning, Powder Technology 99 (1998) 154.
    """

    sticking: Annotated[float, In("m/s", above=0, meaning="a speed like '1 m/s'")]
    summary: ClassVar[str] = "sticks below a speed, then loses that energy [Thornton & Ning 1998]"

    def solve_restitution(self, laws, pair):
        """Return e by the approach speed, or bonding."""
        ratio = self.sticking / pair.approach_speed
        if ratio >= 1.0:
            return RestitutionSolution(1.0, True, 0.0, False)
        lost = ratio * ratio  # 1 − e²
        return RestitutionSolution(lost / (1.0 + math.sqrt(1.0 - lost)), False, 0.0, False)


class RollingFriction(Friction):
    """Friction μ of contacts that slide, and rolling of all others  (Walton 1993).

    P = min(μJ, (2/7)(1 + β₀)m*|u_t|): what changes the spin of a solid sphere leaves the rest of
    the slip. β₀ is the tangential restitution of contacts that do not slide; S. F. Foerster et al.,
    Physics of Fluids 6 (1994) 1108, measured 0.44 for glass. Spins are not followed: the energy
    that they would take counts as lost.
    """

    rolling: Annotated[float, In("1", at_least=-1, at_most=1)] = 0.44
    summary: ClassVar[str] = "mu0, or 2/7 (1 + rolling) of the slip [Walton 1993]"
    variables = ("friction",)

    def tangential_impulse(self, pair, deficit):
        """min(μJ, (2/7)(1 + β₀)m*|u_t|) in N s."""
        sliding = self.friction * pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
        return min(sliding, rolling_impulse(self.rolling, pair))

    def impulse_slopes(self, pair, lower, upper):
        """Slopes of μJ over the deficits, 0 where the contact rolls."""
        slope, rolls = (
            -self.friction * pair.reduced_mass * pair.approach_speed,
            rolling_impulse(self.rolling, pair),
        )
        least = 0.0 if -slope * (2.0 - upper) >= rolls else slope
        most = 0.0 if -slope * (2.0 - lower) >= rolls else slope
        return least, most


@inlined
def rolling_impulse(rolling: float, pair) -> float:
    """Tangential impulse of a contact that does not slide, N s."""
    return 2.0 / 7.0 * (1.0 + rolling) * pair.reduced_mass * pair.slip_speed


class FreeConvection(Cooling):
    """m C θ' = −h₁ a_s |θ − θ_o|^¼ (θ − θ_o)/Δ^¼: laminar free convection  (Lorenz 1881).

    h rises with the fourth root of the difference to the gas; `convection` h₁ is that at the
    `difference` Δ, the gas has the temperature `ambient` θ_o. L. Lorenz, Annalen der Physik 249
    (1881) 582; F. P. Incropera et al., Fundamentals of Heat and Mass Transfer, § 9.6.
    """

    convection: Annotated[float, In("W/m^2/K", above=0)]
    difference: Annotated[float, In("K", above=0)] = 1.0
    ambient: Annotated[float, In("K", at_least=0)] = 300.0
    summary: ClassVar[str] = "free convection, by the 5/4 power of the difference [Lorenz 1881]"

    def cooling_rate(self, temperature, surface, capacity):
        """Convected power over the heat capacity, K/s."""
        away = temperature - self.ambient
        return self.convection * surface / capacity * (abs(away) / self.difference) ** 0.25 * away

    def exact_temperature(self, temperature, surface, capacity, time):
        """Let the difference fall as (1 + kt/4)^−4, k = −θ'/(θ − θ_o) at the start."""
        away = temperature - self.ambient
        rate = self.convection * surface / capacity * (abs(away) / self.difference) ** 0.25
        return self.ambient + away * (1.0 + 0.25 * rate * time) ** -4.0

    def rest_temperature(self):
        """Temperature of the gas."""
        return self.ambient
