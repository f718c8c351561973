"""The engines that carry a sample through time, and their short names on the command line."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from agglom_mpi.campaign.parts import NAMED, Part, RefusalError, WholeNumber
from agglom_mpi.campaign.quantities import Time, shown


class EventEngine(Part):
    """Exact times, one event after another, without time steps [own method].

    Inelastic spheres can collide infinitely often in finite time; a sample that needs more than
    `budget` events per grain fails instead of running for ever. Crossing a cell is an event too: in
    a dilute gas of 1000 grains some 14 per grain and box length.
    """

    law: Literal["event"] = "event"
    budget: Annotated[WholeNumber, Field(ge=1, le=10**9)] = 20_000


class FixedEngine(Part):
    """Equal time steps [A]."""

    law: Literal["fixed"] = "fixed"
    steps: Annotated[WholeNumber, Field(ge=1)] = 200


class AdaptiveEngine(Part):
    """Steps to the next contact of nearest neighbours, within two limits in s [B 6.14]."""

    law: Literal["adaptive"] = "adaptive"
    floor: Annotated[Time, Field(gt=0)] = 1e-6
    ceiling: Annotated[Time, Field(gt=0)] = 1e-3

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.floor > self.ceiling:
            message = f"is {self.floor:g} s; must be at most ceiling, which is {self.ceiling:g} s"
            raise RefusalError((("floor",), message))
        return self


Engine = EventEngine | FixedEngine | AdaptiveEngine
AnyEngine = Annotated[Engine, Field(discriminator="law"), NAMED]

ALLOWED = "allowed: event, fixed, fixed:STEPS, adaptive"


def parse_engine(text: str, own: Engine) -> Engine:
    """Engine meant by a short text.

    Parameters
    ----------
    text
        `event`, `fixed`, `fixed:2000` or `adaptive`.
    own
        The campaign's engine; a bare name of the same law means this one.

    Raises
    ------
    ValueError
        With what is allowed.
    """
    law, colon, steps = text.strip().partition(":")
    if law == "fixed" and colon:
        if not (steps.isdecimal() and steps.isascii() and len(steps) < 19 and int(steps) >= 1):
            raise ValueError(f"is {shown(text)}; STEPS must be a whole number from 1; {ALLOWED}")
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
    raise ValueError(f"is {shown(text)}; {ALLOWED}")
