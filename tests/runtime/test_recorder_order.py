"""Judgements wait for the samples that they rest on, and keep their order."""

import numpy as np
from examples import examples
from hypothesis import strategies as st

from agglom_mpi.runtime.messages import RESULT
from agglom_mpi.runtime.recorder import WriteOrderBarrier


def rows(count, first=0):
    """Samples `first`, `first` + 1, … of a string."""
    batch = np.zeros(count, RESULT)
    batch["sample"] = first + np.arange(count)
    return batch


def test_without_samples_of_other_ranks_nothing_waits():
    barrier, stored = WriteOrderBarrier(), []
    barrier.store(lambda: stored.append(1))
    assert stored == [1]


def test_a_record_waits_for_every_rank_that_it_rests_on():
    barrier, stored = WriteOrderBarrier(), []
    barrier.delivered(1, rows(3))
    barrier.delivered(2, rows(1))
    barrier.store(lambda: stored.append("result"))
    barrier.written(1, 2)
    barrier.written(2, 1)
    assert stored == []
    barrier.written(1, 1)
    assert stored == ["result"]


def test_what_came_later_is_not_waited_for():
    barrier, stored = WriteOrderBarrier(), []
    barrier.delivered(1, rows(3))
    barrier.store(lambda: stored.append("result"))
    barrier.delivered(1, rows(5))
    barrier.written(1, 3)
    assert stored == ["result"]


def test_rows_written_before_their_delivery_is_known_count():
    barrier, stored = WriteOrderBarrier(), []
    barrier.written(1, 4)
    barrier.delivered(1, rows(3))
    barrier.store(lambda: stored.append("result"))
    assert stored == ["result"]


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("delivered"), st.integers(1, 3), st.integers(1, 5)),
        st.tuples(st.just("written"), st.integers(1, 3), st.integers(1, 5)),
        st.tuples(st.just("take_over"), st.integers(1, 3), st.just(0)),
        st.tuples(st.just("store"), st.just(0), st.just(0)),
    ),
    max_size=60,
)


class Model:
    """What ranks and the file hold while steps are taken, and what must be true of it."""

    def __init__(self):
        self.barrier, self.stored, self.asked = WriteOrderBarrier(), [], 0
        self.delivered = dict.fromkeys((1, 2, 3), 0)
        self.written = dict.fromkeys((1, 2, 3), 0)
        self.in_file = {rank: set() for rank in (1, 2, 3)}

    def deliver(self, rank, count):
        first, self.delivered[rank] = self.delivered[rank], self.delivered[rank] + count
        self.barrier.delivered(rank, rows(count, first))

    def write(self, rank, count):
        """A rank writes what it delivered, in order, whoever has written that in its stead."""
        first = self.written[rank]
        self.written[rank] = min(first + count, self.delivered[rank])
        self.in_file[rank] |= set(range(first, self.written[rank]))
        self.barrier.written(rank, self.written[rank] - first)

    def take_over(self, rank):
        """All that a rank has not written must be among what is given back."""
        taken = [int(row["sample"]) for batch in self.barrier.take_over(rank) for row in batch]
        assert taken == sorted(set(taken))
        assert self.in_file[rank] | set(taken) == set(range(self.delivered[rank]))
        self.in_file[rank] |= set(taken)
        self.barrier.store_ready()
        assert self.barrier.take_over(rank) == [], "it waits for a rank that it has given up"

    def store(self):
        number, needed = self.asked, dict(self.delivered)
        self.asked += 1

        def action():
            assert all(set(range(needed[rank])) <= self.in_file[rank] for rank in needed)
            self.stored.append(number)

        self.barrier.store(action)


@examples(300, STEPS)
def test_records_are_stored_in_order_once_and_never_before_their_samples(steps):
    model = Model()
    for step, rank, count in steps:
        if step == "delivered":
            model.deliver(rank, count)
        elif step == "written":
            model.write(rank, count)
        elif step == "take_over":
            model.take_over(rank)
        else:
            model.store()
    for rank in (1, 2, 3):
        model.write(rank, model.delivered[rank])
    assert model.stored == list(range(model.asked))


def test_a_rank_that_is_not_heard_any_more_holds_nothing_back():
    barrier, stored = WriteOrderBarrier(), []
    barrier.delivered(1, rows(3))
    barrier.delivered(1, rows(2, first=3))
    barrier.store(lambda: stored.append("result"))
    barrier.written(1, 3)
    [batch] = barrier.take_over(1)
    assert batch["sample"].tolist() == [3, 4]
    assert stored == []
    barrier.store_ready()
    assert stored == ["result"]


def test_what_a_rank_that_is_back_writes_late_does_not_count_for_what_it_sends_next():
    barrier, stored = WriteOrderBarrier(), []
    barrier.delivered(1, rows(3))
    barrier.take_over(1)
    barrier.store_ready()
    barrier.delivered(1, rows(2, first=3))
    barrier.store(lambda: stored.append("result"))
    barrier.written(1, 3)
    assert stored == []
    barrier.written(1, 2)
    assert stored == ["result"]


class Batch:
    """So many samples, and how often anybody has counted those of any batch."""

    counted = 0

    def __init__(self, count):
        self._count = count

    def __len__(self):
        Batch.counted += 1
        return self._count


def test_batches_that_wait_are_not_counted_again_for_every_one_that_comes():
    barrier, many = WriteOrderBarrier(), 1000
    for _ in range(many):
        barrier.delivered(1, Batch(3))
    for _ in range(many):
        barrier.written(1, 3)
    assert barrier.take_over(1) == []
    assert Batch.counted < 10 * many


def test_at_the_end_all_that_waits_is_stored():
    barrier, stored = WriteOrderBarrier(), []
    barrier.delivered(1, rows(3))
    for number in range(3):
        barrier.store(lambda number=number: stored.append(number))
    barrier.finish()
    assert stored == [0, 1, 2]
