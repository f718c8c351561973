"""Nothing waits for the rest of a long message, and those of a rank are taken in order."""

from types import SimpleNamespace

import numpy as np
import pytest

from agglom_mpi.runtime.abort_flag import AbortFlag
from agglom_mpi.runtime.messages import PART, RESULT, RESULTS, WRITTEN, packed_results
from agglom_mpi.runtime.worker_pool import WorkerPool

MPI = pytest.importorskip("mpi4py.MPI", exc_type=ImportError)


class World:
    """Ranks whose messages are announced; those that are `on_the_way` are not whole yet."""

    size = 3

    def __init__(self):
        self.announced, self.on_the_way = [], set()

    def send(self, rank, tag, records):
        self.announced.append((rank, tag, records.view("u1")))
        return len(self.announced)

    def Iprobe(self, source, status):  # noqa: N802
        if self.announced:
            rank, tag, content = self.announced[0]
            status.Set_source(rank)
            status.Set_tag(tag)
            status.Set_elements(MPI.BYTE, len(content))
        return bool(self.announced)

    def Irecv(self, buffer, source, tag):  # noqa: N802
        rank, its_tag, content = self.announced.pop(0)
        assert (rank, its_tag) == (source, tag)
        buffer[0].view("u1")[:] = content
        return SimpleNamespace(Test=lambda: (rank, tag) not in self.on_the_way)


@pytest.fixture
def pool():
    flag = AbortFlag(None)
    sizes = SimpleNamespace(grains=3, spins=False)
    runner = SimpleNamespace(rank=0, sizes=sizes, result_dtype=RESULT, abort_flag=flag)
    pool = WorkerPool(runner, World(), heart_thread=False)
    yield pool
    pool._thread.stop()


def numbers(pool):
    """Return rank and content of the messages that a poll finds."""
    return [
        (message.rank, message.results["sample"].tolist() or message.written)
        for message in pool.poll()
    ]


def results(*samples):
    rows = np.zeros(len(samples), RESULT)
    rows["sample"] = samples
    return packed_results(np.zeros(1, PART), rows)


def test_a_message_that_is_not_whole_is_taken_later_and_in_its_turn(pool):
    world = pool._world
    world.on_the_way.add((1, RESULTS))
    world.send(1, RESULTS, results(4, 5))
    world.send(2, RESULTS, results(7))
    world.send(1, WRITTEN, np.array([2]))
    assert numbers(pool) == [(2, [7])]
    assert numbers(pool) == []
    world.on_the_way.clear()
    assert numbers(pool) == [(1, [4, 5]), (1, 2)]
    assert numbers(pool) == []
