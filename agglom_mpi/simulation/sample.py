"""One sample: a pure function of scene and random stream, from placement to result."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import agglom_mpi.simulation.event_driven.engine
import agglom_mpi.simulation.time_driven.steppers  # noqa: F401  (all register their engines)
from agglom_mpi import outcome as result
from agglom_mpi.kernels import inlined, kernel
from agglom_mpi.outcome import FinalParticles
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.simulation.initial_state import EqualSizes, draw_velocities, place_randomly
from agglom_mpi.simulation.measurement import (
    fluctuation_energy,
    is_finite,
    measure,
    measure_ledger,
    thermal_energy,
    to_box_frame,
    to_mass_frame,
    total_momentum,
)
from agglom_mpi.simulation.particles import EXHAUSTED, new_ledger, new_particles
from agglom_mpi.simulation.scene import Scene, run_to_end
from agglom_mpi.simulation.temperature import cool_until
from agglom_mpi.simulation.trajectory import new_recorder, record_end, record_start, set_drift


class Outcome(NamedTuple):
    """What `campaign.simulate` returns; the final radii are relative to the starting radius.

    Attributes
    ----------
    mean_radius_ratio, objective : float
        Mean of b/b⁰ over the particles left, and the campaign's objective of this sample, nan if
        that is a function whose code was not allowed.
    particles : int
        Particles left.
    radii : array, shape (particles,)
        Final b/b⁰.
    temperatures : array, shape (particles,), K; all those of the scene where nothing changes them
    moments : array, shape (4,)
        Mean and central moments 2, 3, 4 of b/b⁰.
    ledger : dict
        Closure errors and counts of everything that was capped or refused.
    collisions, merges, breakups, steps : int
    seconds : float
        Run time of this sample.
    record : numpy.void
        The row that a campaign file stores.
    final : FinalParticles
        Radii in m, masses, grain counts and temperatures of the particles left.
    frames : Frames or None
        The particles at the times that were asked for.
    """

    mean_radius_ratio: float
    objective: float
    particles: int
    radii: npt.NDArray[np.float64]
    temperatures: npt.NDArray[np.float64]
    moments: npt.NDArray[np.float64]
    ledger: dict[str, float | int]
    collisions: int
    merges: int
    breakups: int
    steps: int
    seconds: float
    record: Any
    final: FinalParticles
    frames: Frames | None = None

    @property
    def measured(self) -> result.SampleSummary:
        """Summary that decisions are based on."""
        [measured] = result.summaries(np.array([self.record], result.OUTCOME))
        return measured._replace(objective=self.objective)


@kernel
def run_sample(scene, random, abort, out, frames):
    """Place, run and measure one sample; one crossing into compiled code.

    Parameters
    ----------
    scene : Scene
    random : numpy.random.Generator
    abort : uint8 array, shape (1,); anything but 0 ends the run early
    out : array of `OUTCOME`, shape (1,), filled
    frames : Frames, filled, or None

    Returns
    -------
    Particles
        The final state.
    """
    capacity = scene.particles
    if scene.laws.fragmentation is not None:
        capacity = 2 * scene.particles
    particles = new_particles(scene, capacity, frames)
    ledger = new_ledger()
    record = out[0]
    record["state"] = result.FAILED
    occupied = particles.position[:, : scene.particles]
    sizes = EqualSizes(2.0 * scene.radius)
    if not place_randomly(random, scene.escape, occupied, sizes, scene.half_width):
        record["reason"] = result.FailureReason.PLACEMENT_JAMMED
        return particles
    draw_velocities(scene.velocities, random, particles.velocity[:, : scene.particles])
    recorder = new_recorder(frames, scene, capacity)
    integrate(scene, particles, ledger, abort, record, recorder)
    return particles


@inlined
def integrate(scene, particles, ledger, abort, record, recorder):
    """Run particles from where they are to the scene's end, and measure them into `record`."""
    record_start(recorder, scene, particles)
    drift = to_mass_frame(scene, particles)
    set_drift(recorder, drift)
    heat = thermal_energy(scene.laws.heating, scene, particles)
    start = (*total_momentum(particles), *fluctuation_energy(particles), heat)
    end = run_to_end(scene.engine, scene, particles, ledger, abort, recorder)
    record["end_time"] = end
    for i in range(particles.size[0]):
        cool_until(scene.cooling, scene, particles, ledger, i, end)
    if ledger.counts[EXHAUSTED] > 0:
        record["reason"] = result.FailureReason.BUDGET_EXCEEDED
        return
    if not is_finite(particles):
        record["reason"] = result.FailureReason.NON_FINITE
        return
    measure(scene, particles, record)
    measure_ledger(scene, particles, ledger, start, record)
    to_box_frame(scene, particles, drift, end)
    record_end(recorder, scene, particles, end)
    record["state"] = result.COMPLETED


def simulate_scene(
    scene: Scene,
    random: np.random.Generator,
    abort: npt.NDArray[np.uint8] | None = None,
    frames: Frames | None = None,
) -> tuple[Any, Any]:
    """Run one sample; return its `OUTCOME` record and its final `Particles`.

    Parameters
    ----------
    scene
        The scene.
    random
        Stream of the sample; see `sample_stream`.
    abort
        Shape (1,); another thread ends the run early by setting it to 1.
    frames
        Filled if given; from `new_frames` for the scene's number of grains. Without them no code
        is compiled for frames.

    `final_particles` makes arrays of SI values of the particles.
    """
    out = np.zeros(1, result.OUTCOME)
    abort = np.zeros(1, np.uint8) if abort is None else abort
    particles = run_sample(scene, random, abort, out, frames)
    return out[0], particles
