"""Simulating batches of tasks in a thread, while the rank's main thread serves messages."""

import queue
import threading
import time
import traceback
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.campaign import Campaign
from agglom_mpi.farm.messages import RESULT, failed_sample
from agglom_mpi.search.objectives import make_objective
from agglom_mpi.simulation.outcome import COMPLETED, EXCEPTION, FAILED, OUTCOME
from agglom_mpi.simulation.sample import random_stream, simulate_scene
from agglom_mpi.simulation.scene import Scene, build_scene


class Simulator:
    """Turn tasks into results; the same on every rank, and what `campaign.simulate` does."""

    def __init__(self, campaign: Campaign, rank: int) -> None:
        self.abort = np.zeros(1, np.uint8)
        self._campaign = campaign
        self._objective = make_objective(campaign.objective, campaign.scene.particles)
        self._rank = rank
        self._scene: tuple[bytes, Scene] | None = None

    def warm_up(self, parameters: NDArray[np.float64]) -> None:
        """Compile, or load from the cache, all that a sample of this campaign needs."""
        scene = build_scene(self._campaign.scene, parameters)._replace(particles=2)
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
            random = random_stream(self._campaign.seed, parameters, int(task["sample"]))
            record, _ = simulate_scene(self._scene_of(parameters), random, self.abort)
            for name in OUTCOME.names or ():
                result[name] = record[name]
            if record["state"] == COMPLETED:
                result["objective"] = self._objective.of_sample(float(record["mean_radius_ratio"]))
        except Exception:
            result["state"], result["reason"] = FAILED, EXCEPTION
            failure = failed_sample(
                int(task["string"]), int(task["sample"]), self._rank, traceback.format_exc()
            )
        result["seconds"] = time.perf_counter() - begin
        return result, failure

    def _scene_of(self, parameters: NDArray[np.float64]) -> Scene:
        key = parameters.tobytes()
        if self._scene is None or self._scene[0] != key:
            self._scene = key, build_scene(self._campaign.scene, parameters)
        return self._scene[1]


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
