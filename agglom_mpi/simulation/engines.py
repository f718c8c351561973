"""The questions every engine answers: a whole run, or one in stretches."""

import numpy as np

from agglom_mpi.compilation import Submodel, allocating_question, question
from agglom_mpi.simulation.particles import Ledger, Particles


@allocating_question
def advance(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    ledger: Ledger,
    abort: np.ndarray,
    recorder: Submodel | None,
) -> float:
    """Run a placed scene to its end time, or until `abort[0]` is set; the time reached in s.

    What a `recorder` wants to see between start and end is taken on the way.
    """


@allocating_question
def begin(engine: Submodel, scene: Submodel, particles: Particles) -> Submodel:
    """Return what an engine keeps beside particles that start at the time 0, for `go_on`."""


@allocating_question
def go_on(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    ledger: Ledger,
    kept: Submodel,
    until: float,
    abort: np.ndarray,
) -> float:
    """Let happen what happens up to `until` in s, as `advance` does; the time reached in s.

    Nothing is brought to an end there, so that in how many stretches a run is done does not change
    a bit of it; `stand` says where the particles are.
    """


@question
def stand(
    engine: Submodel,
    scene: Submodel,
    particles: Particles,
    kept: Submodel,
    recorder: Submodel,
    time: float,
) -> None:
    """Copy the particles, and move the copies to where they are at `time` in s."""
