"""Imaginary ranks, against ones that live from moment to moment."""

import pytest
from examples import examples
from hypothesis import strategies as st

from agglom_mpi.planning.cluster_simulator import SampleInFlight, SimulatedRank

TICKS = st.integers(0, 6)
SAMPLES = st.lists(
    st.builds(SampleInFlight, st.integers(0, 3), TICKS, st.just(True), begin=st.just(0.0)),
    min_size=1,
    max_size=4,
)
BATCHES = st.lists(st.tuples(TICKS, SAMPLES), min_size=1, max_size=4)


def rank_with(batches):
    """Return a rank that is given batches, each so long after the one before."""
    rank, now = SimulatedRank(), 0.0
    for later, samples in batches:
        now += later
        rank.put(now, list(samples))
    return rank


def lived(batches, cancelled, at):
    """When each batch is done, and what each sample took, tick by tick."""
    ends, spent, now, received = [], [], 0, 0
    for later, samples in batches:
        received += later
        now = max(now, received)
        for string, seconds, *_ in samples:
            took = 0
            while took < seconds and not (string == cancelled and now >= at):
                took, now = took + 1, now + 1
            spent.append(took)
        ends.append(now)
    return ends, spent


@examples(300, BATCHES, st.integers(0, 3), st.integers(0, 30))
def test_a_rank_takes_the_time_of_what_it_need_not_leave_out(batches, cancelled, at):
    at = max(at, sum(later for later, _ in batches))  # when all have come
    rank = rank_with(batches)
    rank.cancel(float(at), [cancelled])
    ends, spent = lived(batches, cancelled, at)
    taken = []
    for end in ends:
        assert rank.end == end
        taken += rank.take()
    assert [sample.seconds for sample in taken] == spent
    given_first = [sample for _, samples in batches for sample in samples]
    for sample, before, seconds in zip(taken, given_first, spent, strict=True):
        assert sample.needed == (seconds == before.seconds) or before.seconds == 0
        assert sample.needed or sample.string == cancelled


def test_a_cancellation_does_not_touch_what_is_done_or_of_others():
    rank = rank_with(
        [(0.0, [SampleInFlight(1, 2.0), SampleInFlight(2, 2.0), SampleInFlight(1, 2.0)])]
    )
    rank.cancel(3.0, [1])
    assert rank.end == 4.0
    assert rank.take() == [
        SampleInFlight(1, 2.0),
        SampleInFlight(2, 2.0),
        SampleInFlight(1, 0.0, False),
    ]


def test_a_rank_that_had_nothing_to_do_begins_when_its_work_comes():
    rank = rank_with([(0.0, [SampleInFlight(1, 1.0)]), (5.0, [SampleInFlight(1, 1.0)])])
    assert rank.end == pytest.approx(1.0)
    rank.take()
    assert rank.end == pytest.approx(6.0)
