"""What ranks hold, against a plain list of samples for each rank."""

import pytest
from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.in_flight import MESSAGES_IN_FLIGHT, InFlightTable, SampleRange
from agglom_mpi.scheduling.interface import ReturnedPart

RANKS = 3
PIECES = st.lists(
    st.builds(SampleRange, st.integers(0, 5), st.integers(0, 5), st.integers(1, 4)),
    min_size=1,
    max_size=3,
)
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("give"), PIECES),
        st.tuples(st.just("return"), st.tuples(st.integers(0, RANKS - 1), st.integers(0, 12))),
        st.tuples(st.just("hear"), st.integers(0, RANKS - 1)),
        st.tuples(st.just("listen"), st.floats(0.0, 5.0)),
        st.tuples(st.just("settle"), st.integers(0, 5)),
    ),
    max_size=50,
)


def samples_of(pieces):
    return [
        (piece.string, sample)
        for piece in pieces
        for sample in range(piece.first, piece.first + piece.size)
    ]


class Model:
    """The same as `InFlightTable`, slow and simple."""

    def __init__(self):
        self.table = InFlightTable(RANKS)
        self.batches = [[] for _ in range(RANKS)]
        self.heard = [0.0] * RANKS
        self.silent = set()
        self.settled = set()
        self.now = 0.0

    def give(self, pieces):
        pieces = [piece for piece in pieces if piece.string not in self.settled]
        if not pieces:
            return
        holding = {rank: len(self.batches[rank]) for rank in set(range(RANKS)) - self.silent}
        fewest = min(holding.values(), default=MESSAGES_IN_FLIGHT)
        if fewest == MESSAGES_IN_FLIGHT:
            return
        rank = self.table.next_rank(fewest)
        assert holding[rank] == fewest
        if not self.batches[rank]:
            self.heard[rank] = self.now
        self.table.assign(rank, pieces, self.now)
        self.batches[rank].append(samples_of(pieces))

    def take_back(self, rank, count):
        batches = self.batches[rank]
        held = next(self.table.ranges(rank), None)
        if held is None:
            return
        left_out = count > held.size
        part = ReturnedPart(held.string, held.first, count % (held.size + 1), left_out)
        expected = batches[0][: held.size if left_out else part.size]
        assert samples_of([self.table.remove(rank, part)]) == expected
        del batches[0][: len(expected)]
        if not batches[0]:
            batches.pop(0)

    def hear(self, rank):
        assert self.table.heartbeat(rank, self.now) == (rank in self.silent)
        self.silent.discard(rank)
        self.heard[rank] = self.now

    def listen(self, patience):
        before = self.now - patience
        fallen = [
            rank
            for rank in range(RANKS)
            if self.batches[rank] and self.heard[rank] < before and rank not in self.silent
        ]
        assert self.table.mark_silent(before) == fallen
        self.silent.update(fallen)

    def settle(self, string):
        self.settled.add(string)
        counts = [
            sum(pair[0] == string for batch in batches for pair in batch)
            for batches in self.batches
        ]
        expected = [(r, count) for r, count in enumerate(counts) if count and r not in self.silent]
        assert self.table.close(string) == expected
        assert self.table.close(string) == []

    def compare(self):
        table = self.table
        assert table.silent == self.silent
        for rank in range(RANKS):
            wanted = [pair for batch in self.batches[rank] for pair in batch]
            assert samples_of(table.ranges(rank)) == wanted
        assert table.samples == sum(len(batch) for held in self.batches for batch in held)
        for count in range(MESSAGES_IN_FLIGHT + 1):
            ranks = {r for r in range(RANKS) if len(self.batches[r]) == count} - self.silent
            found = table.next_rank(count)
            assert found in ranks if ranks else found is None


@examples(300, STEPS)
def test_a_table_holds_what_was_given_and_not_returned(steps):
    model = Model()
    for step, what in steps:
        model.now += 1.0
        if step == "give":
            model.give(what)
        elif step == "return":
            model.take_back(*what)
        elif step == "hear":
            model.hear(what)
        elif step == "settle":
            if what not in model.settled:
                model.settle(what)
        else:
            model.listen(what)
        model.compare()


@examples(50, st.integers(0, 9), st.integers(1, 9), st.data())
def test_a_piece_falls_into_two_that_are_the_whole(first, count, data):
    piece = SampleRange(7, first, count)
    one, other = piece.split(data.draw(st.integers(0, count)))
    assert samples_of([one, other]) == samples_of([piece])


def test_the_rank_that_has_had_its_batches_for_longest_is_next():
    table = InFlightTable(3)
    for rank in (2, 0, 1):
        table.assign(rank, [SampleRange(0, 0, 1)], 0.0)
    assert table.next_rank(0) is None
    assert table.next_rank(1) == 2
    table.assign(2, [SampleRange(0, 0, 1)], 0.0)
    assert table.next_rank(1) == 0
    table.remove(2, ReturnedPart(0, 0, 1, left_out=False))
    assert table.next_rank(1) == 0, "the batch that is left has only begun"


@pytest.mark.parametrize("part", [(5, 1, 1), (4, 0, 1), (5, 0, 3)])
def test_a_rank_that_returns_something_else_than_it_holds_is_refused(part):
    table = InFlightTable(4)
    table.assign(3, [SampleRange(5, 0, 2)], 0.0)
    with pytest.raises(RuntimeError, match=r"rank 3 .*string=5, first=0, size=2"):
        table.remove(3, ReturnedPart(*part, left_out=False))


def test_a_rank_that_had_nothing_to_do_was_not_silent():
    table = InFlightTable(2)
    assert table.mark_silent(100.0) == []
    table.assign(0, [SampleRange(0, 0, 1)], 100.0)
    assert table.mark_silent(100.0) == []
    assert table.mark_silent(100.5) == [0]
    assert table.mark_silent(100.5) == [], "once is enough"
