"""A rank that simulates what it is sent until it is told to stop."""

from typing import TYPE_CHECKING

import numpy as np

from agglom_mpi.farm.messages import FAILURE, MOST_TASKS, POLL, RESULTS, STOP, TASK, TASKS
from agglom_mpi.farm.simulator import Simulator, SimulatorThread

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


def work(world: "Intracomm", simulator: Simulator) -> int:
    """Serve rank 0 until it says stop; return the exit code that it sends."""
    from mpi4py import MPI

    thread = SimulatorThread(simulator)
    status = MPI.Status()
    tasks = np.zeros(MOST_TASKS, TASK)
    while True:
        while world.Iprobe(source=0, tag=MPI.ANY_TAG, status=status):
            if status.Get_tag() == STOP:
                code = np.zeros(1, np.int32)
                world.Recv(code, source=0, tag=STOP)
                thread.stop()
                world.Send([code, MPI.BYTE], dest=0, tag=STOP)
                return int(code[0])
            world.Recv([tasks, MPI.BYTE], source=0, tag=TASKS, status=status)
            thread.put(tasks[: status.Get_count(MPI.BYTE) // TASK.itemsize].copy())
        finished = thread.take(POLL)
        if finished is not None:
            results, failures = finished
            for failure in failures:
                world.Send([failure, MPI.BYTE], dest=0, tag=FAILURE)
            world.Send([results, MPI.BYTE], dest=0, tag=RESULTS)
