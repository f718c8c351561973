"""The `scene` section and its engines."""

import math
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, model_validator

from agglom_mpi.config.alternatives import SIZES, GrainSize, HalfWidth, none_of, one_of
from agglom_mpi.config.sizes import AnySizes, are_lengths
from agglom_mpi.config.submodels import (
    AnyCooling,
    AnyDuration,
    AnyFragmentation,
    AnyFriction,
    AnyHardness,
    AnyHeating,
    AnyReaction,
    AnyRestitution,
    AnySolver,
    CompressionRecoveryDuration,
    ContactArea,
    Fragmentation,
    Friction,
    Heating,
    NoCooling,
    PressureRestitution,
    Reaction,
    RootSolver,
    Values,
)
from agglom_mpi.declaration.sections import (
    LATER,
    NAMED,
    FieldError,
    FieldPath,
    Section,
    WholeNumber,
    raise_field_errors,
)
from agglom_mpi.declaration.units import Number, Speed, Time, quoted, to_si
from agglom_mpi.physics.sizes import SizeLaw, third_moment
from agglom_mpi.variables import values_by_name

if TYPE_CHECKING:
    from agglom_mpi.compilation.stages import Submodel
    from agglom_mpi.physics.restitution import ImpactLaws
    from agglom_mpi.simulation.scene import Scene


class EventEngine(Section):
    """Event-driven engine: exact times of all events, no time steps.

    Inelastic spheres can collide infinitely often in finite time: a sample that needs more than
    `budget` events per grain fails instead of running for ever. Cell crossings are events, too: in
    a dilute gas of 1000 grains some 14 per grain and box length.
    """

    law: Literal["event"] = "event"
    budget: Annotated[WholeNumber, Field(ge=1, le=10**9)] = 20_000

    @property
    def summary(self) -> str:
        """One line on the engine."""
        return f"event-driven, exact times, at most {self.budget:,} events per grain"

    def build(self) -> "Submodel":
        """Return the engine as kernels see it."""
        from agglom_mpi.simulation import scene

        return scene.EventDriven(self.budget)


class FixedEngine(Section):
    """Equal time steps [A]."""

    law: Literal["fixed"] = "fixed"
    steps: Annotated[WholeNumber, Field(ge=1)] = 200

    @property
    def summary(self) -> str:
        """One line on the engine."""
        return f"{self.steps} equal steps [A]"

    def build(self) -> "Submodel":
        """Return the engine as kernels see it."""
        from agglom_mpi.simulation import scene

        return scene.FixedSteps(self.steps)


class AdaptiveEngine(Section):
    """Steps to the next contact of nearest neighbours, from `floor` to `ceiling` s [B 6.14]."""

    law: Literal["adaptive"] = "adaptive"
    floor: Annotated[Time, Field(gt=0)] = 1e-6
    ceiling: Annotated[Time, Field(gt=0)] = 1e-3

    @property
    def summary(self) -> str:
        """One line on the engine."""
        return f"adaptive steps, {self.floor:g} to {self.ceiling:g} s [B 6.14]"

    def build(self) -> "Submodel":
        """Return the engine as kernels see it."""
        from agglom_mpi.simulation import scene

        return scene.AdaptiveSteps(self.floor, self.ceiling)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.floor > self.ceiling:
            message = f"is {self.floor:g} s; must be at most ceiling, which is {self.ceiling:g} s"
            raise FieldError((("floor",), message))
        return self


Engine = EventEngine | FixedEngine | AdaptiveEngine
AnyEngine = Annotated[Engine, Field(discriminator="law"), NAMED]

ALLOWED = "allowed: event, fixed, fixed:STEPS, adaptive"


def parse_engine(text: str, own: Engine) -> Engine:
    """Return the engine that a short text names.

    Parameters
    ----------
    text
        `event`, `fixed`, `fixed:STEPS` or `adaptive`.
    own
        The scene's engine, which the name of its law alone stands for.

    Raises
    ------
    ValueError
        If the text is none of these; with what is allowed.
    """
    law, colon, steps = text.strip().partition(":")
    if law == "fixed" and colon:
        if not (steps.isdecimal() and steps.isascii() and len(steps) < 19 and int(steps) >= 1):
            raise ValueError(f"is {quoted(text)}; STEPS must be a whole number from 1; {ALLOWED}")
        return FixedEngine(steps=int(steps))
    if not colon and law == own.law:
        return own
    match text.strip():
        case "event":
            return EventEngine()
        case "fixed":
            return FixedEngine()
        case "adaptive":
            return AdaptiveEngine()
    raise ValueError(f"is {quoted(text)}; {ALLOWED}")


Escape = Literal["periodic", "reentry"]
"""Periodic box, or, as published, re-entry without contacts across faces."""


class UniformX(Section):
    """Starting velocities v0 r in x alone, r uniform in [0, 1] [A]."""

    law: Literal["uniform_x"]
    summary: ClassVar[str] = "x alone, uniform from 0 to v0 [A]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.simulation import initial_state

        return initial_state.UniformX(value["relative_speed"])


class Spread(Section):
    """A mean velocity (m/s) plus v0 in x and `transverse` v0 in y and z, uniform both ways [B]."""

    law: Literal["spread"]
    mean: tuple[Speed, Speed, Speed] = (10.0, 10.0, 100.0)
    transverse: Annotated[Number, Field(ge=0)] = 0.1
    summary: ClassVar[str] = "a mean plus a uniform spread in x, y, z [B]"

    def build(self, value: Values) -> "Submodel":
        """Return the law as kernels see it."""
        from agglom_mpi.simulation import initial_state

        return initial_state.SpreadVelocities(value["relative_speed"], self.mean, self.transverse)


def _read_end_time(value: Any) -> Any:
    if value == "characteristic":
        return value
    if isinstance(value, str) and value.isidentifier():
        raise ValueError(f"is {quoted(value)}; must be `characteristic` or a time like '10 ms'")
    time = to_si(value, "s")
    if time <= 0:
        raise ValueError(f"is {quoted(value)}; must be greater than 0 s")
    return time


EndTime = Annotated[float | Literal["characteristic"], BeforeValidator(_read_end_time)]


def _at_least_two(value: Any) -> Any:
    if value in (0, 1) and not isinstance(value, bool):
        raise ValueError(f"is {value}; at least 2 are needed for a collision")
    return value


class SceneSection(Section):
    """Section `scene`: box, submodels and engine; lengths in m, times in s.

    Where it gives the size of the grains, `half_width` is None and follows for each string. `sizes`
    None: all grains are equal.
    """

    particles: Annotated[
        WholeNumber,
        Field(ge=2, le=10**7, description="the number of grains"),
        BeforeValidator(_at_least_two),
    ]
    half_width: HalfWidth
    grain_diameter: GrainSize = None
    grain_radius: GrainSize = None
    sizes: Annotated[AnySizes, LATER] = None
    escape: Escape = "periodic"
    velocities: Annotated[UniformX | Spread, Field(discriminator="law"), NAMED] = Field(
        description="allowed: uniform_x, spread"
    )
    restitution: AnyRestitution = PressureRestitution()
    duration: AnyDuration = CompressionRecoveryDuration()
    contact_area: ContactArea = ContactArea()
    hardness: AnyHardness
    friction: AnyFriction = Friction()
    heating: AnyHeating = Heating()
    reaction: AnyReaction = Reaction()
    fragmentation: AnyFragmentation = Fragmentation()
    cooling: AnyCooling = NoCooling()
    solver: AnySolver = RootSolver()
    end_time: EndTime = Field(description="`characteristic` or a time like '10 ms'")
    engine: AnyEngine = EventEngine()

    @property
    def size_key(self) -> str:
        """The key that says how large the scene is."""
        return next((key for key in SIZES if getattr(self, key) is not None), "sizes")

    @property
    def diameter(self) -> float | None:
        """Mean diameter of the grains in m; None where it follows from `half_width`."""
        if self.sizes is not None and self.sizes.mean_diameter is not None:
            return self.sizes.mean_diameter
        if self.grain_radius is not None:
            return 2.0 * self.grain_radius
        return self.grain_diameter

    @property
    def size_law(self) -> SizeLaw:
        """Law of radii over their mean; None: all grains are equal."""
        return None if self.sizes is None else self.sizes.size_law

    @property
    def third_moment(self) -> float:
        """Mean volume of the grains over that of their mean radius, 1 if all are equal."""
        return third_moment(self.size_law)

    @property
    def equivalent_grains(self) -> float:
        """Number of grains of the mean radius that have the volume of all."""
        return self.particles if self.sizes is None else self.particles * self.third_moment

    def entries(self) -> dict[str, Any]:
        """Return the fields as plain values: a diameter, or the half-width that it follows from."""
        entries = super().entries()
        if self.diameter is not None:
            del entries["half_width"]
            entries.pop("grain_radius", None)
            if self.size_key != "sizes":
                entries["grain_diameter"] = self.diameter
        return entries

    def build(self, parameters: ArrayLike, engine: Engine | None = None) -> "Scene":
        """Return the scene of one parameter string as kernels see it.

        The event engine has no time steps and cools exactly, whatever `integration` is; the
        steppers integrate as it says.

        Parameters
        ----------
        parameters
            The ten variables in SI units, shape (10,), in the order of `agglom_mpi.variables`.
        engine
            Engine to use instead of the scene's.

        Raises
        ------
        ValueError
            If the scene cannot be simulated, with the reason.
        """
        from agglom_mpi.physics.cooling import EulerCooling, ExactCooling
        from agglom_mpi.physics.scales import end_time, grain_mass, grain_radius, half_width
        from agglom_mpi.simulation.boundary import Periodic, Reentry
        from agglom_mpi.simulation.scene import Scene

        value = values_by_name(parameters)
        engine = engine or self.engine
        unused = self.heating.law == "none" and math.isnan(value["temperature"])
        cooling = self.cooling.build(value)
        steps = engine.law != "event" and getattr(self.cooling, "integration", "") == "euler"
        integrated = EulerCooling if steps else ExactCooling
        return Scene(
            escape=Periodic() if self.escape == "periodic" else Reentry(),
            velocities=self.velocities.build(value),
            laws=self._impact_laws(value),
            cooling=None if cooling is None else integrated(cooling),
            engine=engine.build(),
            particles=self.particles,
            half_width=half_width(self, value),
            radius=grain_radius(self, value),
            mass=grain_mass(self, value),
            temperature=0.0 if unused else value["temperature"],
            end_time=end_time(self, value),
            sizes=self.size_law,
        )

    def _impact_laws(self, value: Values) -> "ImpactLaws":
        """Return the laws of an impact; None where restitution needs no contact pressure."""
        from agglom_mpi.physics.restitution import ImpactLaws

        pressure = self.restitution.law == "pressure"
        heats = self.heating.law != "none"
        return ImpactLaws(
            restitution=self.restitution.build(value),
            duration=self.duration.build(value) if pressure else None,
            contact_area=self.contact_area.build(value),
            hardness=self.hardness.build(value) if pressure else None,
            friction=self.friction.build(value),
            heating=self.heating.build(value),
            reaction=self.reaction.build(value),
            fragmentation=self.fragmentation.build(value),
            solver=self.solver.build(value) if pressure else None,
            heat_capacity=value["heat_capacity"] if heats else math.inf,
        )

    @model_validator(mode="before")
    @classmethod
    def _one_size(cls, data: Any) -> Any:
        if isinstance(data, dict) and are_lengths(data.get("sizes")):
            return none_of(SIZES, data, "sizes that are lengths")
        return one_of(SIZES, data)

    @model_validator(mode="before")
    @classmethod
    def _default_hardness(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "hardness" in data:
            return data
        restitution = data.get("restitution")
        law = restitution.get("law") if isinstance(restitution, dict) else restitution
        needed = law in (None, "pressure")
        return {**data, "hardness": "arrhenius" if needed else "constant"}

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems: list[tuple[FieldPath, str]] = []
        if self.restitution.law != "pressure":
            if self.hardness.law == "arrhenius":
                message = (
                    f"is 'arrhenius', but {self.restitution.law} restitution has no hardness; "
                    "leave it out"
                )
                problems.append((("hardness",), message))
            if self.end_time == "characteristic":
                message = (
                    "is 'characteristic', which needs the critical speed of `restitution: "
                    "pressure`; give a time like '10 ms'"
                )
                problems.append((("end_time",), message))
        integration = getattr(self.cooling, "integration", "exact")
        if self.engine.law == "event" and integration == "euler":
            message = (
                "is 'euler', which needs time steps, but the engine is 'event'; allowed: exact, or "
                "euler with engine fixed or adaptive"
            )
            problems.append((("cooling", "integration"), message))
        if self.heating.law == "none":
            for name, law in (("reaction", self.reaction.law), ("cooling", self.cooling.law)):
                if law != "none":
                    message = f"is '{law}', but heating is 'none'; allowed without heating: none"
                    problems.append(((name,), message))
        raise_field_errors(problems)
        return self
