"""The laws of a scene: one section a law, with its keys, summary and `build` for kernels.

Kernels are imported when a law is built, so that checking a campaign loads no compiler.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from agglom_mpi.config.groups import (
    FRAGMENTATION,
    HEATING,
    IMPACT_PRESSURE,
    REACTION,
    SOFTENING,
    Group,
)
from agglom_mpi.declaration.sections import NAMED, NAMED_OR_NONE, FieldError, Section, WholeNumber
from agglom_mpi.declaration.units import HeatTransfer, Number, Temperature, Time

if TYPE_CHECKING:
    from agglom_mpi.compilation.stages import Submodel

Values = Mapping[str, float]
"""The ten variables in SI units, by name."""


class PressureRestitution(Section):
    """Restitution by contact pressure over hardness [A 6] [B 3.1, 4.13]."""

    law: Literal["pressure"] = "pressure"
    summary: ClassVar[str] = "by contact pressure over hardness [A 6] [B 3.1, 4.13]"
    groups: ClassVar[tuple[Group, ...]] = (IMPACT_PRESSURE,)

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import restitution

        return restitution.PressureRestitution()


class ConstantRestitution(Section):
    """The same restitution in every impact; 0 bonds every contact.

    An impact less than `contact_time` (s) after the last one of either partner is elastic, which
    prevents inelastic collapse (TC model, Luding & McNamara 1998); 0 turns this off.
    """

    law: Literal["constant"]
    value: Annotated[Number, Field(ge=0, le=1, description="the restitution, 0 to 1")]
    contact_time: Annotated[Time, Field(ge=0)] = 0.0

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.contact_time > 0.0:
            return "the same, but elastic within contact_time (s) of either's last impact"
        return "the same in every impact"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import restitution

        if self.contact_time > 0.0:
            return restitution.ContactTimeRestitution(self.value, self.contact_time)
        return restitution.ConstantRestitution(self.value)

    @model_validator(mode="after")
    def _bounces(self) -> Self:
        if self.value == 0 and self.contact_time > 0:
            message = f"is {self.contact_time:g} s; must be 0 with value 0, where nothing bounces"
            raise FieldError((("contact_time",), message))
        return self


class MeanSpeedDuration(Section):
    """Contact duration: time for `length_ratio` radii at the mean speed [A 12]."""

    law: Literal["mean_speed"]
    length_ratio: Annotated[Number, Field(gt=0)] = 1e-6
    summary: ClassVar[str] = "length over the mean speed [A 12]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import contact

        return contact.MeanSpeedDuration(self.length_ratio)


class CompressionRecoveryDuration(Section):
    """Contact duration: compression at the approach speed, then recovery [B 4.10]."""

    law: Literal["compression_recovery"] = "compression_recovery"
    length_ratio: Annotated[Number, Field(gt=0)] = 1.0
    summary: ClassVar[str] = "compression, then recovery [B 4.10]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import contact

        return contact.CompressionRecoveryDuration(self.length_ratio)


class ContactArea(Section):
    """Contact area over the smaller sphere's disc, at e = 1 and e = 0 [A 11] [B 4.12]."""

    initial: Annotated[Number, Field(ge=0)] = 0.0
    final: Annotated[Number, Field(gt=0)] = 1.0
    summary: ClassVar[str] = "grows as restitution falls [A 11] [B 4.12]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import contact

        return contact.ContactArea(self.initial, self.final)

    @model_validator(mode="after")
    def _grows(self) -> Self:
        if self.initial > self.final:
            message = f"is {self.initial:g}; must be at most final, which is {self.final:g}"
            raise FieldError((("initial",), message))
        return self


class Hardness(Section):
    """Hardness: falling with temperature (arrhenius) or constant."""

    law: Literal["arrhenius", "constant"]

    @property
    def summary(self) -> str:
        """One line on the law."""
        falls = self.law == "arrhenius"
        return "falls with temperature, H0 exp(U/(R theta))" if falls else "H0 at every temperature"

    @property
    def requires(self) -> tuple[str, ...]:
        """Variables that the law needs beside `hardness`."""
        return ("activation_energy", "temperature") if self.law == "arrhenius" else ()

    @property
    def groups(self) -> tuple[Group, ...]:
        """Dimensionless groups that the law depends on."""
        return (SOFTENING,) if self.law == "arrhenius" else ()

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import hardness

        if self.law == "arrhenius":
            return hardness.ArrheniusHardness(value["hardness"], value["activation_energy"])
        return hardness.ConstantHardness(value["hardness"])


class Friction(Section):
    """Friction coefficient: mu0 (1 - e) [A 7], constant [B], or no friction."""

    law: Literal["restitution_scaled", "constant", "none"] = "none"
    requires: ClassVar[tuple[str, ...]] = ("friction",)

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.law == "restitution_scaled":
            return "mu0 (1 - e), capped where slip ends [A 7]"
        return "mu0, capped where slip ends [B]"

    def build(self, value: Values) -> "Submodel | None":
        """Return the law as kernels see it, None for no friction."""
        from agglom_mpi.physics import friction

        if self.law == "none":
            return None
        if self.law == "restitution_scaled":
            return friction.RestitutionScaledFriction(value["friction"])
        return friction.ConstantFriction(value["friction"])


class RootSolver(Section):
    """Bracketed root finder for e = G(e)."""

    law: Literal["root"] = "root"
    summary: ClassVar[str] = "e = G(e) by a bracketed root finder"

    def build(self, value: Values) -> "Submodel":
        """Return the solver as kernels see it."""
        from agglom_mpi.physics import impact_solvers

        return impact_solvers.BracketedRoot()


class IterationSolver(Section):
    """Published fixed-point iteration for e = G(e), which cycles for most impacts [A 20]."""

    law: Literal["iteration"]
    tolerance: Annotated[Number, Field(gt=0)] = 1e-6
    cap: Annotated[WholeNumber, Field(ge=1)] = 100
    summary: ClassVar[str] = "the published fixed point, which cycles for most impacts [A 20]"

    def build(self, value: Values) -> "Submodel":
        """Return the solver as kernels see it."""
        from agglom_mpi.physics import impact_solvers

        return impact_solvers.FixedPointIteration(self.tolerance, self.cap)


AnyRestitution = Annotated[
    PressureRestitution | ConstantRestitution, Field(discriminator="law"), NAMED
]
AnyDuration = Annotated[
    MeanSpeedDuration | CompressionRecoveryDuration, Field(discriminator="law"), NAMED
]
AnyHardness = Annotated[Hardness, NAMED]
AnyFriction = Annotated[Friction, NAMED_OR_NONE]
AnySolver = Annotated[RootSolver | IterationSolver, Field(discriminator="law"), NAMED]


Integration = Literal["exact", "euler"]
"""Exact solution, or, as published, an Euler step in each time step of the engine."""


class Heating(Section):
    """Sharing of dissipated energy: half the pair's [A 14-17], or each its own [B 6.5-6.10]."""

    law: Literal["pair_split", "own_energy", "none"] = "pair_split"
    # Cooling and reaction are not allowed without heating, so they need not name these.
    requires: ClassVar[tuple[str, ...]] = ("heat_capacity", "temperature")

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.law == "pair_split":
            return "half the energy the pair lost to each [A 14-17]"
        return "each its own energy change, as published [B 6.5-6.10]"

    @property
    def groups(self) -> tuple[Group, ...]:
        """Dimensionless groups that the law depends on."""
        return () if self.law == "none" else (HEATING,)

    def build(self, value: Values) -> "Submodel | None":
        """Return the law as kernels see it, None for no heating."""
        from agglom_mpi.physics import heating

        if self.law == "none":
            return None
        return heating.PairSplit() if self.law == "pair_split" else heating.OwnEnergy()


class Reaction(Section):
    """Heat of reaction per contact area [A 14-17] [B 6.5-6.10], or none."""

    law: Literal["contact_area", "none"] = "none"
    summary: ClassVar[str] = "heat per contact area [A 14-17] [B 6.5-6.10]"
    requires: ClassVar[tuple[str, ...]] = ("reaction_heat",)

    @property
    def groups(self) -> tuple[Group, ...]:
        """Dimensionless groups that the law depends on."""
        return () if self.law == "none" else (REACTION,)

    def build(self, value: Values) -> "Submodel | None":
        """Return the law as kernels see it, None for no reaction."""
        from agglom_mpi.physics import heating

        return None if self.law == "none" else heating.ContactAreaReaction(value["reaction_heat"])


class Fragmentation(Section):
    """Fragmentation by the energy the pair dissipates, or an aggregate's own [B 5.1-5.5]."""

    law: Literal["pair_energy", "own_energy", "none"] = "none"
    requires: ClassVar[tuple[str, ...]] = ("surface_energy",)

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.law == "pair_energy":
            return "by the energy the pair lost [B 5.1-5.5]"
        return "by its own energy change, as published [B 5.1-5.5]"

    @property
    def groups(self) -> tuple[Group, ...]:
        """Dimensionless groups that the law depends on."""
        return () if self.law == "none" else (FRAGMENTATION,)

    def build(self, value: Values) -> "Submodel | None":
        """Return the law as kernels see it, None for unbreakable aggregates."""
        from agglom_mpi.physics import fragmentation

        if self.law == "none":
            return None
        if self.law == "pair_energy":
            return fragmentation.PairEnergyFragmentation(value["surface_energy"])
        return fragmentation.OwnEnergyFragmentation(value["surface_energy"])


class NoCooling(Section):
    """No cooling between impacts."""

    law: Literal["none"] = "none"
    summary: ClassVar[str] = ""

    def build(self, value: Values) -> None:
        """Return None, which stands for no cooling."""


class RadiationCooling(Section):
    """Radiation and convection [B 6.19-6.21]; temperatures in K, `convection` in W/m^2/K."""

    law: Literal["radiation"]
    emissivity: Annotated[Number, Field(ge=0, le=1, description="0 to 1")]
    surroundings: Annotated[Temperature, Field(ge=0, description="a temperature like '300 K'")]
    convection: Annotated[HeatTransfer, Field(ge=0)] = 0.0
    ambient: Annotated[Temperature, Field(ge=0)] = 300.0
    integration: Integration = "exact"
    summary: ClassVar[str] = "radiation and convection [B 6.19-6.21]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import cooling

        numbers = self.emissivity, self.surroundings, self.convection, self.ambient
        return cooling.RadiativeCooling(*numbers, cooling.equilibrium_temperature(*numbers))

    @model_validator(mode="after")
    def _ambient_is_given(self) -> Self:
        if self.convection > 0 and "ambient" not in self.model_fields_set:
            message = "is missing; the temperature that convection cools to, like '300 K'"
            raise FieldError((("ambient",), message))
        return self


class QuarticCooling(Section):
    """Published law (theta - theta0)^4, bounded at the starting temperature [A 18-19]."""

    law: Literal["quartic"]
    integration: Integration = "exact"
    summary: ClassVar[str] = "(theta - theta0)^4, bounded at theta0 [A 18-19]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import cooling

        return cooling.QuarticCooling(
            value["density"], value["heat_capacity"], value["temperature"]
        )


AnyHeating = Annotated[Heating, NAMED_OR_NONE]
AnyReaction = Annotated[Reaction, NAMED_OR_NONE]
AnyFragmentation = Annotated[Fragmentation, NAMED_OR_NONE]
AnyCooling = Annotated[
    NoCooling | RadiationCooling | QuarticCooling, Field(discriminator="law"), NAMED_OR_NONE
]
