"""A thread that simulates, while the rank's main thread serves messages."""

import queue
import threading
import time
from collections.abc import Collection
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.messages import RankMessage, merged
from agglom_mpi.runtime.task_runner import SampleRunner, Task
from agglom_mpi.runtime.wakeup import Wakeup

MAX_DELAY: Final = 0.1
"""Seconds after which finished samples do not wait for the next of their batch."""

MAX_WAIT: Final = 10.0
"""Seconds after which a thread that was told to stop is not waited for; kernels end at once."""


class SimulationThread:
    """Simulates batches of tasks in the order in which they come.

    What is finished waits at most `MAX_DELAY` for the rest of its batch. An exception of the
    thread itself is raised by `poll`.

    Parameters
    ----------
    runner
        Of this rank.
    wakeup
        Rung when `poll` has something to return.

    Attributes
    ----------
    cancelled
        Strings whose samples are left out, each with the last batch for which that holds.
    """

    def __init__(self, runner: SampleRunner, wakeup: Wakeup) -> None:
        self._runner = runner
        self._abort_flag = runner.abort_flag
        self._batches: queue.SimpleQueue[tuple[int, NDArray[np.void]] | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[RankMessage | BaseException] = queue.SimpleQueue()
        self._wakeup = wakeup
        self._queued = 0
        self._under_way = 0, -1  # batch and string
        self.cancelled: dict[int, int] = {}
        self._thread = threading.Thread(target=self._work, name="simulator", daemon=True)
        self._thread.start()

    def put(self, tasks: NDArray[np.void]) -> None:
        """Queue a batch, (n,) of `scheduling.interface.task_type`."""
        self._queued += 1
        self._batches.put((self._queued, tasks))

    def cancel(self, strings: Collection[int]) -> None:
        """Leave out what is under way or queued of some strings; what is queued later is done.

        Their samples come back as `NOT_NEEDED`, each in its turn.
        """
        first = self._under_way[0]
        known = {string: last for string, last in self.cancelled.items() if last >= first}
        self.cancelled = known | dict.fromkeys(strings, self._queued)
        if self._under_way[1] in strings:
            self._abort_flag.interrupt()

    def poll(self) -> RankMessage | None:
        """Return what was finished next, or None; also end a sample that takes too long."""
        self._abort_flag.check_time()
        try:
            item = self._results.get_nowait()
        except queue.Empty:
            return None
        if isinstance(item, Exception):
            raise item
        if isinstance(item, BaseException):  # only the main thread is interrupted, or may exit
            raise RuntimeError(f"the simulating thread ended with {type(item).__name__}") from item
        return item

    def stop(self) -> None:
        """Abandon what is under way and queued, and wait for the thread to end.

        `poll` still returns what was finished. A user's function that does not come back is not
        waited for longer than `MAX_WAIT`.
        """
        self._abort_flag.stop()
        self._batches.put(None)
        self._thread.join(MAX_WAIT)

    def _work(self) -> None:
        try:
            while (queued := self._batches.get()) is not None:
                self._run_batch(*queued)
        except BaseException as error:
            self._give(error)

    def _run_batch(self, number: int, tasks: NDArray[np.void]) -> None:
        finished: list[RankMessage] = []
        begun = time.monotonic()
        for record in tasks:
            task = self._runner.begin(record)
            self._under_way = number, int(record["string"])
            while self._simulate_next(task, max(0.0, begun + MAX_DELAY - time.monotonic())):
                if time.monotonic() - begun > MAX_DELAY:
                    self._hand_over([*finished, task.collect()])
                    finished, begun = [], time.monotonic()
            finished.append(task.collect())
            if self._abort_flag.stopped:
                break
        self._under_way = number, -1
        self._hand_over(finished)

    def _simulate_next(self, task: Task, seconds: float) -> bool:
        if self._abort_flag.stopped:  # what was abandoned before has no answer, so this has none
            return False
        number, string = self._under_way
        if self.cancelled.get(string, 0) >= number:
            task.cancel()
            return False
        return task.simulate_next(seconds)

    def _hand_over(self, finished: list[RankMessage]) -> None:
        message = merged(self._runner.rank, finished)
        if not message.empty:
            self._give(message)

    def _give(self, item: RankMessage | BaseException) -> None:
        self._results.put(item)
        self._wakeup.ring()
