"""Samples: each a pure function of scene and random stream, from placement to result."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from agglom_mpi import outcome as result
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import FinalParticles
from agglom_mpi.physics.size_distributions import draw_radii
from agglom_mpi.public_face import PublicFace
from agglom_mpi.simulation.census import CensusRoom
from agglom_mpi.simulation.collision_counts import CollisionCounts, end_counts
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.simulation.initial_state import DifferentSizes, EqualSizes, scatter
from agglom_mpi.simulation.particles import (
    BREAKUPS,
    EXHAUSTED,
    MERGES,
    Ledger,
    Particles,
    new_ledger,
    new_particles,
)
from agglom_mpi.simulation.sample_draws import (
    drawn_sizes,
    draws_of,
    new_draws,
    thread_stream,
    with_sizes,
)
from agglom_mpi.simulation.sample_kernels import INITIAL, measure_sample, run_engine
from agglom_mpi.simulation.sample_range import (
    SampleResults,
    Watch,
    new_results,
    new_watch,
    simulate_range,
)
from agglom_mpi.simulation.sample_room import (
    capacity_of,
    kept_engine_state,
    kept_room,
    prepared_scene,
    without_law,
)
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.simulation.spins import draw_spins
from agglom_mpi.simulation.trajectory import new_observer, observe_particles, store_frame


@dataclass(frozen=True, repr=False, eq=False)
class Outcome(metaclass=PublicFace, internal=["measured", "census"]):
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
    temperatures : array, shape (particles,), K
        All those of the scene where nothing changes them; nan where the scene has none.
    moments : array, shape (4,)
        Mean and central moments 2, 3, 4 of b/b⁰.
    ledger : dict
        Closure errors and counts of everything that was capped or refused; where grains spin also
        the rotational over the translational temperature at the end (`rotational_ratio`), how many
        merges and breakups left angular momentum to the structure (`spin_caps`), and that in J s;
        in shear its work (`shear_work`) and the kinetic energy about the mean flow in J.
    collisions, merges, breakups, steps : int
    seconds, cpu_seconds : float
        Wall-clock and processor time of the simulation, s.
    record : numpy.void
        The row that a campaign file stores.
    final : FinalParticles
        Radii in m, masses, grain counts and temperatures of the particles left.
    frames : Frames or None
        The particles at the times that were asked for.
    quantities : dict
        What the objective's function returned by name, in SI units; empty where it returns one
        number, nan where its code was not allowed.
    census : tuple of arrays or None
        Its censuses, in the order of `CENSUS_COLUMNS`; None where the campaign has no data, or
        frames were asked for.
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
    cpu_seconds: float
    record: Any
    final: FinalParticles
    frames: Frames | None
    quantities: dict[str, float] = field(default_factory=dict)
    census: tuple[npt.NDArray[Any], ...] | None = None

    def __repr__(self) -> str:
        """Return the numbers in full and arrays in a few words, without record and particles."""
        brief = [field.name for field in fields(self)[:13]]
        shown = {name: getattr(self, name) for name in brief}
        frames: dict[str, Any] = {"quantities": self.quantities} if self.quantities else {}
        if self.frames is not None:
            frames |= {"frames": f"<{pluralise(len(self.frames.times), 'frame')}>"}
        return result.brief("Outcome", shown | frames)

    @property
    def measured(self) -> result.SampleSummary:
        """Summary that decisions are based on."""
        [measured] = result.summaries(np.array([self.record]))
        returned = tuple(value for _, value in sorted(self.quantities.items()))
        return measured._replace(objective=self.objective, quantities=returned, census=self.census)


def simulate_scene(
    scene: Scene,
    random: np.random.Generator,
    abort: npt.NDArray[np.uint8] | None = None,
    frames: Frames | None = None,
    ledger: Ledger | None = None,
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
        Filled if given; from `new_frames` for the scene's number of grains.
    ledger
        Filled with what was added up if given; from `new_ledger`.

    `final_particles` makes arrays of SI values of the particles.
    """
    abort = np.zeros(1, np.uint8) if abort is None else abort
    if frames is not None:
        particles = new_particles(scene, capacity_of(scene))
        return _with_frames(scene, random, particles, abort, frames, ledger), particles
    return _alone(scene, random, abort, None, ledger)


def simulate_counted(
    scene: Scene,
    random: np.random.Generator,
    census: CensusRoom,
    abort: npt.NDArray[np.uint8] | None = None,
    ledger: Ledger | None = None,
) -> tuple[Any, Any]:
    """Run one sample as `simulate_scene` does, and fill its `census`, from `new_census_room`."""
    return _alone(scene, random, np.zeros(1, np.uint8) if abort is None else abort, census, ledger)


def _alone(
    scene: Scene,
    random: np.random.Generator,
    abort: npt.NDArray[np.uint8],
    census: CensusRoom | None,
    ledger: Ledger | None,
) -> tuple[Any, Any]:
    """Run a range of one sample; return its `OUTCOME` record and its final `Particles`."""
    particles = new_particles(scene, capacity_of(scene))
    prepared = prepared_scene(scene)
    room = kept_room(prepared, particles, census is not None)
    draws = with_sizes(new_draws(), [drawn_sizes(scene, random)])
    results = new_results(1, spins=scene.has_spins)._replace(census=census)
    simulate_range(prepared.scene, room, random, draws, new_watch(abort), results)
    _keep(ledger, room.ledger)
    return room.record.copy()[0], particles


def _keep(wanted: Ledger | None, ledger: Ledger) -> None:
    """Copy a ledger to the one that was asked for."""
    if wanted is not None:
        for target, source in zip(wanted, ledger, strict=True):
            if target is not None:
                target[:] = source


def _with_frames(
    scene: Scene,
    random: np.random.Generator,
    particles: Particles,
    abort: npt.NDArray[np.uint8],
    frames: Frames,
    ledger: Ledger | None,
) -> Any:
    """Run one sample and fill its frames; return its `OUTCOME` record."""
    out = np.zeros(1, result.outcome_type(scene.has_spins))
    out["state"] = result.FAILED
    if place_grains(scene, random, particles, abort):
        _keep(ledger, carry_to_end(without_law(scene), particles, abort, out, frames))
    else:
        out["reason"] = result.FailureReason.PLACEMENT_JAMMED
    return out[0]


def simulate_samples(
    scene: Scene, words: npt.NDArray[np.uint64], first: int, watch: Watch, results: SampleResults
) -> bool:
    """Simulate consecutive samples; return whether the last one that began was cut off.

    Each is bit for bit that of `simulate_scene` with its own stream.

    Parameters
    ----------
    scene
        The scene.
    words
        Key of the streams, from `key_words`.
    first
        Number of the first sample.
    watch
        Ends the samples.
    results
        From `new_results` for the number of samples, at most `samples_at_once`. Those that are not
        finished, although none was cut off, were not begun.

    Raises
    ------
    Exception
        Whatever a law of sizes of the user's raises for the first sample.
    """
    stream = thread_stream()
    draws, count = draws_of(scene, stream, words, first, len(results.records))
    results = results._replace(records=results.records[:count])
    prepared = prepared_scene(scene)
    room = kept_room(prepared, counts=results.census is not None)
    cut: bool = simulate_range(prepared.scene, room, stream.random, draws, watch, results)
    return cut


def initial_radii(
    scene: Scene, new_random: Callable[[], np.random.Generator]
) -> npt.NDArray[np.float64]:
    """Return b/b⁰ of the grains that a sample begins with, shape (N,), the largest first.

    `new_random` returns the stream of the sample from its beginning; it is called where grains
    differ in size.
    """
    if scene.sizes is None:
        return np.ones(scene.particles)
    return draw_radii(scene.sizes, new_random(), scene.particles)


def count_collisions(
    scene: Scene,
    random: np.random.Generator,
    counts: CollisionCounts,
    abort: npt.NDArray[np.uint8],
) -> result.FailureReason | None:
    """Simulate a sample to its end and add its collisions to `counts`, from those of `scene`.

    The sample is that of `simulate_scene` with the same stream and `abort`. Returns why it failed,
    if it did; its collisions are in the counts then, too.
    """
    particles = new_particles(scene, capacity_of(scene))
    if not place_grains(scene, random, particles, abort):
        return result.FailureReason.PLACEMENT_JAMMED
    ledger = new_ledger()._replace(collisions=counts)
    state, initial = kept_engine_state(scene, particles.records.size), np.zeros(1, INITIAL)
    run = without_law(scene), particles, ledger, state, initial
    end_counts(counts, run_engine(*run, scene.end_time, abort))
    exhausted = ledger.counts[EXHAUSTED] > 0
    return result.FailureReason.BUDGET_EXCEEDED if exhausted else None


def count_changes(scene: Scene, random: np.random.Generator, until: float) -> int:
    """Return the number of merges and breakups of a sample until a time in s before its end.

    The sample is that of `simulate_scene` with the same stream; it is not carried further.
    """
    capacity = capacity_of(scene)
    particles, ledger = new_particles(scene, capacity), new_ledger()
    abort = np.zeros(1, np.uint8)
    if place_grains(scene, random, particles, abort):
        state, initial = kept_engine_state(scene, capacity), np.zeros(1, INITIAL)
        run_engine(without_law(scene), particles, ledger, state, initial, until, abort)
    return int(ledger.counts[MERGES] + ledger.counts[BREAKUPS])


def place_grains(
    scene: Scene,
    random: np.random.Generator,
    particles: Particles,
    abort: npt.NDArray[np.uint8],
) -> bool:
    """Draw sizes of the grains of a sample, places and velocities; return whether all have a place.

    The largest come first. `abort` is that of `simulate_scene`.
    """
    placed, velocity = np.empty((2, 3, scene.particles))
    sizes: EqualSizes | DifferentSizes = EqualSizes(2.0 * scene.radius)
    if (drawn := drawn_sizes(scene, random)) is not None:
        radii, masses = drawn
        if not radii[0] < scene.half_width:
            return False
        particles.radius[: scene.particles] = radii
        particles.mass[: scene.particles] = masses
        sizes = DifferentSizes(radii, float(radii[0]))
    if not scatter(
        scene.escape, scene.velocities, random, sizes, scene.half_width, placed, velocity, abort
    ):
        return False
    particles.position[:, : scene.particles] = placed
    particles.velocity[:, : scene.particles] = velocity
    draw_spins(scene.laws.friction, scene.escape, random, particles)
    return True


def carry_to_end(
    scene: Scene,
    particles: Particles,
    abort: npt.NDArray[np.uint8] | None,
    out: npt.NDArray[Any],
    frames: Frames | None = None,
) -> Ledger:
    """Run particles from where they are to the scene's end, and measure them.

    Parameters
    ----------
    scene, abort, frames
        As for `simulate_scene`.
    particles
        Those at the end afterwards.
    out
        Array of `outcome_type`, shape (1,), filled.

    Returns
    -------
    Ledger
        What was added up.
    """
    ledger, initial = new_ledger(), np.zeros(1, INITIAL)
    abort = np.zeros(1, np.uint8) if abort is None else abort
    engine_state = kept_engine_state(scene, particles.records.size)
    run = scene, particles, ledger, engine_state, initial
    if frames is None:
        end = run_engine(*run, scene.end_time, abort)
    else:
        end = run_with_frames(run, abort, frames)
    measure_sample(scene, particles, ledger, initial, end, out)
    if frames is not None and out["state"][0] == result.COMPLETED and end >= scene.end_time:
        for f in np.flatnonzero(frames.times >= scene.end_time).tolist():
            store_frame(frames, f, scene, particles)
    return ledger


def run_with_frames(
    run: tuple[Scene, Particles, Ledger, Any, npt.NDArray[Any]],
    abort: npt.NDArray[np.uint8],
    frames: Frames,
) -> float:
    """Run to the scene's end and store the frames before it; return the time reached in s.

    `run` holds the first arguments of `run_engine`.
    """
    scene, particles, _, engine_state, initial = run
    observer = new_observer(scene, particles.records.size)
    for f in np.flatnonzero(frames.times < scene.end_time).tolist():
        time = frames.times[f]
        if time > 0.0:
            reached = run_engine(*run, time, abort)
            if reached < time:
                return float(reached)
            if abort[0]:
                break
            observer.drift[:] = initial["drift"][0]
            observe_particles(scene, particles, engine_state, observer, time)
        store_frame(frames, f, scene, observer.copy if time > 0.0 else particles)
    return float(run_engine(*run, scene.end_time, abort))
