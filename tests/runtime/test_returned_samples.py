"""What is new among the samples that ranks return, and whose it was."""

from itertools import chain

import numpy as np
import pytest

from agglom_mpi.runtime.messages import NOT_NEEDED, RESULT, RankMessage, merged
from agglom_mpi.runtime.returned_samples import ReturnedSamples, first_returns
from agglom_mpi.scheduling.estimators import BatchSizer
from agglom_mpi.scheduling.in_flight import SampleRange


class Handed:
    """A scheduler that has handed out ranges, of which other ranks have returned some samples."""

    def __init__(self, ranges, known=()):
        self.batch_sizer = BatchSizer()
        self._ranges = {rank: list(parts) for rank, parts in ranges.items()}
        self._known = set(known)

    def returned(self, rank, done):
        found = []
        while done:
            part = self._ranges[rank].pop(0)
            flags, done = done[: part.size], done[part.size :]
            new = [
                slice(place, place + 1)
                for place, flag in enumerate(flags)
                if flag and (part.string, part.first + place) not in self._known
            ]
            found.append((part, new))
        return found


def rows(string, first, count, **columns):
    found = np.zeros(count, RESULT)
    found["string"], found["sample"] = string, np.arange(first, first + count)
    found["mean_radius_ratio"] = 100.0 * string + found["sample"]
    for name, value in columns.items():
        found[name] = value
    return found


def returned(*messages):
    reports = [RankMessage(rank, np.concatenate(parts)) for rank, *parts in messages]
    return ReturnedSamples.of(reports, merged(0, reports).results)


def keys(found):
    """Return string and sample of the rows of each part."""
    return [
        found.rows[part.begin : part.end][["string", "sample"]].tolist() for part in found.parts
    ]


def test_samples_of_several_ranks_are_told_apart_by_what_each_was_to_do():
    samples = returned((2, rows(5, 3, 2)), (1, rows(5, 0, 3), rows(4, 7, 1)))
    scheduler = Handed({1: [SampleRange(5, 0, 3), SampleRange(4, 7, 1)], 2: [SampleRange(5, 3, 2)]})
    found = first_returns(scheduler, samples)
    assert found.strings == [5, 4]
    each = keys(found)
    assert [*chain(*each)] == [(5, 3), (5, 4), (5, 0), (5, 1), (5, 2), (4, 7)]
    assert [(part.string, part.first) for part in found.parts] == [part[0] for part in each]
    assert len(found.rows) == 6
    assert not len(found.skipped)


def test_what_others_have_returned_and_what_was_left_out_is_no_news():
    left_out = rows(5, 2, 2, reason=NOT_NEEDED, seconds=0.25)
    samples = returned((1, rows(5, 0, 2, seconds=1.0), left_out))
    scheduler = Handed({1: [SampleRange(5, 0, 4)]}, known=[(5, 0)])
    found = first_returns(scheduler, samples)
    assert keys(found) == [[(5, 1)]]
    assert found.rows["sample"].tolist() == [1]
    assert found.skipped["sample"].tolist() == [2, 3]
    assert found.strings == [5]
    assert scheduler.batch_sizer.mean_seconds == 1.0


def test_fresh_samples_are_split_off_with_the_ranks_that_they_came_from():
    samples = returned((1, rows(0, 8, 3)), (2, rows(1, 0, 1), rows(1, 10, 1)))
    searched, fresh = samples.split(10)
    assert searched.rows[["string", "sample"]].tolist() == [(0, 8), (0, 9), (1, 0)]
    assert searched.counts == [(1, 2), (2, 1)]
    assert fresh.rows[["string", "sample"]].tolist() == [(0, 10), (1, 10)]
    assert fresh.counts == [(1, 1), (2, 1)]
    assert samples.split(11) == (samples, None)
    assert samples.split(0)[0] is None


def test_a_rank_that_sends_something_else_than_it_was_to_do_is_refused():
    scheduler = Handed({3: [SampleRange(5, 1, 1)]})
    with pytest.raises(RuntimeError, match=r"rank 3 .*5, 0.*5, 1"):
        first_returns(scheduler, returned((3, rows(5, 0, 1))))
