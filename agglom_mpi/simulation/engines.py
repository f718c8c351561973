"""The question every engine answers."""

import numpy as np

from agglom_mpi.compilation import Submodel, allocating_question
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
