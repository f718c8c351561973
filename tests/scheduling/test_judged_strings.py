"""Ranks end the strings that they simulate: the same is decided, and hardly anything in vain."""

import random

import numpy as np
from examples import examples
from hypothesis import strategies as st
from scheduler_worlds import campaign, in_order, scheduler_of, simulated
from summary_rows import rows_of

from agglom_mpi.judge import take_samples
from agglom_mpi.scheduling.interface import ReturnedPart, means_of


class Ranks:
    """Ranks that do what they are given, in any order of their messages, until all is decided."""

    def __init__(self, ranks, chance, **options):
        self.inversion, self.decisions = campaign(**{"judged": True, **options})
        self.decisions.record(self.inversion.start())
        self.scheduler = scheduler_of(self.inversion, self.decisions, ranks)
        self.held = [[] for _ in range(ranks)]
        self.simulated = self.ranges = 0
        while not self.inversion.finished:
            for rank, tasks in self.scheduler.assignments(0.0):
                self.held[rank] += [self._done(task) for task in tasks]
            self._give_back(chance.choice([rank for rank, held in enumerate(self.held) if held]))

    def _done(self, task):
        string, first, count = (int(task[name]) for name in ("string", "first", "count"))
        parameters = self.inversion.parameters(string)
        rows = rows_of([simulated(string, parameters, first + i) for i in range(count)])
        size = count
        if task["judged"]:
            judge = self.inversion.judge(string, means_of(task), count)
            size = take_samples(
                judge, np.full(count, True), rows["mean_radius_ratio"], rows["particles"]
            )
        self.simulated += size
        self.ranges += 1
        return ReturnedPart(string, first, size, size < count), rows[:size]

    def _give_back(self, rank):
        part, rows = self.held[rank].pop(0)
        self.scheduler.batch_sizer.learn([1e-3] * part.size)
        assert self.scheduler.returned(rank, part) == [slice(0, part.size)]
        self.decisions.record(self.inversion.complete(part.string, part.first, rows))
        if part.left_out:
            assert self.inversion.progress(part.string) is None
        self.scheduler.update(part.string)


@examples(60, st.integers(1, 9), st.integers(0, 2**32))
def test_whoever_ends_a_string_the_same_is_decided(ranks, seed):
    assert Ranks(ranks, random.Random(seed)).decisions.everything() == in_order()


def used(world):
    return sum(result[3] for result in world.decisions.results.values())


def test_one_rank_simulates_what_is_used_and_begins_each_string_once():
    world = Ranks(1, random.Random(0), generations=20)
    assert world.simulated == used(world)
    assert world.ranges == len(world.decisions.results)


def test_few_ranks_simulate_less_in_vain_than_where_rank_0_alone_judges():
    judged, others = (
        Ranks(3, random.Random(0), population=30, max_samples=100, judged=judged)
        for judged in (True, False)
    )
    assert judged.simulated - used(judged) < 0.5 * (others.simulated - used(others))
    assert judged.ranges < 0.8 * others.ranges
