"""Simulating batches of tasks in a thread, while the rank's main thread serves messages."""

import queue
import threading
import time
import traceback
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.database.bulk import final_row, frame_rows
from agglom_mpi.farm.messages import RESULT, failed_sample
from agglom_mpi.farm.work import Setup, Work
from agglom_mpi.search.objectives import make_objective
from agglom_mpi.simulation.outcome import (
    COMPLETED,
    EXCEPTION,
    FAILED,
    OUTCOME,
    final_particles,
)
from agglom_mpi.simulation.sample import random_stream, simulate_scene
from agglom_mpi.simulation.scene import Scene, build_scene
from agglom_mpi.simulation.snapshots import Frames, frame_times, new_frames

HELD_BACK: Final = 0.1
"""Seconds after which finished samples do not wait for the next of their batch."""


class Batch(NamedTuple):
    """What became of a batch of tasks: rows of `/samples` and what goes with them.

    `failures` are `FAILED_SAMPLE` records, `finals` rows of `/final_particles` and `frames` of
    `/frames`; nothing, if they are not stored.
    """

    results: list[NDArray[np.void]]
    failures: list[NDArray[np.void]]
    finals: list[NDArray[np.void]]
    frames: list[NDArray[np.void]]

    def add(self, other: "Batch") -> None:
        """Take what is in another batch, too."""
        for mine, theirs in zip(self, other, strict=True):
            mine.extend(theirs)


class Simulator:
    """Turn tasks into results; the same on every rank, and what `campaign.simulate` does."""

    def __init__(self, work: Work, rank: int) -> None:
        self.abort = np.zeros(1, np.uint8)
        self._work = work
        self._rank = rank
        self._finals = work.room.final_particles
        self.grains = work.room.grains
        self._scene: tuple[tuple[int, bytes], Scene] | None = None

    def warm_up(self) -> None:
        """Compile, or load from the cache, all that a sample of this work needs."""
        for setup, parameters in self._work.kinds():
            scene = scene_of(setup, parameters)._replace(particles=2)
            views: list[Frames | None] = [None]
            if self._work.room.frames:  # looking takes a kernel of its own
                views.append(new_frames(np.zeros(1), scene.particles))
            for frames in views:
                random = random_stream(0, parameters, 0)
                simulate_scene(scene, random, np.ones(1, np.uint8), frames)

    def carry_out(self, task: np.void, batch: Batch) -> None:
        """Do one task, and add what comes of it to a batch."""
        if task["frames"]:
            self._take_pictures(task, batch)
        else:
            self._simulate(task, batch)

    def _simulate(self, task: np.void, batch: Batch) -> None:
        result = np.zeros(1, RESULT)
        result["string"], result["sample"] = task["string"], task["sample"]
        result["rank"] = self._rank
        begin = time.perf_counter()
        try:
            setup, scene, random = self._start(task)
            record, particles = simulate_scene(scene, random, self.abort)
            for name in OUTCOME.names or ():
                result[name] = record[name]
            if record["state"] == COMPLETED:
                objective = make_objective(setup.campaign.objective, scene.particles)
                result["objective"] = objective.of_sample(float(record["mean_radius_ratio"]))
                if self._finals:
                    batch.finals.append(_final_row(task, scene, particles))
        except Exception:
            result["state"], result["reason"] = FAILED, EXCEPTION
            batch.failures.append(self._failure(task))
        result["seconds"], result["finished"] = time.perf_counter() - begin, time.time()
        batch.results.append(result)

    def _take_pictures(self, task: np.void, batch: Batch) -> None:
        try:
            _, scene, random = self._start(task)
            times = frame_times(int(task["frames"]), scene.end_time)
            frames = new_frames(times, scene.particles)
            # A sample that fails has no particles in the pictures after that.
            simulate_scene(scene, random, self.abort, frames)
            batch.frames.append(frame_rows(int(task["string"]), int(task["sample"]), frames))
        except Exception:
            batch.failures.append(self._failure(task))

    def _start(self, task: np.void) -> tuple[Setup, Scene, np.random.Generator]:
        parameters = np.array(task["parameters"])
        setup = self._work.setup(int(task["string"]))
        sample = setup.first_sample + int(task["sample"])
        scene = self._scene_of(int(task["string"]), setup, parameters)
        return setup, scene, random_stream(setup.campaign.seed, parameters, sample)

    def _failure(self, task: np.void) -> NDArray[np.void]:
        string, sample = int(task["string"]), int(task["sample"])
        return failed_sample(string, sample, self._rank, traceback.format_exc())

    def _scene_of(self, string: int, setup: Setup, parameters: NDArray[np.float64]) -> Scene:
        key = string, parameters.tobytes()
        if self._scene is None or self._scene[0] != key:
            self._scene = key, scene_of(setup, parameters)
        return self._scene[1]


def scene_of(setup: Setup, parameters: NDArray[np.float64]) -> Scene:
    """Typed scene of one parameter string in a set-up."""
    return build_scene(setup.campaign.scene, parameters, setup.engine)


def _final_row(task: np.void, scene: Scene, particles: Any) -> NDArray[np.void]:
    final = final_particles(scene, particles)
    return final_row(int(task["string"]), int(task["sample"]), final, scene.particles)


class SimulatorThread:
    """A thread that simulates batches in the order they come.

    What is finished does not wait for long for the rest of its batch. An exception of the thread
    itself is raised by `take`.
    """

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator
        self._batches: queue.SimpleQueue[NDArray[np.void] | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="simulator", daemon=True)
        self._thread.start()

    def put(self, tasks: NDArray[np.void]) -> None:
        """Queue a batch."""
        self._batches.put(tasks)

    def take(self, timeout: float) -> Batch | None:
        """Next finished batch, waiting at most `timeout` in s; None if there is none."""
        try:
            item = self._results.get(timeout=timeout) if timeout else self._results.get_nowait()
        except queue.Empty:
            return None
        if isinstance(item, BaseException):
            raise item
        assert isinstance(item, Batch)
        return item

    def stop(self) -> None:
        """Abandon what is running and queued, and wait for the thread to end.

        `take` still gives what was finished.
        """
        self._simulator.abort[0] = 1
        self._batches.put(None)
        self._thread.join()

    def _work(self) -> None:
        try:
            while (tasks := self._batches.get()) is not None:
                self._carry_out(tasks)
        except BaseException as error:
            self._results.put(error)

    def _carry_out(self, tasks: NDArray[np.void]) -> None:
        batch, begun = Batch([], [], [], []), time.monotonic()
        for task in tasks:
            done = Batch([], [], [], [])
            self._simulator.carry_out(task, done)
            if self._simulator.abort[0]:  # perhaps in the middle of this one
                break
            batch.add(done)
            if time.monotonic() - begun > HELD_BACK:
                self._results.put(batch)
                batch, begun = Batch([], [], [], []), time.monotonic()
        if any(batch):
            self._results.put(batch)
