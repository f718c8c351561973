"""A rank that simulates what it is sent until it is told to stop."""

import time
from typing import TYPE_CHECKING

import numpy as np

from agglom_mpi.errors import error_text
from agglom_mpi.runtime.messages import (
    ALIVE,
    ALIVE_EVERY,
    FAILURE,
    FINALS,
    FRAMES,
    GOODBYE,
    HEARTBEAT,
    RESULT,
    RESULTS,
    STOP,
    SYNC,
    TASKS,
    UNWRITTEN,
    WITHDRAWN,
    WRITTEN,
    failed_sample,
    heartbeat,
    storable,
)
from agglom_mpi.runtime.sample_runner import Batch, SampleRunner
from agglom_mpi.runtime.simulation_thread import SimulationThread
from agglom_mpi.runtime.wakeup import PollBackoff, Wakeup, there_is_mail
from agglom_mpi.scheduling.interface import MOST_SAMPLES, TASK
from agglom_mpi.storage.sample_writer import RankWriter
from agglom_mpi.storage.table import concatenated

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


def serve_coordinator(world: "Intracomm", simulator: SampleRunner, file: RankWriter | None) -> int:
    """Serve rank 0 until it says stop; return the exit code that it sends.

    With a `file` this rank writes its samples itself.
    """
    worker = Worker(world, simulator, file)
    try:
        worker.say_alive()  # before anything else, so that rank 0 can name this machine
        while worker.code is None:
            worker.serve()
    except OSError as error:
        worker.complain(error)
        raise
    return worker.code


class Worker:
    """The two ends of a rank: messages from rank 0, and the thread that simulates."""

    def __init__(
        self, world: "Intracomm", simulator: SampleRunner, file: RankWriter | None
    ) -> None:
        from mpi4py import MPI

        self.code: int | None = None
        self._world = world
        self._file = file
        self._told = 0
        self._wakeup = Wakeup()
        self._master = b""  # how rank 0 is woken, if it is on this machine
        self._thread = SimulationThread(simulator, self._wakeup)
        self._byte, self._status = MPI.BYTE, MPI.Status()
        self._waiting = PollBackoff()
        self._presence = heartbeat(self._wakeup.name)
        self._spoken = time.monotonic()
        self._tasks = np.zeros(MOST_SAMPLES, TASK)

    def serve(self) -> None:
        """Wait a moment, read the mail, and pass on what has been simulated."""
        rung, found = self._wakeup.wait(self._waiting.at_most(bool(self._master))), False
        while there_is_mail(self._world, 0, self._status):
            found = True
            self._read(self._status.Get_tag())
            if self.code is not None:
                return
        while (finished := self._thread.take()) is not None:
            found = True
            self._pass_on(finished)
        self._waiting.looked(found, rung)
        if self._file is not None:
            self._file.samples.flush_due()
            self._tell_written(self._file)
        if time.monotonic() - self._spoken >= ALIVE_EVERY:
            self.say_alive()

    def say_alive(self) -> None:
        """Tell rank 0 that this rank is there, on which machine, and how it is woken."""
        self._send(self._presence, ALIVE)

    def complain(self, error: OSError) -> None:
        """Let rank 0 know that this rank cannot write, and leave it to end the job."""
        self._send(failed_sample(-1, -1, self._world.rank, error_text(error)), UNWRITTEN)
        time.sleep(30.0)

    def _pass_on(self, batch: Batch) -> None:
        """Write samples or send them, their particles before them, and report on them."""
        finals = concatenated(batch.finals, batch.finals[0].dtype) if batch.finals else None
        if finals is not None and self._file is None:
            self._send(finals, FINALS)
        for failure in batch.failures:
            self._send(failure, FAILURE)
        for frames in batch.frames:
            for picture in frames.reshape(-1, 1):  # one message each: they may be large
                self._send(picture, FRAMES)
        if batch.results:
            results = concatenated(batch.results, RESULT)
            self._send(results, RESULTS)
            if self._file is not None:  # after that: nothing is stored that rank 0 does not know
                self._file.samples.put(storable(results), finals)

    def _read(self, tag: int) -> None:
        if tag == TASKS:
            self._world.Recv([self._tasks, self._byte], source=0, tag=TASKS, status=self._status)
            count = self._status.Get_count(self._byte) // TASK.itemsize
            self._thread.put(self._tasks[:count].copy())
            return
        if tag == WITHDRAWN:
            strings = np.empty(self._status.Get_count(self._byte) // 8, np.int64)
            self._world.Recv([strings, self._byte], source=0, tag=WITHDRAWN)
            self._thread.withdraw(strings.tolist())
            return
        if tag == ALIVE:
            present = np.empty(1, HEARTBEAT)
            self._world.Recv([present, self._byte], source=0, tag=ALIVE)
            self._master = bytes(present["wakeup"][0])
            return
        code = np.zeros(1, np.int32)
        self._world.Recv(code, source=0, tag=tag)
        if tag == SYNC and self._file is not None:
            self._file.samples.flush()
            self._file.sync()
        elif tag == STOP:
            self._stop()
            self.code = int(code[0])

    def _stop(self) -> None:
        self._thread.stop()
        while (finished := self._thread.take()) is not None:
            self._pass_on(finished)
        farewell = np.zeros(1, GOODBYE)
        if self._file is not None:
            self._file.samples.flush()
            self._tell_written(self._file)
            self._file.sync()
            farewell["database_seconds"] = self._file.clock.seconds
        self._send(farewell, STOP)

    def _tell_written(self, file: RankWriter) -> None:
        if file.samples.written > self._told:
            self._send(np.array([file.samples.written - self._told]), WRITTEN)
            self._told = file.samples.written

    def _send(self, record: np.ndarray, tag: int) -> None:
        self._spoken = time.monotonic()
        request = self._world.Isend([record, self._byte], dest=0, tag=tag)
        if self._master and not self._wakeup.ring_at(self._master):
            self._master = b""
        request.Wait()
