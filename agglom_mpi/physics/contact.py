"""Area, duration and mean force of the contact of two spheres."""

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from agglom_mpi.compilation.stages import Submodel, formula, inlined
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.laws import Law
from agglom_mpi.declaration.needed import needed
from agglom_mpi.physics.pair import ContactPair


class ContactArea(Law):
    """a^c = A(e)·πb², A(e) = a₀ + (a_f − a₀)(1 − e), with 0 ≤ a₀ ≤ a_f  [A 11] [B 4.12].

    Attributes
    ----------
    initial
        a₀, the fraction in an elastic impact.
    final
        a_f, the fraction where nothing is restored, e = 0.
    """

    initial: Annotated[float, In("1", at_least=0)] = 0.0
    final: Annotated[float, In("1", above=0)] = 1.0
    summary: ClassVar[str] = "grows as restitution falls [A 11] [B 4.12]"

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield an area that shrinks."""
        if self.initial > self.final:
            yield (
                ("initial",),
                f"is {self.initial:g}; must be at most final, which is {self.final:g}",
            )


@inlined
def area_fraction(model: Submodel, deficit: float) -> float:
    """A(e): contact area over the cross section πb² of the smaller sphere, at 1 − e = `deficit`."""
    return model.initial + (model.final - model.initial) * deficit


@inlined
def area_slope(model: Submodel, radius: float) -> float:
    """Change of the contact area with the deficit, (a_f − a₀)πb², in m²."""
    return (model.final - model.initial) * math.pi * radius * radius


@inlined
def contact_area(model: Submodel, deficit: float, radius: float) -> float:
    """Contact area A(e)·πb² in m², b the smaller `radius` in m  [A 11] [B 4.12]."""
    return area_fraction(model, deficit) * math.pi * radius * radius


class Duration(Law):
    """Law of the duration of a contact, which sets its mean force.

    Attributes
    ----------
    takes_published_steps
        Whether it is that of [A], which takes 200 equal time steps.
    """

    takes_published_steps: ClassVar[bool] = False

    @needed
    def force_scale(self, pair: ContactPair) -> float:
        """Mean force J/δt at e = 0 in N."""
        raise NotImplementedError

    @needed
    def restitution_factor(self, restitution: float) -> float:
        """Mean force over that at e = 0, dimensionless; must not fall with e."""
        raise NotImplementedError

    @needed
    def restitution_factor_slope(self, deficit: float) -> float:
        """−d ln(restitution factor)/d ln d, dimensionless; must not fall with the deficit d."""
        raise NotImplementedError

    def pressure(self, density: float, speed: float) -> float:
        """Return the mean pressure in Pa of two equal grains that meet, with e = 0.

        Over the cross section of a grain: I/(πb²), which must not depend on the radius b.

        Parameters
        ----------
        density
            Of the grains, kg/m³.
        speed
            Speed w at which they approach each other head on, m/s.
        """
        mass = 4.0 / 3.0 * math.pi * density
        pair = ContactPair(speed, 0.0, mass, mass, 0.5 * mass, 1.0, 1.0, 1.0, *[0.0] * 6)
        return force_scale(self.build({}), pair) / math.pi

    @property
    def decisive_number(self) -> tuple[FieldPath, str, str]:
        """Field and value that most decide the pressure, and what is usual, for warnings."""
        return (), repr(self.name), ""

    def bonding_speed(self, area: float, hardness: float, density: float) -> float:
        """Return the speed in m/s from which two equal grains bond: their pressure is 2 a_f H.

        By bisection of its logarithm; the pressure must rise with the speed.

        Parameters
        ----------
        area
            a_f, contact area over the cross section at e = 0.
        hardness
            H in Pa.
        density
            Of the grains, kg/m³.
        """
        low, high = -300.0, 300.0
        for _ in range(100):
            middle = 0.5 * (low + high)
            below = self.pressure(density, math.exp(middle)) < 2.0 * area * hardness
            low, high = (middle, high) if below else (low, middle)
        return math.exp(0.5 * (low + high))


LengthRatio = Annotated[float, In("1", above=0)]
"""β, the length over which grains move while they compress, over the smaller radius."""


class LengthDuration(Duration):
    """Base of durations in which grains move over `length_ratio` β radii while they compress.

    Attributes
    ----------
    length_ratio
        Length over which grains move while they compress, over the smaller radius: ε of [A], β of
        [B].
    """

    length_ratio: LengthRatio = 1.0

    def force_scale(self, pair):
        """m*w²/(2βb) in N  [A 6, 12] [B 3.1, 4.10]."""
        energy = pair.reduced_mass * pair.approach_speed * pair.approach_speed
        return energy / (2.0 * self.length_ratio * pair.radius)

    @property
    def decisive_number(self) -> tuple[FieldPath, str, str]:
        """The length ratio, and those of the papers."""
        usual = "; usual are 1e-6 [A] and, for soft grains, 1 [B]"
        return ("length_ratio",), f"{self.length_ratio:g}", usual

    def bonding_speed(self, area: float, hardness: float, density: float) -> float:
        """Return √(6 a_f H β/ρ) in m/s, where ρw²/(6β) reaches a_f H."""
        return math.sqrt(6.0 * area * hardness * self.length_ratio / density)


class MeanSpeedDuration(LengthDuration):
    """δt = 2εb/((1+e)w): a length εb at the mean of approach and separation speed  [A 12]."""

    law: Literal["mean_speed"] = "mean_speed"
    length_ratio: LengthRatio = 1e-6
    takes_published_steps = True
    summary: ClassVar[str] = "length over the mean speed [A 12]"

    def restitution_factor(self, restitution):
        """(1 + e)²."""
        return (1.0 + restitution) * (1.0 + restitution)

    def restitution_factor_slope(self, deficit):
        """2d/(2 − d)."""
        return 2.0 * deficit / (2.0 - deficit)


class CompressionRecoveryDuration(LengthDuration):
    """δt = (1+e)·2βb/w: compression over βb, then e times as long to recover  [B 4.10]."""

    law: Literal["compression_recovery"] = "compression_recovery"
    summary: ClassVar[str] = "compression, then recovery [B 4.10]"

    def restitution_factor(self, restitution):
        """1: e times as long, (1 + e) times the impulse."""
        return 1.0

    def restitution_factor_slope(self, deficit):
        """0: the factor is constant."""
        return 0.0


force_scale = formula(Duration, Duration.force_scale)
restitution_factor = formula(Duration, Duration.restitution_factor)
restitution_factor_slope = formula(Duration, Duration.restitution_factor_slope)
