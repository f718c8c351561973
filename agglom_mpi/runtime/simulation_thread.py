"""A thread that simulates, while the rank's main thread serves messages."""

import queue
import threading
import time
from collections.abc import Collection
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.sample_runner import Batch, SampleRunner, Task
from agglom_mpi.runtime.wakeup import Wakeup

HELD_BACK: Final = 0.1
"""Seconds after which finished samples do not wait for the next of their batch."""


class SimulationThread:
    """Does batches of tasks in the order they come.

    What is finished does not wait for long for the rest of its batch. An exception of the thread
    itself is raised by `take`.

    Parameters
    ----------
    simulator
        Of this rank.
    wakeup
        Rung when something can be taken.
    """

    def __init__(self, simulator: SampleRunner, wakeup: Wakeup) -> None:
        self._simulator = simulator
        self._watch = simulator.watch
        self._batches: queue.SimpleQueue[tuple[int, NDArray[np.void]] | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._wakeup = wakeup
        self._queued = 0
        self._under_way = 0, -1  # batch and string
        self._withdrawn: dict[int, int] = {}  # strings, each with the last batch that counts
        self._thread = threading.Thread(target=self._work, name="simulator", daemon=True)
        self._thread.start()

    def put(self, tasks: NDArray[np.void]) -> None:
        """Queue a batch."""
        self._queued += 1
        self._batches.put((self._queued, tasks))

    def withdraw(self, strings: Collection[int]) -> None:
        """Leave out what is under way or queued of some strings; what is queued later is done.

        Their samples come back as `NOT_NEEDED`, each in its turn.
        """
        first = self._under_way[0]
        known = {string: last for string, last in self._withdrawn.items() if last >= first}
        self._withdrawn = known | dict.fromkeys(strings, self._queued)
        if self._under_way[1] in strings:
            self._watch.interrupt()

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
            while (queued := self._batches.get()) is not None:
                self._carry_out(*queued)
        except BaseException as error:
            self._give(error)

    def _carry_out(self, number: int, tasks: NDArray[np.void]) -> None:
        batch, begun = Batch([], [], [], []), time.monotonic()
        for task in tasks:
            job = self._simulator.begin(task)
            self._under_way = number, int(task["string"])
            while self._goes_on(job):
                if time.monotonic() - begun > HELD_BACK:
                    job.take(batch)
                    self._hand_over(batch)
                    batch, begun = Batch([], [], [], []), time.monotonic()
            job.take(batch)
            if self._watch.stopped:
                break
        self._under_way = number, -1
        self._hand_over(batch)

    def _goes_on(self, job: Task) -> bool:
        if self._watch.stopped:  # what was abandoned before has no answer, so this has none
            return False
        number, string = self._under_way
        if self._withdrawn.get(string, 0) >= number:
            job.give_up()
            return False
        return job.go_on()

    def _hand_over(self, batch: Batch) -> None:
        if any(batch):
            self._give(batch)

    def _give(self, item: Batch | BaseException) -> None:
        self._results.put(item)
        self._wakeup.ring()
