"""Code that every rank of a run executes first, to make a rare course of events the usual one."""

RANK = """
import os
rank = os.environ.get("PMI_RANK", os.environ.get("OMPI_COMM_WORLD_RANK", "0"))
"""

SENDS_WAIT_TO_BE_RECEIVED = """
import agglom_mpi.farm.launch as launch

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
import agglom_mpi.farm.crew as crew

dismiss = crew.Crew.dismiss

def late(self, *arguments):
    time.sleep(0.3)  # every worker has results by now, and waits for them to be received
    yield from dismiss(self, *arguments)

crew.Crew.dismiss = late
"""
