"""Code that every rank of a run executes first, to make a rare course of events the usual one."""

import pytest

RANK = """
import os
rank = os.environ.get("PMI_RANK", os.environ.get("OMPI_COMM_WORLD_RANK", "0"))
"""

SENDS_WAIT_TO_BE_RECEIVED = """
import agglom_mpi.runtime.launch as launch

connect = launch.connect

def synchronous():
    from mpi4py import MPI

    world = connect()

    class World(MPI.Intracomm):
        def Send(self, *arguments, **options):
            return self.Ssend(*arguments, **options)

        def Isend(self, *arguments, **options):
            return self.Issend(*arguments, **options)

    return World(world)

launch.connect = synchronous

import time
import agglom_mpi.runtime.worker_pool as pool

shut_down = pool.WorkerPool.shut_down

def late(self, *arguments):
    # Every worker sends something, and waits for it to be received.
    while not all(self._world.Iprobe(other) for other in range(1, self.size)):
        time.sleep(1e-3)
    yield from shut_down(self, *arguments)

pool.WorkerPool.shut_down = late
"""


def slow(*values):
    """Return a parameter set that runs with the slow tests; a quick one is beside it."""
    return pytest.param(*values, marks=pytest.mark.slow)


def of_ranks(*values, guard):
    """Return a parameter set of ranks for the slow tier and the other build."""
    return pytest.param(*values, marks=pytest.mark.ranks(guard=guard))
