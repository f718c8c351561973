"""Rough spheres: friction that acts on velocities and spins  (Walton 1993).

O. R. Walton, in Particulate Two-Phase Flow (M. C. Roco, ed.), 1993, 884; S. F. Foerster, M. Y.
Louge, H. Chang and K. Allia, Physics of Fluids 6 (1994) 1108. The slip is that of the surfaces in
contact, the moment of inertia (2/5)mr² that of a solid sphere.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Final, Literal

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.laws import Reported
from agglom_mpi.physics.friction import (
    Friction,
    impulse_slopes,
    tangential_impulse,
    tangential_mass,
)
from agglom_mpi.physics.pair import ContactPair

INERTIA: Final = 0.4
"""Moment of inertia of a solid sphere over mr²."""

MOBILE_SHARE: Final = 2.0 / 7.0
"""Tangential over reduced mass: 1/m* + r_i²/I_i + r_j²/I_j is (7/2)/m* for any two sizes."""


class SpinningFriction(Friction):
    """Base of laws of friction under which grains spin; `pair.slip_speed` is that of the surfaces.

    Attributes
    ----------
    spin_temperature
        Rotational over translational temperature at the start; 0: grains start without spin.
    """

    spin_temperature: Annotated[float, In("1", at_least=0)] = 0.0

    def tangential_mass(self, pair):
        """(2/7)m* of solid spheres, kg: an impulse turns them, too."""
        return MOBILE_SHARE * pair.reduced_mass

    def least_loss_slope(self, pair, lower, upper):
        """Least product of the slip that is left and the slope of the impulse, J.

        The impulse must be monotonic in the deficit.
        """
        mass = tangential_mass(self, pair)
        first = pair.slip_speed - tangential_impulse(self, pair, lower) / mass
        last = pair.slip_speed - tangential_impulse(self, pair, upper) / mass
        least, most = impulse_slopes(self, pair, lower, upper)
        return min(min(first * least, first * most), min(last * least, last * most))

    def keeps_loss_concave(self):
        """Return False: a slip that is reversed loses less."""
        return False


class RoughFriction(SpinningFriction):
    """Sliding contacts by Coulomb, sticking ones by a tangential restitution  (Walton 1993).

    P = min(μJ, (2/7)(1 + β₀)m*|g_t|), g_t the slip of the surfaces: a contact that sticks ends with
    the slip −β₀g_t.

    Attributes
    ----------
    coefficient
        Coefficient μ of sliding contacts.
    tangential
        Tangential restitution β₀ of contacts that stick: −1 smooth, 1 perfectly rough.
    """

    law: Literal["rough"] = "rough"
    example: ClassVar[str] = "{law: rough, coefficient: 0.1, tangential: 0.44}"
    coefficient: Annotated[float, In("1", at_least=0)]
    tangential: Annotated[float, In("1", at_least=-1, at_most=1)]
    summary: ClassVar[str] = "rough spheres that spin: mu, or beta0 of sticking [Walton 1993]"

    def tangential_impulse(self, pair, deficit):
        """min(μJ, (2/7)(1 + β₀)m*|g_t|) in N s."""
        sliding = self.coefficient * pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
        return min(sliding, sticking_impulse(self.tangential, pair))

    def impulse_slopes(self, pair, lower, upper):
        """Slopes of μJ, 0 where the contact sticks."""
        slope = -self.coefficient * pair.reduced_mass * pair.approach_speed
        sticking = sticking_impulse(self.tangential, pair)
        least = 0.0 if -slope * (2.0 - upper) >= sticking else slope
        most = 0.0 if -slope * (2.0 - lower) >= sticking else slope
        return least, most

    def keeps_loss_concave(self):
        """Whether no slip is reversed: the loss has a convex corner where that ends."""
        return self.tangential <= 0.0

    def reported(self) -> Iterator[Reported]:
        """Yield up to which slip over the approach speed contacts stick, at e = 1."""
        note = "slip over approach speed up to which elastic contacts stick, 7 mu/(1 + beta0)"
        if self.tangential > -1.0:
            yield Reported("sticking slip", "1", _sticking_slip, note)


def _sticking_slip(law: Any, scene: Any, value: Mapping[str, float]) -> float:
    """Return (7/2)·2μ/(1 + β₀), where μJ reaches the impulse of a contact that sticks."""
    return float(7.0 * law.coefficient / (1.0 + law.tangential))


@inlined
def sticking_impulse(tangential: float, pair: ContactPair) -> float:
    """Impulse (2/7)(1 + β₀)m*|g_t| in N s that leaves the slip −β₀g_t, β₀ = `tangential`."""
    return MOBILE_SHARE * (1.0 + tangential) * pair.reduced_mass * pair.slip_speed
