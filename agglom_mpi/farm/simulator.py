"""Samples of one task after the other: what a rank computes, and what it makes of errors."""

import time
import traceback
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.database.bulk import final_row, frame_rows
from agglom_mpi.database.schema import TOOK_TOO_LONG
from agglom_mpi.farm.messages import RESULT, failed_sample
from agglom_mpi.farm.work import Setup, Work
from agglom_mpi.search.objectives import make_objective
from agglom_mpi.simulation.outcome import (
    COMPLETED,
    EXCEPTION,
    FAILED,
    OUTCOME,
    TIMED_OUT,
    final_particles,
)
from agglom_mpi.simulation.sample import random_stream, simulate_scene
from agglom_mpi.simulation.scene import Scene, build_scene
from agglom_mpi.simulation.snapshots import Frames, frame_times, new_frames


class Batch(NamedTuple):
    """What became of a batch of tasks: rows of `/samples` and what goes with them.

    `failures` are `FAILED_SAMPLE` records, `finals` rows of `/final_particles` and `frames` of
    `/frames`; nothing, if they are not stored.
    """

    results: list[NDArray[np.void]]
    failures: list[NDArray[np.void]]
    finals: list[NDArray[np.void]]
    frames: list[NDArray[np.void]]


class Simulator:
    """Turn tasks into results; the same on every rank, and what `campaign.simulate` does.

    Attributes
    ----------
    watch
        Ends samples early.
    grains
        Most particles of a stored sample.
    """

    def __init__(self, work: Work, rank: int) -> None:
        self.watch = Watch(work.max_seconds)
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
                random = random_stream(0, parameters, 0)
                simulate_scene(scene, random, np.ones(1, np.uint8), frames)

    def begin(self, task: np.void) -> "Job":
        """Begin a task; `Job.go_on` does it."""
        return Pictures(self, task) if task["frames"] else Series(self, task)

    def scene_of(self, string: int, setup: Setup, parameters: NDArray[np.float64]) -> Scene:
        """Typed scene of a string; that of the last one is kept."""
        key = string, parameters.tobytes()
        if self._scene is None or self._scene[0] != key:
            self._scene = key, scene_of(setup, parameters)
        return self._scene[1]


def scene_of(setup: Setup, parameters: NDArray[np.float64]) -> Scene:
    """Typed scene of one parameter string in a set-up."""
    return build_scene(setup.campaign.scene, parameters, setup.engine)


class Watch:
    """Ends samples early: all of them on `stop`, one that takes too long on `look`.

    Both are called by another thread than the one that simulates.

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
        self._begun = time.monotonic()

    def stop(self) -> None:
        """End all samples, from now on."""
        self.stopped = True
        self.abort[0] = 1

    def look(self) -> None:
        """End the sample under way if it has taken too long."""
        if self.max_seconds is not None and self._late:
            self.abort[0] = 1

    def begin(self) -> None:
        """Start the clock of a sample."""
        self._begun = time.monotonic()

    def end(self) -> tuple[bool, bool]:
        """Whether the sample took too long, and whether anything may have ended it early."""
        late, hurried = self._late, bool(self.abort[0])
        if hurried and not self.stopped:
            self.abort[0] = 0
            if self.stopped:  # just now
                self.abort[0] = 1
        return late, hurried

    @property
    def _late(self) -> bool:
        return self.max_seconds is not None and time.monotonic() - self._begun > self.max_seconds


class Job(ABC):
    """One task on its way.

    Parameters
    ----------
    simulator
        Of this rank.
    task
        A `TASK`.
    """

    def __init__(self, simulator: Simulator, task: np.void) -> None:
        self._simulator = simulator
        self._watch = simulator.watch
        self._string, self._first, self._count = (
            int(task[name]) for name in ("string", "first", "count")
        )
        self._frames = int(task["frames"])
        self._parameters = np.array(task["parameters"])
        self._done = 0
        self._failures: list[NDArray[np.void]] = []

    @abstractmethod
    def go_on(self) -> bool:
        """Do the next sample; whether there is another one to do."""

    @abstractmethod
    def take(self, batch: Batch) -> None:
        """Add to a batch what was done since it was taken last."""

    def _start(self, sample: int) -> tuple[Setup, Scene, np.random.Generator]:
        setup = self._simulator.work.setup(self._string)
        scene = self._simulator.scene_of(self._string, setup, self._parameters)
        seed, number = setup.campaign.seed, setup.first_sample + sample
        return setup, scene, random_stream(seed, self._parameters, number)

    def _failed(self, sample: int, text: str) -> None:
        self._failures.append(failed_sample(self._string, sample, self._simulator.rank, text))

    def _give_failures(self, batch: Batch) -> None:
        batch.failures.extend(self._failures)
        self._failures = []


class Series(Job):
    """Samples to be judged."""

    def __init__(self, simulator: Simulator, task: np.void) -> None:
        super().__init__(simulator, task)
        self._taken = 0
        self._records = np.zeros(self._count, OUTCOME)
        self._rows = np.zeros(self._count, RESULT)
        self._rows["string"], self._rows["rank"] = self._string, simulator.rank
        self._rows["sample"] = np.arange(self._first, self._first + self._count)
        self._seconds, self._finished = self._rows["seconds"], self._rows["finished"]
        self._finals: list[NDArray[np.void]] = []

    def go_on(self) -> bool:
        """Simulate the next sample; one that is ended by `Watch.stop` never was."""
        watch, at = self._watch, self._done
        watch.begin()
        begin = time.perf_counter()
        final = self._simulate(at)
        late, hurried = watch.end()
        if watch.stopped:
            return False
        if late:
            final = self._give_up(at)
        elif hurried:  # by a look that was meant for the sample before
            return True
        self._seconds[at] = time.perf_counter() - begin
        self._finished[at] = time.time()
        self._finals.extend(final)
        self._done += 1
        return self._done < self._count

    def take(self, batch: Batch) -> None:
        """Add rows, texts of errors and final particles."""
        rows, records = (a[self._taken : self._done] for a in (self._rows, self._records))
        self._taken = self._done
        for name in OUTCOME.names or ():
            rows[name] = records[name]
        completed = rows["state"] == COMPLETED
        if completed.any():
            campaign = self._simulator.work.setup(self._string).campaign
            objective = make_objective(campaign.objective, campaign.scene.particles)
            rows["objective"][completed] = objective.of_sample(rows["mean_radius_ratio"][completed])
        if len(rows):
            batch.results.append(rows)
        batch.finals.extend(self._finals)
        self._finals = []
        self._give_failures(batch)

    def _simulate(self, at: int) -> list[NDArray[np.void]]:
        """Fill the record of a sample; its row of final particles, if they are wanted."""
        sample, record = self._first + at, self._records[at]
        try:
            _, scene, random = self._start(sample)
            self._records[at], particles = simulate_scene(scene, random, self._watch.abort)
            if self._simulator.finals and record["state"] == COMPLETED:
                return [self._final(sample, scene, particles)]
        except Exception:
            record["state"], record["reason"] = FAILED, EXCEPTION
            self._failed(sample, traceback.format_exc())
        return []

    def _final(self, sample: int, scene: Scene, particles: Any) -> NDArray[np.void]:
        final = final_particles(scene, particles)
        return final_row(self._string, sample, final, scene.particles)

    def _give_up(self, at: int) -> list[NDArray[np.void]]:
        """Let a sample that took too long have failed, without final particles."""
        self._records[at] = np.zeros((), OUTCOME)
        self._records[at]["state"], self._records[at]["reason"] = FAILED, TIMED_OUT
        self._failed(self._first + at, f"{TOOK_TOO_LONG} {self._watch.max_seconds:g} s")
        return []


class Pictures(Job):
    """Samples that are judged already, to be looked at."""

    def __init__(self, simulator: Simulator, task: np.void) -> None:
        super().__init__(simulator, task)
        self._taken: list[NDArray[np.void]] = []

    def go_on(self) -> bool:
        """Take the pictures of the next sample."""
        sample = self._first + self._done
        try:
            _, scene, random = self._start(sample)
            frames = new_frames(frame_times(self._frames, scene.end_time), scene.particles)
            # A sample that fails has no particles in the pictures after that.
            simulate_scene(scene, random, self._watch.abort, frames)
            if self._watch.stopped:
                return False
            self._taken.append(frame_rows(self._string, sample, frames))
        except Exception:
            self._failed(sample, traceback.format_exc())
        self._done += 1
        return self._done < self._count

    def take(self, batch: Batch) -> None:
        """Add rows of `/frames` and texts of errors."""
        batch.frames.extend(self._taken)
        self._taken = []
        self._give_failures(batch)
