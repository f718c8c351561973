"""One sample: a pure function of (campaign, parameters, sample number)."""

import hashlib
import math
import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

import agglom_mpi.simulation.adaptive
import agglom_mpi.simulation.events.engine
import agglom_mpi.simulation.fixed  # noqa: F401  (all register their engines)
from agglom_mpi.compilation import kernel, stage
from agglom_mpi.simulation import outcome as result
from agglom_mpi.simulation.allocation import new_particles
from agglom_mpi.simulation.contact import catch_up
from agglom_mpi.simulation.engines import advance
from agglom_mpi.simulation.finished import finished_sample
from agglom_mpi.simulation.frame import enter_frame, leave_frame
from agglom_mpi.simulation.measures import (
    fluctuation,
    is_finite,
    measure,
    measure_ledger,
    thermal_energy,
    total_momentum,
)
from agglom_mpi.simulation.particles import EXHAUSTED, new_ledger
from agglom_mpi.simulation.placement import EqualSizes, place
from agglom_mpi.simulation.recorder import new_recorder, note_drift, record_end, record_start
from agglom_mpi.simulation.scene import Scene, build_scene
from agglom_mpi.simulation.snapshots import Frames, new_frames
from agglom_mpi.simulation.velocities import draw_velocities

if TYPE_CHECKING:
    from agglom_mpi.campaign import Campaign

_PURPOSE = 1
"""Separates the random streams of samples from those of the search."""
_COMMON = 2
"""The same for streams that all strings have in common."""


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
    final: result.FinalParticles
    frames: Frames | None = None

    @property
    def measured(self) -> result.Measured:
        """What decisions are made from."""
        [measured] = result.measured(np.array([self.record], result.OUTCOME))
        return measured._replace(objective=self.objective)


@kernel
def run(scene, random, abort, out, frames):  # type: ignore[no-untyped-def]
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
    if not place(random, scene.escape, occupied, sizes, scene.half_width):
        record["reason"] = result.PLACEMENT_JAMMED
        return particles
    draw_velocities(scene.velocities, random, particles.velocity[:, : scene.particles])
    recorder = new_recorder(frames, scene, capacity)
    carry_out(scene, particles, ledger, abort, record, recorder)
    return particles


@stage
def carry_out(scene, particles, ledger, abort, record, recorder):  # type: ignore[no-untyped-def]
    """Run particles from where they are to the scene's end, and measure them into `record`."""
    record_start(recorder, scene, particles)
    drift = enter_frame(scene, particles)
    note_drift(recorder, drift)
    heat = thermal_energy(scene.laws.heating, scene, particles)
    start = (*total_momentum(particles), *fluctuation(particles), heat)
    end = advance(scene.engine, scene, particles, ledger, abort, recorder)
    record["end_time"] = end
    for i in range(particles.size[0]):
        catch_up(scene.cooling, scene, particles, ledger, i, end)
    if ledger.tally[EXHAUSTED] > 0:
        record["reason"] = result.BUDGET_EXCEEDED
        return
    if not is_finite(particles):
        record["reason"] = result.NON_FINITE
        return
    measure(scene, particles, record)
    measure_ledger(scene, particles, ledger, start, record)
    leave_frame(scene, particles, drift, end)
    record_end(recorder, scene, particles, end)
    record["state"] = result.COMPLETED


def random_stream(
    seed: int, parameters: npt.NDArray[np.float64], sample: int, common: bool = False
) -> np.random.Generator:
    """Return the random stream of one sample, keyed by what it is and by nothing else.

    Parameters
    ----------
    seed
        The campaign's seed.
    parameters
        The ten variables in SI units, shape (10,).
    sample
        Sample number from 0.
    common
        Whether strings have common configurations; their parameters then play no part.
    """
    if common:
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, _COMMON, sample])))
    digest = hashlib.blake2b(np.asarray(parameters, "<f8").tobytes(), digest_size=16).digest()
    words = np.frombuffer(digest, "<u4").tolist()
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence([seed, _PURPOSE, *words, sample]))
    )


def simulate_scene(
    scene: Scene,
    random: np.random.Generator,
    abort: npt.NDArray[np.uint8] | None = None,
    frames: Frames | None = None,
) -> tuple[Any, Any]:
    """Run one sample of a typed scene; its `OUTCOME` record and its final `Particles`.

    `final_particles` makes them what people and files want. `frames`, from `new_frames` for as
    many grains as the scene has, are filled; without them nothing is compiled for them.
    """
    out = np.zeros(1, result.OUTCOME)
    abort = np.zeros(1, np.uint8) if abort is None else abort
    particles = run(scene, random, abort, out, frames)
    return out[0], particles


def simulate(
    campaign: "Campaign",
    parameters: npt.ArrayLike,
    sample: int = 0,
    engine: Any = None,
    times: npt.NDArray[np.float64] | None = None,
) -> Outcome:
    """Simulate one sample exactly as a rank of the campaign does; see `Outcome`.

    Its frames are those at `times` in s, shape (F,), ascending from 0 to the end time at most.

    Raises
    ------
    RuntimeError
        If the sample fails, with the reason.
    """
    vector = np.asarray(parameters, dtype=np.float64)
    scene = build_scene(campaign.scene, vector, engine)
    frames = None if times is None else new_frames(times, scene.particles)
    random = random_stream(campaign.seed, vector, sample, campaign.common_configurations)
    begin = time.perf_counter()
    record, particles = simulate_scene(scene, random, frames=frames)
    seconds = time.perf_counter() - begin
    if record["state"] != result.COMPLETED:
        raise RuntimeError(f"sample {sample} failed: {result.REASONS[record['reason']]}")
    ratio = float(record["mean_radius_ratio"])
    final = result.final_particles(scene, particles)
    try:
        objective = _objective(campaign, scene, vector, record, final)
    except Exception as error:  # of the user's own function
        said = f"{type(error).__name__}: {error}"
        raise RuntimeError(f"sample {sample} failed: {said}") from error
    return Outcome(
        mean_radius_ratio=ratio,
        objective=objective,
        particles=int(record["particles"]),
        radii=final.radii / scene.radius,
        temperatures=final.temperatures,
        moments=np.array([ratio, *(float(record[f"radius_moment_{r}"]) for r in (2, 3, 4))]),
        ledger={name: record[name].item() for name in result.LEDGER},
        collisions=int(record["collisions"]),
        merges=int(record["merges"]),
        breakups=int(record["breakups"]),
        steps=int(record["steps"]),
        seconds=seconds,
        record=record,
        final=final,
        frames=frames,
    )


def _objective(
    campaign: "Campaign",
    scene: Scene,
    parameters: npt.NDArray[np.float64],
    record: Any,
    final: result.FinalParticles,
) -> float:
    """Return the campaign's objective of one completed sample."""
    from agglom_mpi.campaign.code import worth_of
    from agglom_mpi.search.objectives import make_objective

    code = campaign.code
    if campaign.objective.law == "function":
        if code is None or code.source is None:
            return math.nan
        return worth_of(code, finished_sample(scene, parameters, record, final))
    rows = np.array([record], result.OUTCOME)
    return float(make_objective(campaign.objective, scene.particles).of_samples(rows)[0])
