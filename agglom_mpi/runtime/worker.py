"""The loop of every rank but rank 0: simulate what rank 0 sends until it sends a stop."""

import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.errors import error_text
from agglom_mpi.runtime.abort_flag import SampleClock, SampleUnderWay
from agglom_mpi.runtime.launch import Nodes
from agglom_mpi.runtime.messages import (
    ALIVE,
    CANCEL,
    FINALS,
    GOODBYE,
    HEARTBEAT,
    STOP,
    SYNC,
    TASKS,
    UNWRITTEN,
    WRITTEN,
    PendingSends,
    RankMessage,
    failed_sample,
    heartbeat,
    storable,
)
from agglom_mpi.runtime.silence import ALIVE_EVERY, may_call_in_turn, pace
from agglom_mpi.runtime.simulation_thread import SimulationThread
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.wakeup import PollBackoff, Wakeup, message_waits
from agglom_mpi.runtime.watches import CoordinatorWatch, patience
from agglom_mpi.scheduling.interface import MOST_SAMPLES, task_type
from agglom_mpi.storage.row_buffer import RankWriter

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


def serve_coordinator(
    world: "Intracomm",
    runner: SampleRunner,
    file: RankWriter | None,
    nodes: Nodes = Nodes(1, False),  # noqa: B008  (it is a constant)
    stop: StopRequest | None = None,
) -> int:
    """Serve rank 0 until it sends a stop; return the exit code that comes with it.

    Parameters
    ----------
    world
        The MPI world.
    runner
        Of this rank.
    file
        The campaign file, where this rank writes its samples itself; None if rank 0 does.
    nodes
        Place of this rank.
    stop
        Requested when the launcher of this rank is gone.

    Raises
    ------
    OSError
        If the file cannot be written; rank 0 has had a report.
    """
    beats = file is None and may_call_in_turn()
    times = patience(same_host=nodes.has_rank_zero, beats=beats)
    watch = CoordinatorWatch(world.rank, times, speaks=nodes.speaks)
    worker = Worker(world, runner, file, watch, stop or StopRequest())
    try:
        worker.send_heartbeat()  # before anything else, so that rank 0 can name this host
        while worker.exit_code is None:
            worker.serve()
    except OSError as error:
        worker.report_write_error(error)
        raise
    finally:
        watch.stop()
        if file is not None:
            file.before_write = lambda: None  # rank 0 receives nothing any more
    return worker.exit_code


class Worker:
    """Messages from and to rank 0, and the thread that simulates.

    Attributes
    ----------
    exit_code
        As rank 0 has sent it with its stop; None before.
    """

    def __init__(
        self,
        world: "Intracomm",
        runner: SampleRunner,
        file: RankWriter | None,
        watch: CoordinatorWatch,
        stop: StopRequest,
    ) -> None:
        from mpi4py import MPI

        self.exit_code: int | None = None
        self._world = world
        self._file = file
        self._reported = 0  # samples that rank 0 knows to be written
        self._wakeup = Wakeup()
        self._coordinator = b""  # the name that rank 0 is woken by, if it is on this host
        self._thread = SimulationThread(runner, self._wakeup)
        self._byte, self._status = MPI.BYTE, MPI.Status()
        self._backoff = PollBackoff()
        self._alive_every = pace(world.size) * ALIVE_EVERY
        self._sample_clock = SampleClock(runner.abort_flag)
        self._watch = watch
        self._stop_request, self._alone = stop, False
        if file is not None:
            file.before_write = self._announce_write
        self._sends = PendingSends()
        self._last_sent = time.monotonic()
        self._tasks = np.zeros(MOST_SAMPLES, task_type(runner.experiment.variables.count))

    def serve(self) -> None:
        """Wait a moment, read all messages, and send what has been simulated."""
        self._watch.listen(True)
        self._sends.forget_sent()
        # What is on its way proceeds only in calls of MPI.
        woken = bool(self._coordinator) and not self._sends
        rung, found = self._wakeup.wait(self._backoff.timeout(woken)), False
        while message_waits(self._world, 0, self._status):
            found = True
            self._read(self._status.Get_tag())
            if self.exit_code is not None:
                return
        while (finished := self._thread.poll()) is not None:
            found = True
            self._report(finished)
        self._backoff.polled(found, rung)
        if self._file is not None:
            self._file.samples.flush_due()
            self._report_written(self._file)
        under_way = self._sample_clock.read()
        news = not self._alone and bool(self._stop_request.reason)
        self._alone |= news
        if news or time.monotonic() - self._last_sent >= self._alive_every:
            self.send_heartbeat(under_way)

    def send_heartbeat(
        self, under_way: SampleUnderWay | None = None, *, writes: bool = False
    ) -> None:
        """Send the names of this host and of its wake-up, and what this rank is doing."""
        self._send(heartbeat(self._wakeup.name, under_way, writes=writes, alone=self._alone), ALIVE)

    def report_write_error(self, error: OSError) -> None:
        """Report that this rank cannot write, and leave it to rank 0 to end the job."""
        self._send(failed_sample(-1, -1, self._world.rank, error_text(error)), UNWRITTEN)
        self._sends.wait()
        time.sleep(30.0)

    def _report(self, message: RankMessage) -> None:
        """Send what was simulated to rank 0, and write it where that is up to this rank."""
        for tag, records in message.records():
            if tag != FINALS or self._file is None:
                self._send(records, tag)
        if self._file is not None and len(message.results):
            # Only now: nothing is stored that rank 0 does not know.
            self._file.samples.put(storable(message.results), message.final_particles)

    def _announce_write(self) -> None:
        """Report that this rank writes now, which may take long: meanwhile it does nothing else."""
        self.send_heartbeat(writes=True)
        self._watch.listen(False)

    def _read(self, tag: int) -> None:
        self._watch.hear()
        if tag == TASKS:
            self._world.Recv([self._tasks, self._byte], source=0, tag=TASKS, status=self._status)
            count = self._status.Get_count(self._byte) // self._tasks.itemsize
            self._thread.put(self._tasks[:count].copy())
            return
        if tag == CANCEL:
            strings = np.empty(self._status.Get_count(self._byte) // 8, np.int64)
            self._world.Recv([strings, self._byte], source=0, tag=CANCEL)
            self._thread.cancel(strings.tolist())
            return
        if tag == ALIVE:
            record = np.empty(1, HEARTBEAT)
            self._world.Recv([record, self._byte], source=0, tag=ALIVE)
            self._coordinator = bytes(record["wakeup"][0]) or self._coordinator
            return
        code = np.zeros(1, np.int32)
        self._world.Recv(code, source=0, tag=tag)
        if tag == SYNC and self._file is not None:
            self._file.samples.flush()
            self._file.sync()
        elif tag == STOP:
            self._stop()
            self.exit_code = int(code[0])

    def _stop(self) -> None:
        self._thread.stop()
        while (finished := self._thread.poll()) is not None:
            self._report(finished)
        goodbye = np.zeros(1, GOODBYE)
        if self._file is not None:
            self._file.samples.flush()
            self._report_written(self._file)
            self._file.sync()
            goodbye["database_seconds"] = self._file.clock.seconds
        self._send(goodbye, STOP)
        self._sends.wait()

    def _report_written(self, file: RankWriter) -> None:
        if file.samples.written > self._reported:
            self._send(np.array([file.samples.written - self._reported]), WRITTEN)
            self._reported = file.samples.written

    def _send(self, records: NDArray[np.generic], tag: int) -> None:
        self._last_sent = time.monotonic()
        request = self._world.Isend([records, self._byte], dest=0, tag=tag)
        if self._coordinator and not self._wakeup.ring_at(self._coordinator):
            self._coordinator = b""
        self._sends.add(request, records)
