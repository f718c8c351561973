"""Simulating batches of tasks in a thread, while the rank's main thread serves messages."""

import queue
import threading
import time
import traceback
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.messages import RESULT, failed_sample
from agglom_mpi.farm.work import Setup, Work
from agglom_mpi.search.objectives import make_objective
from agglom_mpi.simulation.outcome import COMPLETED, EXCEPTION, FAILED, OUTCOME
from agglom_mpi.simulation.sample import random_stream, simulate_scene
from agglom_mpi.simulation.scene import Scene, build_scene


class Simulator:
    """Turn tasks into results; the same on every rank, and what `campaign.simulate` does."""

    def __init__(self, work: Work, rank: int) -> None:
        self.abort = np.zeros(1, np.uint8)
        self._work = work
        self._rank = rank
        self._scene: tuple[tuple[int, bytes], Scene] | None = None

    def warm_up(self) -> None:
        """Compile, or load from the cache, all that a sample of this work needs."""
        for setup, parameters in self._work.kinds():
            scene = scene_of(setup, parameters)._replace(particles=2)
            simulate_scene(scene, random_stream(0, parameters, 0), np.ones(1, np.uint8))

    def simulate(self, task: np.void) -> tuple[NDArray[np.void], NDArray[np.void] | None]:
        """Return the result of one task, shape (1,), and a `FAILED_SAMPLE` if it raised."""
        result = np.zeros(1, RESULT)
        result["string"], result["sample"] = task["string"], task["sample"]
        result["rank"] = self._rank
        failure = None
        begin = time.perf_counter()
        try:
            parameters = np.array(task["parameters"])
            setup = self._work.setup(int(task["string"]))
            sample = setup.first_sample + int(task["sample"])
            scene = self._scene_of(int(task["string"]), setup, parameters)
            random = random_stream(setup.campaign.seed, parameters, sample)
            record, _ = simulate_scene(scene, random, self.abort)
            for name in OUTCOME.names or ():
                result[name] = record[name]
            if record["state"] == COMPLETED:
                objective = make_objective(setup.campaign.objective, scene.particles)
                result["objective"] = objective.of_sample(float(record["mean_radius_ratio"]))
        except Exception:
            result["state"], result["reason"] = FAILED, EXCEPTION
            failure = failed_sample(
                int(task["string"]), int(task["sample"]), self._rank, traceback.format_exc()
            )
        result["seconds"] = time.perf_counter() - begin
        return result, failure

    def _scene_of(self, string: int, setup: Setup, parameters: NDArray[np.float64]) -> Scene:
        key = string, parameters.tobytes()
        if self._scene is None or self._scene[0] != key:
            self._scene = key, scene_of(setup, parameters)
        return self._scene[1]


def scene_of(setup: Setup, parameters: NDArray[np.float64]) -> Scene:
    """Typed scene of one parameter string in a set-up."""
    return build_scene(setup.campaign.scene, parameters, setup.engine)


class SimulatorThread:
    """A thread that simulates batches in the order they come.

    `results` yields (results, failures) per batch; an exception of the thread itself arrives there
    too and is raised by `take`.
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

    def take(self, timeout: float) -> tuple[NDArray[np.void], list[NDArray[np.void]]] | None:
        """Next finished batch, waiting at most `timeout` in s; None if there is none."""
        try:
            item = self._results.get(timeout=timeout) if timeout else self._results.get_nowait()
        except queue.Empty:
            return None
        if isinstance(item, BaseException):
            raise item
        results, failures = item
        return results, failures

    def stop(self) -> None:
        """Abandon what is running and queued, and wait for the thread to end."""
        self._simulator.abort[0] = 1
        self._batches.put(None)
        self._thread.join()

    def _work(self) -> None:
        try:
            while (tasks := self._batches.get()) is not None:
                pairs = []
                for task in tasks:
                    pairs.append(self._simulator.simulate(task))
                    if self._simulator.abort[0]:
                        break
                else:
                    failures = [failure for _, failure in pairs if failure is not None]
                    self._results.put((np.concatenate([result for result, _ in pairs]), failures))
        except BaseException as error:
            self._results.put(error)
