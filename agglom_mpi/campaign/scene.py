"""The scene: what is simulated, apart from the ten variables."""

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from agglom_mpi.campaign.engines import AnyEngine, EventEngine
from agglom_mpi.campaign.impact import (
    AnyDuration,
    AnyFriction,
    AnyHardness,
    AnyRestitution,
    AnySolver,
    CompressionRecoveryDuration,
    ContactArea,
    Friction,
    PressureRestitution,
    RootSolver,
)
from agglom_mpi.campaign.parts import NAMED, Part, WholeNumber, refuse
from agglom_mpi.campaign.quantities import Length, Number, Speed, shown, si
from agglom_mpi.campaign.source import Path
from agglom_mpi.campaign.thermal import (
    AnyCooling,
    AnyFragmentation,
    AnyHeating,
    AnyReaction,
    Fragmentation,
    Heating,
    NoCooling,
    Reaction,
)

Escape = Literal["periodic", "reentry"]
"""A true periodic box, or, as published, re-entry without contacts across faces."""


class UniformX(Part):
    """Starting velocities v0 r in x alone, r uniform in [0, 1] [A]."""

    law: Literal["uniform_x"]


class Spread(Part):
    """A mean velocity (m/s) plus v0 in x and `transverse` v0 in y and z, uniform both ways [B]."""

    law: Literal["spread"]
    mean: tuple[Speed, Speed, Speed] = (10.0, 10.0, 100.0)
    transverse: Annotated[Number, Field(ge=0)] = 0.1


def _read_end_time(value: Any) -> Any:
    if value == "characteristic":
        return value
    if isinstance(value, str) and value.isidentifier():
        raise ValueError(f"is {shown(value)}; must be `characteristic` or a time like '10 ms'")
    time = si(value, "s")
    if time <= 0:
        raise ValueError(f"is {shown(value)}; must be greater than 0 s")
    return time


EndTime = Annotated[float | Literal["characteristic"], BeforeValidator(_read_end_time)]


def _at_least_two(value: Any) -> Any:
    if value in (0, 1) and not isinstance(value, bool):
        raise ValueError(f"is {value}; at least 2 are needed for a collision")
    return value


class SceneModel(Part):
    """Box, submodels and engine; lengths in m, times in s."""

    particles: Annotated[
        WholeNumber,
        Field(ge=2, le=10**7, description="the number of grains"),
        BeforeValidator(_at_least_two),
    ]
    half_width: Annotated[Length, Field(gt=0, description="half the cube's edge, like '1 cm'")]
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
        problems: list[tuple[Path, str]] = []
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
        refuse(problems)
        return self
