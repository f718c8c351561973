"""How many samples a message has, and how many messages a rank."""

import random

import pytest
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


def test_one_burst_does_not_make_messages_dear():
    sizer = costly_sizer(1e-3, 1e-4)
    for _ in range(100):
        sizer.learn_cost(1e-4, 1, 1)
    sizer.learn_cost(10.0, 1, 1)
    assert sizer.message_seconds <= 1.05e-4


def test_nothing_is_learnt_from_no_message_and_much_after_one_that_cost_nothing():
    sizer = costly_sizer(1e-3, 0.0)
    sizer.learn_cost(1.0, 0, 0)
    assert sizer.message_seconds == 0.0
    sizer.learn_cost(3e-4, 3, 3)
    assert sizer.message_seconds > 0.0


@examples(50, st.floats(1e-5, 1e-3), st.floats(0.0, 1e-4), st.integers(0, 1000))
def test_costs_of_messages_and_samples_are_told_apart_by_messages_of_other_lengths(
    message, sample, seed
):
    chance, sizer = random.Random(seed), costly_sizer(1e-3, message + sample)
    for _ in range(2000):
        messages, length = chance.randint(1, 5), chance.randint(1, 100)
        cost = messages * (message + length * sample)
        sizer.learn_cost(cost, messages, messages * length)
    spent = message + 50 * sample
    assert abs(sizer.message_seconds - message) < 0.1 * spent


def test_messages_of_one_length_count_with_all_of_their_cost():
    sizer = costly_sizer(1e-3, 1e-4)
    for _ in range(100):
        sizer.learn_cost(1e-4, 1, 1)
    assert sizer.message_seconds == pytest.approx(1e-4)


def test_samples_that_cost_too_much_by_themselves_do_not_make_messages_long():
    sizer = sizer_of(4e-4, 0.0)
    for length in [1, 40] * 1000:
        sizer.learn_cost(50e-6 + length * 40e-6, 1, length)
    assert sizer.batch_size(1.0, 100, 1e4) < 20


@examples(100, SECONDS, st.floats(0.0, 1e-2), st.integers(1, 10_000), st.integers(1, 1000))
def test_rank_0_counts_as_one_rank_while_it_keeps_up_and_as_all_that_wait(
    seconds, cost, ranks, size
):
    weight = costly_sizer(seconds, cost).range_weight(ranks, size)
    assert 1.0 <= weight <= ranks
    if 2.0 * ranks * cost < BUSY_SHARE * size * seconds:
        assert weight <= 1.0 + 0.5 * ranks
    if ranks * cost > size * seconds:
        assert weight == ranks


def test_where_messages_cost_nothing_rank_0_counts_as_one_rank():
    assert sizer_of(1e-3, 0.0).range_weight(100, 10) == 1.0
    assert BatchSizer().range_weight(100, 10) == 1.0
