"""A campaign whose samples take no time, through the real rank 0: what it takes for them.

    mpirun -n RANKS python instant_ranks.py CAMPAIGN.yaml SECONDS_OF_A_SAMPLE [asleep]

Every rank but 0 answers at once, with made-up results that follow from string and sample, and
states that each sample took so long: by that the scheduler sets the length of messages. The thread
of rank 0 that simulates sleeps. All else is the real program, from the message to the row in the
file. Prints samples, messages and the processor time of rank 0's main thread, as JSON. Runs with
earlier versions, too. `asleep` lets all ranks sleep for as long as they state, so that many have
room on a few cores.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.runtime.coordinator import Coordinator
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.messages import RESULT, RankMessage
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.worker import serve_coordinator
from agglom_mpi.runtime.worker_pool import WorkerPool
from agglom_mpi.storage.writer import CampaignWriter

try:
    from agglom_mpi.judge import EnsembleMeans, samples_needed
    from agglom_mpi.runtime.messages import PART
    from agglom_mpi.search.ensemble import judge_of
except ImportError:  # an earlier version, where rank 0 alone ends a string
    PART = None

RESULTS = 1 << 16


class Silent:
    """A listener that shows nothing."""

    def __getattr__(self, name):
        return lambda *arguments, **named: None


class InstantTask:
    """Samples that are there as soon as they are asked for."""

    def __init__(self, runner, task):
        self._runner, self._task = runner, task
        self._string, self._first, self._count = (
            int(task[name]) for name in ("string", "first", "count")
        )

    def simulate_next(self, *_):
        if self._runner.asleep:
            time.sleep(self._count * self._runner.seconds)
        elif not self._runner.rank:
            time.sleep(0.05)
        return False

    def cancel(self):
        pass

    def collect(self):
        samples = np.arange(self._first, self._first + self._count)
        rows = self._runner.made_up[(self._string * 7919 + samples * 104729) % RESULTS]
        rows["string"], rows["sample"], rows["rank"] = self._string, samples, self._runner.rank
        rows["objective"] = abs(rows["mean_radius_ratio"] / 2.0 - 1.0)
        if PART is None:
            self._runner.add_checksums(rows)
            return RankMessage(self._runner.rank, rows)
        if self._task["judged"]:
            campaign = self._runner.experiment.campaign
            particles, means = campaign.scene.particles, self._task["means"].item()
            rule = campaign.ensemble, campaign.objective, particles
            judge = judge_of(*rule, EnsembleMeans._make(means), self._count)
            numbers = rows["mean_radius_ratio"], rows["particles"]
            needed = samples_needed(judge, rows["state"] == 1, *numbers)
            rows = rows[:needed]
        self._runner.add_checksums(rows)
        part = np.zeros(1, PART)
        part["string"], part["first"], part["size"] = self._string, self._first, len(rows)
        part["left_out"] = len(rows) < self._count
        return RankMessage(self._runner.rank, rows, part)


class InstantRunner(SampleRunner):
    """Ranks that have all results already."""

    def __init__(self, experiment, rank, seconds):
        super().__init__(experiment, rank)
        self.seconds, self.asleep = seconds, "asleep" in sys.argv
        chance, rows = np.random.default_rng(1), np.zeros(RESULTS, RESULT)
        rows["state"] = 1
        rows["mean_radius_ratio"] = chance.normal(2.0, 0.1, RESULTS)
        rows["particles"] = chance.integers(10, 40, RESULTS)
        for name in {"seconds", "cpu_seconds"} & set(RESULT.names):
            rows[name] = seconds
        self.made_up = rows
        try:
            from agglom_mpi.storage.table import checksums
        except ImportError:  # an earlier version, whose rank 0 computes them
            self.add_checksums = lambda rows: None
        else:
            self.add_checksums = lambda rows: rows.__setitem__("crc", checksums(rows))

    def begin(self, task):
        return InstantTask(self, task)


class CountingPool(WorkerPool):
    """Counts messages with results, and ranges of tasks."""

    messages = samples = ranges = 0

    def send(self, rank, tasks):
        self.ranges += len(tasks)
        super().send(rank, tasks)

    def poll(self):
        for message in super().poll():
            self.messages += bool(len(message.results))
            self.samples += len(message.results)
            yield message


def serve(world, experiment, seconds, folder):
    path = Path(folder) / "instant.h5"
    file = prepare(path, experiment, False)
    with CampaignWriter(path) as writer:
        coordinator = Coordinator(experiment, file, writer, Silent())
        stop = StopRequest(None)
        coordinator.replay(*[stop] * (coordinator.replay.__code__.co_argcount - 1))
        coordinator._run_post_stage = lambda *_: None
        pool = CountingPool(InstantRunner(experiment, 0, seconds), world)
        while len(pool.hosts) < pool.size - 1:  # all have begun
            for _ in pool.poll():
                pass
        wall, begun = time.perf_counter(), time.thread_time()
        end = coordinator.run(pool, stop)
        spent, wall = time.thread_time() - begun, time.perf_counter() - wall
        coordinator.shut_down(pool, end)
    found = {"samples": pool.samples, "messages": pool.messages, "seconds": spent, "wall": wall}
    return found | {"ranges": pool.ranges}


def main():
    from mpi4py import MPI

    name, seconds, world = sys.argv[1], float(sys.argv[2]), MPI.COMM_WORLD
    experiment = InversionExperiment(load_campaign(name))
    if world.rank:
        serve_coordinator(world, InstantRunner(experiment, world.rank, seconds), None)
        return
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(serve(world, experiment, seconds, folder)))


if __name__ == "__main__":
    main()
