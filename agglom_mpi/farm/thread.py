"""A thread that simulates, while the rank's main thread serves messages."""

import queue
import threading
import time
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.bell import Bell
from agglom_mpi.farm.simulator import Batch, Simulator

HELD_BACK: Final = 0.1
"""Seconds after which finished samples do not wait for the next of their batch."""


class SimulatorThread:
    """Does batches of tasks in the order they come.

    What is finished does not wait for long for the rest of its batch. An exception of the thread
    itself is raised by `take`.

    Parameters
    ----------
    simulator
        Of this rank.
    bell
        Rung when something can be taken.
    """

    def __init__(self, simulator: Simulator, bell: Bell) -> None:
        self._simulator = simulator
        self._watch = simulator.watch
        self._batches: queue.SimpleQueue[NDArray[np.void] | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._bell = bell
        self._thread = threading.Thread(target=self._work, name="simulator", daemon=True)
        self._thread.start()

    def put(self, tasks: NDArray[np.void]) -> None:
        """Queue a batch."""
        self._batches.put(tasks)

    def take(self) -> Batch | None:
        """Next finished batch, None if there is none; ends a sample that takes too long."""
        self._watch.look()
        try:
            item = self._results.get_nowait()
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
        self._watch.stop()
        self._batches.put(None)
        self._thread.join()

    def _work(self) -> None:
        try:
            while (tasks := self._batches.get()) is not None:
                self._carry_out(tasks)
        except BaseException as error:
            self._give(error)

    def _carry_out(self, tasks: NDArray[np.void]) -> None:
        batch, begun = Batch([], [], [], []), time.monotonic()
        for task in tasks:
            job = self._simulator.begin(task)
            while job.go_on():
                if time.monotonic() - begun > HELD_BACK:
                    job.take(batch)
                    self._give(batch)
                    batch, begun = Batch([], [], [], []), time.monotonic()
            job.take(batch)
            if self._watch.stopped:
                break
        if any(batch):
            self._give(batch)

    def _give(self, item: Batch | BaseException) -> None:
        self._results.put(item)
        self._bell.ring()
