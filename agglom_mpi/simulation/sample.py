"""One sample: a pure function of scene and random stream, from placement to result.

Three kernels, so that two processes can compile them at once: placement, which depends on little
of a scene; the engine; what is measured at the end.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Final

import numpy as np
import numpy.typing as npt

import agglom_mpi.simulation.event_driven.engine
import agglom_mpi.simulation.time_driven.steppers  # noqa: F401  (all register their engines)
from agglom_mpi import outcome as result
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import FinalParticles
from agglom_mpi.physics.size_distributions import draw_radii
from agglom_mpi.public_face import PublicFace
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.simulation.initial_state import DifferentSizes, EqualSizes, scatter
from agglom_mpi.simulation.measurement import (
    is_finite,
    measure,
    measure_initial,
    measure_ledger,
)
from agglom_mpi.simulation.particles import (
    BREAKUPS,
    EXHAUSTED,
    MERGES,
    Ledger,
    Particles,
    new_ledger,
    new_particles,
)
from agglom_mpi.simulation.reference_frame import to_box_frame, to_mass_frame
from agglom_mpi.simulation.scene import Scene, advance_to, begin, finish, new_engine_state
from agglom_mpi.simulation.temperature import cool_until
from agglom_mpi.simulation.trajectory import new_observer, observe_particles, store_frame


@dataclass(frozen=True, repr=False, eq=False)
class Outcome(metaclass=PublicFace, internal=["measured"]):
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
        Closure errors and counts of everything that was capped or refused.
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
        [measured] = result.summaries(np.array([self.record], result.OUTCOME))
        returned = tuple(value for _, value in sorted(self.quantities.items()))
        return measured._replace(objective=self.objective, quantities=returned)


INITIAL: Final = np.dtype(
    [("begun", "u1"), ("drift", "f8", 3), ("momentum", "f8", 3)]
    + [(name, "f8") for name in ("energy", "momentum_scale", "heat")]
)
"""State when a run begins, SI: the velocity of the frame of reference that the engine works in; in
it momentum, kinetic energy and sum of m|v|; heat above the scene's temperature."""


@kernel
def run_engine(scene, particles, ledger, engine_state, initial, until, abort):
    """Run particles on to a time; return the time reached in s.

    A run begins where `initial` says that it has not begun, and ends where `until` is the scene's
    end or the run ends earlier.

    Parameters
    ----------
    scene : Scene
    particles : Particles; at the end of the run, those at the time reached
    ledger : Ledger, added to
    engine_state : what `new_engine_state` returned for the scene
    initial : array of `INITIAL`, shape (1,), filled when the run begins
    until : float, s
    abort : uint8 array, shape (1,); anything but 0 ends the run early
    """
    begun = initial[0]["begun"]
    while True:
        # Compiled first, while another process compiles what a run begins with.
        if begun:
            time = advance_to(scene.engine, scene, particles, ledger, engine_state, until, abort)
            if until >= scene.end_time or time < until:
                finish(scene.engine, scene, particles, ledger, engine_state, time)
            return time
        measure_initial(scene, particles, to_mass_frame(scene, particles), initial[0])
        begin(scene.engine, scene, particles, engine_state)
        begun = initial[0]["begun"]


@kernel
def measure_sample(scene, particles, ledger, initial, end, out):
    """Return particles at the time `end` in s to the frame of the box, and measure them.

    Parameters
    ----------
    scene, particles, ledger, initial
        As `run_engine` left them.
    end : float, s
    out : array of `OUTCOME`, shape (1,), filled
    """
    record = out[0]
    record["end_time"] = end
    for i in range(particles.size[0]):
        cool_until(scene.cooling, scene, particles.records[i], ledger, end)
    if ledger.counts[EXHAUSTED] > 0:
        record["reason"] = result.FailureReason.BUDGET_EXCEEDED
        return
    if not is_finite(particles):
        record["reason"] = result.FailureReason.NON_FINITE
        return
    measure(scene, particles, record)
    measure_ledger(scene, particles, ledger, initial[0], record)
    to_box_frame(scene, particles, initial[0]["drift"], end)
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
        Filled if given; from `new_frames` for the scene's number of grains.

    `final_particles` makes arrays of SI values of the particles.
    """
    out = np.zeros(1, result.OUTCOME)
    out["state"] = result.FAILED
    capacity = (1 if scene.laws.fragmentation is None else 2) * scene.particles
    particles = new_particles(scene, capacity)
    abort = np.zeros(1, np.uint8) if abort is None else abort
    if place_grains(scene, random, particles, abort):
        carry_to_end(without_law(scene), particles, abort, out, frames)
    else:
        out["reason"] = result.FailureReason.PLACEMENT_JAMMED
    return out[0], particles


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


def count_changes(scene: Scene, random: np.random.Generator, until: float) -> int:
    """Return the number of merges and breakups of a sample until a time in s before its end.

    The sample is that of `simulate_scene` with the same stream; it is not carried further.
    """
    capacity = (1 if scene.laws.fragmentation is None else 2) * scene.particles
    particles, ledger = new_particles(scene, capacity), new_ledger()
    abort = np.zeros(1, np.uint8)
    if place_grains(scene, random, particles, abort):
        state, initial = kept_engine_state(scene, capacity), np.zeros(1, INITIAL)
        run_engine(without_law(scene), particles, ledger, state, initial, until, abort)
    return int(ledger.counts[MERGES] + ledger.counts[BREAKUPS])


def without_law(scene: Scene) -> Scene:
    """Return a scene that says whether grains differ in size, but not by which law.

    So one machine code serves all of them once the grains are placed.
    """
    return scene if scene.sizes is None else scene._replace(sizes=True)


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
    if scene.sizes is not None:
        radii = scene.radius * draw_radii(scene.sizes, random, scene.particles)
        if not radii[0] < scene.half_width:
            return False
        particles.radius[: scene.particles] = radii
        particles.mass[: scene.particles] = scene.mass * (radii / scene.radius) ** 3
        sizes = DifferentSizes(radii, float(radii[0]))
    if not scatter(
        scene.escape, scene.velocities, random, sizes, scene.half_width, placed, velocity, abort
    ):
        return False
    particles.position[:, : scene.particles] = placed
    particles.velocity[:, : scene.particles] = velocity
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
        Array of `OUTCOME`, shape (1,), filled.

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


_kept = threading.local()


def kept_engine_state(scene: Scene, capacity: int) -> Any:
    """Return the engine state of this thread's last sample, or a new one if that was not alike.

    To make it anew takes a tenth of the time of a sample: a system gives back large arrays at once.
    """
    key = type(scene.engine), scene.particles, capacity
    if getattr(_kept, "key", None) != key:
        _kept.key, _kept.state = key, new_engine_state(scene.engine, scene, capacity)
    return _kept.state


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
