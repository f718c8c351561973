"""Samples of one task after the other: what a rank computes, and what it makes of errors."""

import time
import traceback
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.user_function import evaluate
from agglom_mpi.outcome import COMPLETED, EXCEPTION, FAILED, OUTCOME, TIMED_OUT, final_particles
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.runtime.experiment import Experiment, SampleSetup
from agglom_mpi.runtime.messages import NOT_NEEDED, RESULT, failed_sample
from agglom_mpi.simulation.finished import finished_sample
from agglom_mpi.simulation.frames import Frames, frame_times, new_frames
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.storage.particle_tables import final_row, frame_rows
from agglom_mpi.storage.schema import TOOK_TOO_LONG


class Batch(NamedTuple):
    """What became of a batch of tasks: rows of `/samples` and what goes with them.

    `failures` are `FAILED_SAMPLE` records, `finals` rows of `/final_particles` and `frames` of
    `/frames`; nothing, if they are not stored.
    """

    results: list[NDArray[np.void]]
    failures: list[NDArray[np.void]]
    finals: list[NDArray[np.void]]
    frames: list[NDArray[np.void]]


class SampleRunner:
    """Turn tasks into results; the same on every rank, and what `campaign.simulate` does.

    Attributes
    ----------
    watch
        Ends samples early.
    grains
        Most particles of a stored sample.
    """

    def __init__(self, work: Experiment, rank: int) -> None:
        self.watch = AbortFlag(work.max_seconds)
        self.work = work
        self.rank = rank
        self.finals = work.room.final_particles
        self.grains = work.room.grains
        self._scene: tuple[tuple[int, bytes], Scene] | None = None

    def warm_up(self) -> None:
        """Compile, or load from the cache, all that a sample of this work needs."""
        for setup, parameters in self.work.kinds():
            scene = scene_of(setup, parameters)._replace(particles=2)
            views: list[Frames | None] = [None]
            if self.work.room.frames:  # looking takes a kernel of its own
                views.append(new_frames(np.zeros(1), scene.particles))
            for frames in views:
                random = sample_stream(0, parameters, 0)
                simulate_scene(scene, random, np.ones(1, np.uint8), frames)

    def begin(self, task: np.void) -> "Task":
        """Begin a task; `Task.go_on` does it."""
        return FrameTask(self, task) if task["frames"] else SampleTask(self, task)

    def scene_of(self, string: int, setup: SampleSetup, parameters: NDArray[np.float64]) -> Scene:
        """Typed scene of a string; that of the last one is kept."""
        key = string, parameters.tobytes()
        if self._scene is None or self._scene[0] != key:
            self._scene = key, scene_of(setup, parameters)
        return self._scene[1]


def scene_of(setup: SampleSetup, parameters: NDArray[np.float64]) -> Scene:
    """Typed scene of one parameter string in a set-up."""
    return setup.campaign.scene.build(parameters, setup.engine)


class AbortFlag:
    """Ends samples early: all on `stop`, one that takes too long on `look`, any one on `interrupt`.

    All are called by another thread than the one that simulates.

    Parameters
    ----------
    max_seconds
        Time that a sample may take, None for ever.

    Attributes
    ----------
    abort
        What kernels look at, shape (1,); anything but 0 ends them.
    stopped
        Whether no more samples are wanted.
    """

    def __init__(self, max_seconds: float | None) -> None:
        self.abort = np.zeros(1, np.uint8)
        self.stopped = False
        self.max_seconds = max_seconds
        self._begun: float | None = None

    def stop(self) -> None:
        """End all samples, from now on."""
        self.stopped = True
        self.abort[0] = 1

    def look(self) -> None:
        """End the sample under way if it has taken too long."""
        if self._late:
            self.abort[0] = 1

    def interrupt(self) -> None:
        """End the sample under way, if there is one; it can be done again."""
        self.abort[0] = 1

    def begin(self) -> None:
        """Start the clock of a sample."""
        if self.max_seconds is not None:
            self._begun = time.monotonic()

    def end(self) -> tuple[bool, bool]:
        """Stop the clock: did it take too long, and may anything have ended the sample early?"""
        late, self._begun = self._late, None
        hurried = bool(self.abort[0])
        if hurried and not self.stopped:
            self.abort[0] = 0
            if self.stopped:  # just now
                self.abort[0] = 1
        return late, hurried

    @property
    def _late(self) -> bool:
        begun, most = self._begun, self.max_seconds
        return begun is not None and most is not None and time.monotonic() - begun > most


class Task(ABC):
    """One task on its way.

    Parameters
    ----------
    simulator
        Of this rank.
    task
        A `TASK`.
    """

    def __init__(self, simulator: SampleRunner, task: np.void) -> None:
        self._simulator = simulator
        self._watch = simulator.watch
        self._string, self._first, self._count = (
            int(task[name]) for name in ("string", "first", "count")
        )
        self._frames = int(task["frames"])
        self._parameters = np.array(task["parameters"])
        self._done = 0
        self._in_vain = 0.0  # time that a sample took which was ended, s
        self._failures: list[NDArray[np.void]] = []

    def go_on(self) -> bool:
        """Do the next sample; whether there is another one to do.

        One that is ended by `AbortFlag.stop` never was, and one that is ended by a look that was
        meant for the sample before, or by `AbortFlag.interrupt`, is done again.
        """
        begin, text, reason = time.perf_counter(), "", 0
        self._watch.begin()
        try:
            self._do(self._first + self._done)
        except Exception:
            text, reason = traceback.format_exc(), EXCEPTION
        late, hurried = self._watch.end()
        if self._watch.stopped:
            return False
        if late:
            text, reason = f"{TOOK_TOO_LONG} {self._watch.max_seconds:g} s", TIMED_OUT
        elif hurried:
            self._in_vain = time.perf_counter() - begin
            return True
        if reason:
            sample, rank = self._first + self._done, self._simulator.rank
            self._failures.append(failed_sample(self._string, sample, rank, text, self._frames))
        self._keep(reason, time.perf_counter() - begin)
        self._done += 1
        return self._done < self._count

    def give_up(self) -> None:
        """Leave out what is not done: it is not needed any more."""
        while self._done < self._count:
            self._keep(NOT_NEEDED, self._in_vain)
            self._in_vain = 0.0
            self._done += 1

    @abstractmethod
    def _do(self, sample: int) -> None:
        """Simulate a sample."""

    @abstractmethod
    def _keep(self, reason: int, seconds: float) -> None:
        """Take what `_do` has made, in so many seconds; nothing if it failed for a reason."""

    @abstractmethod
    def take(self, batch: Batch) -> None:
        """Add to a batch what was done since it was taken last."""

    def _start(self, sample: int) -> tuple[SampleSetup, Scene, np.random.Generator]:
        setup = self._simulator.work.setup(self._string)
        scene = self._simulator.scene_of(self._string, setup, self._parameters)
        of, number = setup.campaign, setup.first_sample + sample
        random = sample_stream(of.seed, self._parameters, number, of.common_configurations)
        return setup, scene, random

    def _give_failures(self, batch: Batch) -> None:
        batch.failures.extend(self._failures)
        self._failures = []


class SampleTask(Task):
    """Samples to be judged."""

    def __init__(self, simulator: SampleRunner, task: np.void) -> None:
        super().__init__(simulator, task)
        self._taken = 0
        self._rows = np.zeros(self._count, RESULT)
        self._records = self._rows[list(OUTCOME.names or ())]  # a view
        self._rows["string"], self._rows["rank"] = self._string, simulator.rank
        self._rows["sample"] = np.arange(self._first, self._first + self._count)
        self._seconds, self._finished = self._rows["seconds"], self._rows["finished"]
        self._final: NDArray[np.void] | None = None
        self._finals: list[NDArray[np.void]] = []

    def take(self, batch: Batch) -> None:
        """Add rows, texts of errors and final particles."""
        rows = self._rows[self._taken : self._done]
        self._taken = self._done
        completed = rows["state"] == COMPLETED
        if completed.any():
            campaign = self._simulator.work.setup(self._string).campaign
            objective = campaign.objective.build(campaign.scene.particles)
            rows["objective"][completed] = objective.of_samples(rows)[completed]
        if len(rows):
            batch.results.append(rows)
        batch.finals.extend(self._finals)
        self._finals = []
        self._give_failures(batch)

    def _do(self, sample: int) -> None:
        self._final = None
        setup, scene, random = self._start(sample)
        record, code = self._records[self._done], setup.campaign.user_function
        self._records[self._done], particles = simulate_scene(scene, random, self._watch.abort)
        keeps = self._simulator.finals
        if record["state"] != COMPLETED or not (keeps or code):
            return
        final = final_particles(scene, particles)
        if keeps:
            self._final = final_row(self._string, sample, final, scene.particles)
        if code and not self._watch.abort[0]:  # one that was cut short is not finished
            seen = finished_sample(scene, self._parameters, record, final)
            self._rows["objective"][self._done] = evaluate(code, seen)

    def _keep(self, reason: int, seconds: float) -> None:
        at = self._done
        if reason:
            self._records[at] = np.zeros((), OUTCOME)
            self._records[at]["state"], self._records[at]["reason"] = FAILED, reason
            self._rows["objective"][at] = 0.0
        elif self._final is not None:
            self._finals.append(self._final)
        self._seconds[at], self._finished[at] = seconds, time.time()


class FrameTask(Task):
    """Samples that are judged already, to be looked at."""

    def __init__(self, simulator: SampleRunner, task: np.void) -> None:
        super().__init__(simulator, task)
        self._picture: NDArray[np.void] | None = None
        self._taken: list[NDArray[np.void]] = []

    def take(self, batch: Batch) -> None:
        """Add rows of `/frames` and texts of errors."""
        batch.frames.extend(self._taken)
        self._taken = []
        self._give_failures(batch)

    def _do(self, sample: int) -> None:
        self._picture = None
        _, scene, random = self._start(sample)
        frames = new_frames(frame_times(self._frames, scene.end_time), scene.particles)
        # A sample that fails has no particles in the pictures after that.
        simulate_scene(scene, random, self._watch.abort, frames)
        self._picture = frame_rows(self._string, sample, frames)

    def _keep(self, reason: int, seconds: float) -> None:
        if not reason and self._picture is not None:
            self._taken.append(self._picture)
