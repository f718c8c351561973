"""What is new among the samples that ranks return, and whose it was."""

from itertools import chain

import numpy as np
from returned_parts import parts_of

from agglom_mpi.runtime.messages import RESULT, RankMessage, merged
from agglom_mpi.runtime.returned_samples import first_returns, rank_parts
from agglom_mpi.scheduling.estimators import BatchSizer


class Handed:
    """A scheduler some of whose samples other ranks have returned."""

    def __init__(self, known=()):
        self.batch_sizer, self.parts = BatchSizer(), []
        self._known = set(known)

    def returned(self, rank, part):
        self.parts.append((rank, *part))
        numbers = range(part.first, part.first + part.size)
        new = [i for i, sample in enumerate(numbers) if (part.string, sample) not in self._known]
        return [slice(place, place + 1) for place in new]


def rows(string, first, count, **columns):
    found = np.zeros(count, RESULT)
    found["string"], found["sample"] = string, np.arange(first, first + count)
    for name, value in columns.items():
        found[name] = value
    return found


def returned(*messages, left_out=()):
    found = [(rank, np.concatenate(parts)) for rank, *parts in messages]
    reports = [RankMessage(rank, each, parts_of(each, left_out)) for rank, each in found]
    return rank_parts(reports), merged(0, reports).results


def keys(found):
    """Return string and sample of the rows of each part."""
    return [
        found.rows[part.begin : part.end][["string", "sample"]].tolist() for part in found.parts
    ]


def test_samples_of_several_ranks_are_told_apart():
    parts, samples = returned((2, rows(5, 3, 2)), (1, rows(5, 0, 3), rows(4, 7, 1)))
    scheduler = Handed()
    found = first_returns(scheduler, parts, samples)
    assert scheduler.parts == [(2, 5, 3, 2, False), (1, 5, 0, 3, False), (1, 4, 7, 1, False)]
    assert found.strings == {5: False, 4: False}
    each = keys(found)
    assert [*chain(*each)] == [(5, 3), (5, 4), (5, 0), (5, 1), (5, 2), (4, 7)]
    assert [(part.string, part.first) for part in found.parts] == [part[0] for part in each]


def test_what_others_have_returned_and_what_was_left_out_is_no_news():
    parts, samples = returned((1, rows(5, 0, 2, seconds=1.0)), left_out=[5])
    scheduler = Handed(known=[(5, 0)])
    found = first_returns(scheduler, parts, samples)
    assert scheduler.parts == [(1, 5, 0, 2, True)]
    assert keys(found) == [[(5, 1)]]
    assert found.strings == {5: True}
    assert scheduler.batch_sizer.mean_seconds == 1.0


def test_of_some_parts_of_messages_alone_the_rows_are_those():
    parts, samples = returned((1, rows(0, 8, 3)), (2, rows(1, 0, 1), rows(2, 10, 1)))
    found = first_returns(Handed(), parts[1:], samples)
    assert keys(found) == [[(1, 0)], [(2, 10)]]
