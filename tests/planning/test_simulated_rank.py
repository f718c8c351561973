"""Imaginary ranks, against ones that live from moment to moment."""

import pytest
from examples import examples
from hypothesis import strategies as st

from agglom_mpi.planning.cluster_simulator import SimulatedRank, TaskInFlight

SECONDS = st.lists(st.integers(1, 6), min_size=1, max_size=3)
TASKS = st.lists(st.tuples(st.integers(0, 3), SECONDS), min_size=1, max_size=3)
BATCHES = st.lists(st.tuples(st.integers(0, 6), TASKS), min_size=1, max_size=4)


def in_flight(string, seconds):
    return TaskInFlight(string, 0, [*seconds], len(seconds))


def rank_with(batches):
    """Return a rank that is given batches, each so long after the one before."""
    rank, now = SimulatedRank(), 0.0
    for later, tasks in batches:
        now += later
        rank.put(now, [in_flight(*task) for task in tasks])
    return rank


def lived(batches, cancelled, at):
    """When each batch is done, and what each task took and how many samples, tick by tick."""
    ends, found, now, received = [], [], 0, 0
    for later, tasks in batches:
        received += later
        now = max(now, received)
        for string, seconds in tasks:
            begun, done = now, 0
            for most in seconds:
                took = 0
                while took < most and not (string == cancelled and now >= at):
                    took, now = took + 1, now + 1
                done += took == most
            found.append((now - begun, done))
        ends.append(now)
    return ends, found


@examples(300, BATCHES, st.integers(0, 3), st.integers(0, 30))
def test_a_rank_takes_the_time_of_what_it_need_not_leave_out(batches, cancelled, at):
    at = max(at, sum(later for later, _ in batches))  # when all have come
    rank = rank_with(batches)
    rank.cancel(float(at), [cancelled])
    ends, found = lived(batches, cancelled, at)
    taken = []
    for end in ends:
        assert rank.end == end
        taken += rank.take()
    assert [(sum(task.seconds), task.done) for task in taken] == found
    given_first = [task for _, tasks in batches for task in tasks]
    for task, (string, seconds) in zip(taken, given_first, strict=True):
        assert task.left_out == (task.done < len(seconds))
        assert not task.left_out or string == cancelled


def test_a_cancellation_does_not_touch_what_is_done_or_of_others():
    rank = rank_with([(0.0, [(1, [2.0]), (2, [2.0]), (1, [2.0])])])
    rank.cancel(3.0, [1])
    assert rank.end == 4.0
    done, other, withdrawn = rank.take()
    assert [done, other] == [in_flight(1, [2.0]), in_flight(2, [2.0])]
    assert withdrawn == TaskInFlight(1, 0, [0.0], 0, left_out=True)


def test_a_rank_that_had_nothing_to_do_begins_when_its_work_comes():
    rank = rank_with([(0.0, [(1, [1.0])]), (5.0, [(1, [1.0])])])
    assert rank.end == pytest.approx(1.0)
    rank.take()
    assert rank.end == pytest.approx(6.0)
