"""Judgements wait for the samples that they rest on, and keep their order."""

from hypothesis import given, settings
from hypothesis import strategies as st

from agglom_mpi.farm.backlog import Backlog


def test_without_samples_of_other_ranks_nothing_waits():
    backlog, stored = Backlog(), []
    backlog.store(lambda: stored.append(1))
    assert stored == [1]


def test_a_record_waits_for_every_rank_that_it_rests_on():
    backlog, stored = Backlog(), []
    backlog.delivered(1, 3)
    backlog.delivered(2, 1)
    backlog.store(lambda: stored.append("result"))
    backlog.written(1, 2)
    backlog.written(2, 1)
    assert stored == []
    backlog.written(1, 1)
    assert stored == ["result"]


def test_what_came_later_is_not_waited_for():
    backlog, stored = Backlog(), []
    backlog.delivered(1, 3)
    backlog.store(lambda: stored.append("result"))
    backlog.delivered(1, 5)
    backlog.written(1, 3)
    assert stored == ["result"]


def test_rows_written_before_their_delivery_is_known_count():
    backlog, stored = Backlog(), []
    backlog.written(1, 4)
    backlog.delivered(1, 3)
    backlog.store(lambda: stored.append("result"))
    assert stored == ["result"]


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("delivered"), st.integers(1, 3), st.integers(1, 5)),
        st.tuples(st.just("written"), st.integers(1, 3), st.integers(1, 5)),
        st.tuples(st.just("store"), st.just(0), st.just(0)),
    ),
    max_size=60,
)


@given(STEPS)
@settings(derandomize=True, deadline=None, max_examples=300)
def test_records_are_stored_in_order_once_and_never_before_their_samples(steps):
    backlog, stored, asked = Backlog(), [], 0
    delivered, written = dict.fromkeys((1, 2, 3), 0), dict.fromkeys((1, 2, 3), 0)

    def store(number, needed):
        assert all(written[rank] >= count for rank, count in needed.items())
        stored.append(number)

    for step, rank, count in steps:
        if step == "delivered":
            delivered[rank] += count
            backlog.delivered(rank, count)
        elif step == "written":
            count = min(count, delivered[rank] - written[rank])
            written[rank] += count
            backlog.written(rank, count)
        else:
            backlog.store(lambda number=asked, needed=dict(delivered): store(number, needed))
            asked += 1
    for rank in (1, 2, 3):
        late = delivered[rank] - written[rank]
        written[rank] += late
        backlog.written(rank, late)
    assert stored == list(range(asked))


def test_at_the_end_all_that_waits_is_stored():
    backlog, stored = Backlog(), []
    backlog.delivered(1, 3)
    for number in range(3):
        backlog.store(lambda number=number: stored.append(number))
    backlog.finish()
    assert stored == [0, 1, 2]
