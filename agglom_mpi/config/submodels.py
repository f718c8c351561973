"""The laws of a scene as they stand in a campaign file; each section builds what kernels see.

Kernels are imported when something is built: to check a campaign takes no compiler.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from agglom_mpi.config.units import HeatTransfer, Number, Temperature, Time
from agglom_mpi.config.validation import NAMED, NAMED_OR_NONE, FieldError, Section, WholeNumber

if TYPE_CHECKING:
    from agglom_mpi.kernels import Submodel

Values = Mapping[str, float]
"""The ten variables in SI units, by name."""


class PressureRestitution(Section):
    """Restitution falls with the contact pressure over the hardness [A 6] [B 3.1, 4.13]."""

    law: Literal["pressure"] = "pressure"
    summary: ClassVar[str] = "by contact pressure over hardness [A 6] [B 3.1, 4.13]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import restitution

        return restitution.PressureRestitution()


class ConstantRestitution(Section):
    """One restitution for every impact; 0 bonds every contact.

    An impact less than `contact_time` (s) after the last one of either partner is elastic, which
    ends inelastic collapse (the TC model, Luding & McNamara 1998); 0: no impact is.
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
    """The contact lasts as long as the mean speed needs for `length_ratio` radii [A 12]."""

    law: Literal["mean_speed"]
    length_ratio: Annotated[Number, Field(gt=0)] = 1e-6
    summary: ClassVar[str] = "length over the mean speed [A 12]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import contact

        return contact.MeanSpeedDuration(self.length_ratio)


class CompressionRecoveryDuration(Section):
    """Compression at the approach speed, then recovery, over `length_ratio` radii [B 4.10]."""

    law: Literal["compression_recovery"] = "compression_recovery"
    length_ratio: Annotated[Number, Field(gt=0)] = 1.0
    summary: ClassVar[str] = "compression, then recovery [B 4.10]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import contact

        return contact.CompressionRecoveryDuration(self.length_ratio)


class ContactArea(Section):
    """Contact area over that of the smaller sphere's disc, at e = 1 and e = 0 [A 11] [B 4.12]."""

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
        """Variables that the law uses beside the hardness."""
        return ("activation_energy", "temperature") if self.law == "arrhenius" else ()

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.physics import hardness

        if self.law == "arrhenius":
            return hardness.ArrheniusHardness(value["hardness"], value["activation_energy"])
        return hardness.ConstantHardness(value["hardness"])


class Friction(Section):
    """Friction coefficient: times 1 - e [A 7], constant [B], or no friction."""

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
    """The impact's equation e = G(e) solved with a bracketed root finder that cannot fail."""

    law: Literal["root"] = "root"
    summary: ClassVar[str] = "e = G(e) by a bracketed root finder"

    def build(self, value: Values) -> "Submodel":
        """Return the solver as kernels see it."""
        from agglom_mpi.physics import impact_solvers

        return impact_solvers.BracketedRoot()


class IterationSolver(Section):
    """The published fixed-point iteration, which ends in a cycle for most impacts."""

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
"""The exact solution, or as published one step per time step of the engine, if it has any."""


class Heating(Section):
    """Who gets the energy an impact dissipates: the pair [A 14-17] or each its own [B 6.5-6.10]."""

    law: Literal["pair_split", "own_energy", "none"] = "pair_split"
    # Cooling and reaction are refused without heating.
    requires: ClassVar[tuple[str, ...]] = ("heat_capacity", "temperature")

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.law == "pair_split":
            return "half the energy the pair lost to each [A 14-17]"
        return "each its own energy change, as published [B 6.5-6.10]"

    def build(self, value: Values) -> "Submodel | None":
        """Return the law as kernels see it, None for no heating."""
        from agglom_mpi.physics import heating

        if self.law == "none":
            return None
        return heating.PairSplit() if self.law == "pair_split" else heating.OwnEnergy()


class Reaction(Section):
    """Heat of reaction per contact area, or none."""

    law: Literal["contact_area", "none"] = "none"
    summary: ClassVar[str] = "heat per contact area [A 14-17] [B 6.5-6.10]"
    requires: ClassVar[tuple[str, ...]] = ("reaction_heat",)

    def build(self, value: Values) -> "Submodel | None":
        """Return the law as kernels see it, None for no reaction."""
        from agglom_mpi.physics import heating

        return None if self.law == "none" else heating.ContactAreaReaction(value["reaction_heat"])


class Fragmentation(Section):
    """Energy that may break an aggregate: dissipated by the pair, or its own [B 5.1-5.5]."""

    law: Literal["pair_energy", "own_energy", "none"] = "none"
    requires: ClassVar[tuple[str, ...]] = ("surface_energy",)

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.law == "pair_energy":
            return "by the energy the pair lost [B 5.1-5.5]"
        return "by its own energy change, as published [B 5.1-5.5]"

    def build(self, value: Values) -> "Submodel | None":
        """Return the law as kernels see it, None for unbreakable aggregates."""
        from agglom_mpi.physics import fragmentation

        if self.law == "none":
            return None
        if self.law == "pair_energy":
            return fragmentation.PairEnergyFragmentation(value["surface_energy"])
        return fragmentation.OwnEnergyFragmentation(value["surface_energy"])


class NoCooling(Section):
    """Nothing cools between impacts."""

    law: Literal["none"] = "none"
    summary: ClassVar[str] = ""

    def build(self, value: Values) -> None:
        """Return None: there is no law."""


class RadiationCooling(Section):
    """Radiation and convection [B 6.19-6.21]; temperatures in K, convection in W/m^2/K."""

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
    """The published law (theta - theta0)^4, bounded at the starting temperature [A 18-19]."""

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
