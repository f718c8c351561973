"""How many samples a message has, and how many messages a rank."""

from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.estimators import QUEUE_PROBABILITY, SECOND_BATCH_SHARE, BatchSizer

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
