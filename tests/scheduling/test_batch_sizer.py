"""How many samples a message has, and how many messages a rank."""

from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.estimators import (
    BUSY_SHARE,
    QUEUE_PROBABILITY,
    SECOND_BATCH_SHARE,
    BatchSizer,
)
from agglom_mpi.scheduling.interface import MOST_SAMPLES

SECONDS = st.floats(1e-9, 1e3)
BATCHES = st.integers(1, 1024)


def sizer_of(seconds, round_trip):
    sizer = BatchSizer()
    sizer.round_trip = round_trip
    sizer.learn([seconds])
    return sizer


@examples(100, SECONDS, BATCHES)
def test_who_gets_more_at_once_queues_nothing_that_is_not_sure(seconds, batch):
    sizer = sizer_of(seconds, 0.0)
    assert (sizer.batches_per_rank(batch), sizer.queue_probability(batch)) == (1, 1.0)


@examples(100, SECONDS, BATCHES, st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2))
def test_the_longer_messages_take_the_more_is_queued(seconds, batch, round_trips):
    sooner, later = (sizer_of(seconds, round_trip) for round_trip in sorted(round_trips))
    assert sooner.batches_per_rank(batch) <= later.batches_per_rank(batch)
    assert sooner.queue_probability(batch) >= later.queue_probability(batch) >= QUEUE_PROBABILITY


def test_a_second_batch_is_held_where_a_round_trip_is_a_larger_part_of_one():
    round_trip = 1e-3
    assert sizer_of(1.001 * round_trip / SECOND_BATCH_SHARE, round_trip).batches_per_rank(1) == 1
    assert sizer_of(0.999 * round_trip / SECOND_BATCH_SHARE, round_trip).batches_per_rank(1) == 2


def costly_sizer(seconds, cost):
    """A sizer that has learnt the time of a sample, and the cost of a message."""
    sizer = sizer_of(seconds, 0.0)
    sizer.learn_cost(cost, 1, 1)
    return sizer


@examples(100, SECONDS, st.integers(1, 10_000), st.floats(1.0, 1e6), st.floats(1.0, 1e9))
def test_messages_that_cost_nothing_are_as_long_as_their_work(seconds, ranks, limit, waiting):
    sizer = costly_sizer(seconds, 0.0)
    assert sizer.batch_size(limit, ranks, waiting) == sizer_of(seconds, 0.0).batch_size(limit)


@examples(100, SECONDS, st.floats(0.0, 1e-2), st.integers(1, 10_000), st.floats(1.0, 1e6))
def test_rank_0_has_half_of_its_time_left_or_messages_have_no_room(seconds, cost, ranks, limit):
    size = costly_sizer(seconds, cost).batch_size(limit, ranks)
    assert (size + 1) * seconds >= ranks * cost / BUSY_SHARE or size == MOST_SAMPLES


@examples(100, SECONDS, st.floats(1e-6, 1e-2), st.integers(1, 10_000), st.floats(1.0, 1e9))
def test_a_message_takes_no_longer_than_rank_0_for_all_that_wait(seconds, cost, ranks, waiting):
    size = costly_sizer(seconds, cost).batch_size(1.0, ranks, waiting)
    assert size == 1 or size * seconds <= waiting / size * cost * (1.0 + 1e-9)


@examples(100, SECONDS, st.floats(0.0, 1e-2), st.integers(1, 10_000), st.floats(1.0, 1e6))
def test_costly_messages_are_never_shorter_than_cheap_ones(seconds, cost, ranks, limit):
    cheap, costly = (costly_sizer(seconds, each) for each in (cost, 2.0 * cost))
    assert cheap.batch_size(limit, ranks) <= costly.batch_size(limit, ranks)


def test_with_few_ranks_the_cost_of_a_message_changes_nothing():
    for ranks in (1, 2, 8):
        assert costly_sizer(1e-3, 50e-6).batch_size(1.0, ranks) == 1


def test_what_a_message_costs_is_a_mean_that_one_burst_does_not_spoil():
    sizer = costly_sizer(1e-3, 1e-4)
    sizer.learn_cost(0.0, 0, 0)
    assert sizer.message_seconds == 1e-4
    sizer.learn_cost(10.0, 1, 1)
    assert sizer.message_seconds <= 1.2e-4
    for _ in range(200):
        sizer.learn_cost(6e-4, 2, 100)
    assert abs(sizer.message_seconds / 3e-4 - 1.0) < 1e-3
