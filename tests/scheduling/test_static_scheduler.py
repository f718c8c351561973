"""Tasks that are known beforehand: each is done, whatever ranks do."""

import random
from collections import Counter, deque

import numpy as np
import pytest
from examples import examples
from hypothesis import strategies as st
from returned_parts import give_back

from agglom_mpi.scheduling.estimators import BATCH_SECONDS
from agglom_mpi.scheduling.in_flight import MESSAGES_IN_FLIGHT
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.scheduling.static_scheduler import StaticScheduler

PATIENCE = 30.0


def tasks(count):
    batch = np.zeros(count, task_type(10))
    batch["string"], batch["first"] = np.divmod(np.arange(count), 3)
    batch["count"], batch["frames"] = 1, 5
    batch["parameters"] = batch["string"][:, np.newaxis]
    return batch


def pairs(batch):
    return batch[["string", "first"]].tolist()


def test_tasks_are_handed_out_in_order_to_the_rank_with_the_fewest():
    scheduler = StaticScheduler(tasks(8), 2)
    handed = list(scheduler.assignments(0.0))
    assert [rank for rank, _ in handed] == [0, 1] * MESSAGES_IN_FLIGHT
    assert [task.tobytes() for _, task in handed] == [task.tobytes() for task in tasks(8)[:4]]
    scheduler.done(1)
    assert [(rank, pairs(task)) for rank, task in scheduler.assignments(0.0)] == [(1, [(1, 1)])]


def test_without_tasks_nobody_gets_any():
    assert list(StaticScheduler(tasks(0), 3).assignments(0.0)) == []


def test_tasks_of_a_silent_rank_are_given_to_others_unless_it_did_them():
    scheduler = StaticScheduler(tasks(3), 2)
    assert [rank for rank, _ in scheduler.assignments(0.0)] == [0, 1, 0]
    scheduler.done(1)
    scheduler.in_flight.heartbeat(1, 50.0)
    assert scheduler.mark_silent(50.0, PATIENCE) == [0]
    scheduler.done(0)
    again = [(rank, pairs(task)) for rank, task in scheduler.assignments(50.0)]
    assert again == [(1, [(0, 2)])]
    assert scheduler.in_flight.heartbeat(0, 51.0)
    assert not scheduler.in_flight.heartbeat(0, 52.0)


def many(strings, samples):
    batch = np.zeros(strings, task_type(10))
    batch["string"], batch["first"], batch["count"] = np.arange(strings), 30, samples
    return batch


def keys(batch):
    return [
        (int(task["string"]), sample)
        for task in batch
        for sample in range(task["first"], task["first"] + task["count"])
    ]


@pytest.mark.parametrize(("seconds", "size"), [(BATCH_SECONDS / 20.5, 20), (1e-9, 74)])
def test_a_batch_is_worth_a_message_and_no_more_than_a_share_of_what_waits(seconds, size):
    scheduler = StaticScheduler(many(4, 150), 2)
    assert [len(keys(batch)) for _, batch in scheduler.assignments(0.0)] == [1] * 4
    scheduler.batch_sizer.learn([seconds])
    give_back(scheduler, 0, 1)
    [(rank, batch), *_] = scheduler.assignments(0.0)
    assert (rank, len(keys(batch))) == (0, size)
    assert keys(batch) == [(0, 34 + sample) for sample in range(size)]


def test_long_samples_do_not_wait_in_the_queue_of_a_rank():
    scheduler = StaticScheduler(many(1, 9), 2)
    list(scheduler.assignments(0.0))
    scheduler.batch_sizer.learn([10.0])
    give_back(scheduler, 0, 2)
    [(rank, batch)] = scheduler.assignments(0.0)
    assert (rank, len(keys(batch))) == (0, 1)


def test_what_two_ranks_have_done_counts_once():
    scheduler = StaticScheduler(many(1, 4), 2)
    assert [rank for rank, _ in scheduler.assignments(0.0)] == [0, 1, 0, 1]
    scheduler.in_flight.heartbeat(1, 50.0)
    assert scheduler.mark_silent(50.0, PATIENCE) == [0]
    scheduler.batch_sizer.learn([0.1])
    give_back(scheduler, 1, 2)
    assert [keys(batch) for _, batch in scheduler.assignments(50.0)] == [[(0, 30)], [(0, 32)]]
    [(piece, first)] = give_back(scheduler, 1, 1)
    assert (piece[:3], first) == ((0, 30, 1), [slice(0, 1)])
    late = give_back(scheduler, 0, 2)
    assert [(piece.first, first) for piece, first in late] == [(30, []), (32, [slice(0, 1)])]
    [(piece, first)] = give_back(scheduler, 1, 1)
    assert (piece[:3], first) == ((0, 32, 1), [])


class World:
    """Ranks that do tasks, or die; the first one lives for ever."""

    def __init__(self, wanted, ranks, chance):
        self.scheduler, self.ranks, self.chance = StaticScheduler(wanted, ranks), ranks, chance
        self.held = [deque() for _ in range(ranks)]
        self.alive, self.now = set(range(ranks)), 0.0
        self.handed, self.lost, self.done = Counter(), Counter(), set()

    def working(self):
        return [rank for rank in sorted(self.alive) if self.held[rank]]

    def pass_time(self, seconds, share_heard):
        self.now += seconds
        for rank in sorted(self.alive):
            if self.chance.random() < share_heard:
                self.scheduler.in_flight.heartbeat(rank, self.now)
        for rank in self.scheduler.mark_silent(self.now, PATIENCE):
            self.lost.update(self.held[rank])

    def hand_out(self):
        for rank, batch in self.scheduler.assignments(self.now):
            [pair] = pairs(batch)
            self.held[rank].append(pair)
            self.handed[pair] += 1
            assert len(self.held[rank]) <= MESSAGES_IN_FLIGHT

    def give_back(self, rank):
        self.done.add(self.held[rank].popleft())
        self.scheduler.done(rank)
        self.scheduler.in_flight.heartbeat(rank, self.now)


@examples(150, st.integers(1, 6), st.integers(0, 30), st.integers(0, 2**32), st.floats(0.0, 0.5))
def test_every_task_is_done_while_one_rank_lives(ranks, count, seed, trouble):
    chance = random.Random(seed)
    wanted = tasks(count)
    world, idle = World(wanted, ranks, chance), 0
    while len(world.done) < count:
        if chance.random() < trouble:
            world.alive -= {chance.randrange(ranks)} - {0}
        waits = not world.working()
        world.pass_time(PATIENCE + 1.0 if waits else 5.0, 1.0 if waits else 0.7)
        world.hand_out()
        idle = 0 if world.working() else idle + 1
        # Each rank that is dead, and had nothing to do, may be given work once more.
        assert idle <= ranks, "nobody has anything to do"
        if not idle:
            world.give_back(chance.choice(world.working()))
    assert world.done == set(pairs(wanted))
    assert all(times <= 1 + world.lost[pair] for pair, times in world.handed.items())
