"""Tasks that are known beforehand: each is done, whatever ranks do."""

import random
from collections import Counter, deque

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agglom_mpi.farm.errands import Errands
from agglom_mpi.farm.lanes import MESSAGES_IN_FLIGHT
from agglom_mpi.farm.messages import TASK

PATIENCE = 30.0


def tasks(count):
    batch = np.zeros(count, TASK)
    batch["string"], batch["first"] = np.divmod(np.arange(count), 3)
    batch["count"], batch["frames"], batch["parameters"] = 1, 5, np.arange(count)[:, np.newaxis]
    return batch


def pairs(batch):
    return batch[["string", "first"]].tolist()


def test_tasks_are_handed_out_in_order_to_the_rank_with_the_fewest():
    errands = Errands(tasks(8), 2)
    handed = list(errands.assignments(0.0))
    assert [rank for rank, _ in handed] == [0, 1] * MESSAGES_IN_FLIGHT
    assert [task.tobytes() for _, task in handed] == [task.tobytes() for task in tasks(8)[:6]]
    errands.done(1)
    assert [(rank, pairs(task)) for rank, task in errands.assignments(0.0)] == [(1, [(2, 0)])]


def test_without_tasks_nobody_gets_any():
    assert list(Errands(tasks(0), 3).assignments(0.0)) == []


def test_tasks_of_a_silent_rank_are_given_to_others_unless_it_did_them():
    errands = Errands(tasks(3), 2)
    assert [rank for rank, _ in errands.assignments(0.0)] == [0, 1, 0]
    errands.done(1)
    errands.heard(1, 50.0)
    assert errands.clock(50.0, PATIENCE) == [0]
    errands.done(0)
    again = [(rank, pairs(task)) for rank, task in errands.assignments(50.0)]
    assert again == [(1, [(0, 2)])]
    assert errands.heard(0, 51.0)
    assert not errands.heard(0, 52.0)


@given(st.integers(1, 6), st.integers(0, 30), st.integers(0, 2**32), st.floats(0.0, 0.5))
@settings(derandomize=True, deadline=None, max_examples=150)
def test_every_task_is_done_while_one_rank_lives(ranks, count, seed, trouble):
    chance = random.Random(seed)
    wanted = tasks(count)
    errands, held = Errands(wanted, ranks), [deque() for _ in range(ranks)]
    dead, done, now = set(), set(), 0.0
    handed, lost = Counter(), Counter()
    while len(done) < count:
        now += 10.0 * chance.random()
        if chance.random() < trouble:
            dead.add(chance.randrange(ranks))
            dead.discard(0)
        working = [rank for rank in range(ranks) if rank not in dead and held[rank]]
        if not working:
            now += PATIENCE + 1.0
        for rank in set(range(ranks)) - dead:
            if not working or chance.random() < 0.7:
                errands.heard(rank, now)
        for rank in errands.clock(now, PATIENCE):
            lost.update(held[rank])
        for rank, [task] in errands.assignments(now):
            held[rank].append((int(task["string"]), int(task["first"])))
            handed[held[rank][-1]] += 1
            assert len(held[rank]) <= MESSAGES_IN_FLIGHT
        working = working or [rank for rank in range(ranks) if rank not in dead and held[rank]]
        assert working, "nobody has anything to do"
        rank = chance.choice(working)
        done.add(held[rank].popleft())
        errands.done(rank)
        errands.heard(rank, now)
    assert done == set(pairs(wanted))
    assert all(handed[pair] <= 1 + lost[pair] for pair in handed)
