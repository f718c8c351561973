"""Many short runs of one engine from given states, in one crossing into compiled code."""

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import agglom_mpi.simulation.event_driven.engine
import agglom_mpi.simulation.time_driven.steppers  # noqa: F401  (all register their engines)
from agglom_mpi.kernels import kernel
from agglom_mpi.simulation.measurement import to_box_frame, to_mass_frame
from agglom_mpi.simulation.particles import new_ledger, new_particles
from agglom_mpi.simulation.scene import Scene, run_to_end

Floats = NDArray[np.float64]

REPETITIONS = 5
"""Times that a batch runs; its seconds are the median."""


class Starts(NamedTuple):
    """States to start from, each of as many equal grains as its scene has.

    Attributes
    ----------
    position, velocity
        Shape (runs, 3, grains), m and m/s.
    """

    position: Floats
    velocity: Floats


class Ends(NamedTuple):
    """States at the end.

    Attributes
    ----------
    position, velocity
        Of the particles left, in the order of their slots, shape (runs, 3, grains), m and m/s.
    left
        Particles left, shape (runs,).
    seconds
        Per run.
    """

    position: Floats
    velocity: Floats
    left: NDArray[np.int64]
    seconds: float


@kernel
def run_batch(scene, position, velocity, abort, left):
    """Run the engine of a scene from each state, which the end replaces; see `Starts`, `Ends`."""
    grains = position.shape[2]
    for run in range(position.shape[0]):
        particles = new_particles(scene, grains, None)
        particles.position[:] = position[run]
        particles.velocity[:] = velocity[run]
        drift = to_mass_frame(scene, particles)
        end = run_to_end(scene.engine, scene, particles, new_ledger(), abort, None)
        to_box_frame(scene, particles, drift, end)
        position[run] = particles.position
        velocity[run] = particles.velocity
        left[run] = particles.size[0]


def run_all(scene: Scene, starts: Starts) -> Ends:
    """Run a scene, one without fragmentation, from all starts; compiled before the clock runs."""
    _run(scene, Starts(starts.position[:1], starts.velocity[:1]))
    ends = [_run(scene, starts) for _ in range(REPETITIONS)]
    return ends[0]._replace(seconds=float(np.median([end.seconds for end in ends])))


def _run(scene: Scene, starts: Starts) -> Ends:
    position, velocity = starts.position.copy(), starts.velocity.copy()
    left = np.zeros(len(position), np.int64)
    abort = np.zeros(1, np.uint8)
    begin = time.perf_counter()
    run_batch(scene, position, velocity, abort, left)
    seconds = time.perf_counter() - begin
    return Ends(position, velocity, left, seconds / len(position))
