"""The sections `ensemble`, `stopping`, `final` and `output`."""

from typing import Annotated, NamedTuple

from pydantic import Field

from agglom_mpi.declaration.sections import (
    NONE,
    Flag,
    Line,
    Section,
    WholeNumber,
)
from agglom_mpi.declaration.units import Number, Time
from agglom_mpi.search.method import SearchMethod
from agglom_mpi.search.stopping import StoppingRule


class Target(Section):
    """Stop when the mean objective of the best `top` strings is `objective` or less."""

    top: Annotated[WholeNumber, Field(ge=1, description="a number of strings")]
    objective: Annotated[Number, Field(description="like 5e-4")]


class Stopping(Section):
    """Section `stopping`: what ends the campaign."""

    generations: Annotated[WholeNumber, Field(ge=1, le=10**6, description="the most generations")]
    target: Annotated[Target | None, NONE] = None
    expected_error: Annotated[Annotated[Number, Field(gt=0, lt=1)] | None, NONE] = None
    max_failures: Annotated[WholeNumber, Field(ge=1)] = 100
    max_seconds: Annotated[Annotated[Time, Field(gt=0)] | None, NONE] = None


class Plan(NamedTuple):
    """The sections of a search, which a scene alone does not have."""

    search: SearchMethod
    ensemble: StoppingRule
    stopping: Stopping


class FinalAnswer(Section):
    """Section `final`: re-estimation of the best strings on fresh samples after the search."""

    strings: Annotated[WholeNumber, Field(ge=1, le=10**5, description="number of best strings")] = 6
    samples: Annotated[
        WholeNumber, Field(ge=2, le=10**6, description="fresh samples of each string")
    ] = 100


class FramesOfBest(Section):
    """Frames of the first samples of the best strings, recorded after the search."""

    count: Annotated[WholeNumber, Field(ge=1, le=10**5, description="frames of each sample")]
    strings: Annotated[WholeNumber, Field(ge=1, description="number of best strings")] = 6
    samples: Annotated[WholeNumber, Field(ge=1, description="samples of each string")] = 1


class Output(Section):
    """Section `output`: name of the campaign file, and what it stores beside rows of samples."""

    file: Annotated[Line, Field(min_length=1)] | None = None
    final_particles: Flag = False
    frames: Annotated[FramesOfBest | None, NONE] = None
