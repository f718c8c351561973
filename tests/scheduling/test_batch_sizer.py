"""How many samples a message has, and how many messages a rank."""

from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.estimators import LOSS, QUEUED, BatchSizer

SECONDS = st.floats(1e-9, 1e3)
BATCHES = st.integers(1, 1024)


def pace_of(seconds, turnround):
    pace = BatchSizer()
    pace.turnround = turnround
    pace.learn([seconds])
    return pace


@examples(100, SECONDS, BATCHES)
def test_who_gets_more_at_once_queues_nothing_that_is_not_sure(seconds, batch):
    pace = pace_of(seconds, 0.0)
    assert (pace.in_flight(batch), pace.queued(batch)) == (1, 1.0)


@examples(100, SECONDS, BATCHES, st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2))
def test_the_longer_messages_take_the_more_is_queued(seconds, batch, turnrounds):
    sooner, later = (pace_of(seconds, turnround) for turnround in sorted(turnrounds))
    assert sooner.in_flight(batch) <= later.in_flight(batch)
    assert sooner.queued(batch) >= later.queued(batch) >= QUEUED


def test_a_second_batch_is_held_where_a_turnround_is_a_larger_part_of_one():
    turnround = 1e-3
    assert pace_of(1.001 * turnround / LOSS, turnround).in_flight(1) == 1
    assert pace_of(0.999 * turnround / LOSS, turnround).in_flight(1) == 2
