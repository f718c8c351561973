"""Tasks that do nothing, through the real farm or through its peer; run under mpirun -n 2.

    noop_farm.py farm SAMPLES_IN_A_MESSAGE SECONDS | futures CHUNK TASKS | wait 0 SECONDS

Prints tasks per second; of `wait`, the share of a core that a rank without work takes.
"""

import sys
import time
from types import SimpleNamespace

import numpy as np
from mpi4py import MPI

from agglom_mpi.runtime.messages import rank_parts
from agglom_mpi.runtime.task_runner import SampleRunner, SampleTask
from agglom_mpi.runtime.worker import serve_coordinator as serve
from agglom_mpi.runtime.worker_pool import WorkerPool
from agglom_mpi.scheduling import estimators, interface
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.search.proposals import Progress

STRINGS, SAMPLES, NUMBERS = 20, 10**9, 10
NO_TIME = 1e-9
"""Time of a sample as the scheduler gets it, s; 0 would mean that it is not known."""


class Nothing(SampleTask):
    """Samples that take no time."""

    def _simulate(self, sample, seconds):
        """Leave all records empty."""
        self._done = self._count
        return False


class Idle(SampleRunner):
    """A simulator that has nothing to do."""

    def __init__(self, rank):
        sizes = SimpleNamespace(
            final_particles=False, grains=1, quantities={}, spins=False, census=None, frames=0
        )
        variables = SimpleNamespace(count=NUMBERS)
        super().__init__(
            SimpleNamespace(
                max_seconds=None, table_sizes=sizes, variables=variables, noted_beside=None
            ),
            rank,
        )

    def begin(self, task):
        return Nothing(self, task)


class Endless:
    """A campaign that needs any number of samples of each string."""

    generation = 0

    def __init__(self):
        self.done = dict.fromkeys(range(STRINGS), 0)

    @property
    def open_strings(self):
        return {string: self.progress(string) for string in self.done}

    def judged_from(self, string):
        return None

    def progress(self, string):
        return Progress(self.done[string], SAMPLES)

    def parameters(self, string):
        return np.zeros(NUMBERS)


def farm(most, seconds):
    estimators.MOST_SAMPLES = most
    world = MPI.COMM_WORLD
    if world.rank:
        interface.MOST_SAMPLES = max(most, interface.MOST_SAMPLES)
        serve(world, Idle(world.rank), None)
        return
    pool, needs, returned = WorkerPool(Idle(0), world), Endless(), [0, 0]
    plan = Scheduler(needs, lambda generations: (), world.size, used=[10**8] * 10)
    begin = time.perf_counter()
    while time.perf_counter() - begin < seconds:
        for rank, tasks in plan.assignments(time.monotonic()):
            if rank or world.size == 1:
                pool.send(rank, tasks)
        for message in pool.poll():
            rows = message.results
            plan.batch_sizer.learn([NO_TIME] * len(rows))
            for _, part, _ in rank_parts([message]):
                new = plan.returned(message.rank, part)
                needs.done[part.string] += sum(piece.stop - piece.start for piece in new)
                plan.update(part.string)
            returned[message.rank] += len(rows)
    print(sum(returned) / (time.perf_counter() - begin))
    for _ in pool.shut_down(0):
        pass


def nothing(number):
    return number


def futures(chunk, tasks):
    from mpi4py.futures import MPICommExecutor

    with MPICommExecutor(MPI.COMM_WORLD, root=0) as pool:
        if pool is not None:
            begin = time.perf_counter()
            for _ in pool.map(nothing, range(tasks), chunksize=chunk):
                pass
            print(tasks / (time.perf_counter() - begin))


def wait(_, seconds):
    world = MPI.COMM_WORLD
    if world.rank:
        begin, used = time.perf_counter(), time.process_time()
        serve(world, Idle(world.rank), None)
        print((time.process_time() - used) / (time.perf_counter() - begin))
        return
    pool, end = WorkerPool(Idle(0), world), time.perf_counter() + seconds
    while time.perf_counter() < end:
        for _ in pool.poll():
            pass
    for _ in pool.shut_down(0):
        pass


if __name__ == "__main__":
    kind, first, second = sys.argv[1:]
    {"farm": farm, "futures": futures, "wait": wait}[kind](int(first), int(second))
