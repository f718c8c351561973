"""What a rank reports arrives as it was, in several messages; what is new in it is found."""

from itertools import chain

import numpy as np
import pytest
from returned_parts import parts_of

from agglom_mpi.runtime.abort_flag import SampleUnderWay
from agglom_mpi.runtime.messages import (
    ALIVE,
    FAILURE,
    FINALS,
    FRAMES,
    GOODBYE,
    PART,
    RESULT,
    RESULTS,
    STOP,
    UNWRITTEN,
    WRITTEN,
    RankMessage,
    decoded,
    failed_sample,
    first_returns,
    heartbeat,
    merged,
    rank_parts,
    record_types,
)
from agglom_mpi.scheduling.estimators import BatchSizer

GRAINS = 3
TYPES = record_types(GRAINS)


def numbered(tag, count, field="sample"):
    records = np.zeros(count, TYPES[tag])
    records[field] = np.arange(count)
    return records


def full_message():
    parts, rows = np.zeros(2, PART), np.zeros(3, RESULT)
    parts["size"], rows["sample"] = (1, 2), range(3)
    failures = np.concatenate([failed_sample(4, sample, 1, "raised") for sample in (5, 6)])
    frames = numbered(FRAMES, 2, "frame"), numbered(FRAMES, 3, "frame")
    return RankMessage(1, rows, parts, failures, numbered(FINALS, 2), frames)


def test_records_decoded_and_merged_are_the_message():
    message = full_message()
    sent = list(message.records())
    assert [tag for tag, _ in sent] == [FINALS, FAILURE, *[FRAMES] * 5, RESULTS]
    received = [
        decoded(1, tag, np.frombuffer(records.tobytes(), TYPES[tag])) for tag, records in sent
    ]
    again = merged(1, received)
    for name in ("results", "parts", "failures", "final_particles"):
        assert getattr(again, name).tobytes() == getattr(message, name).tobytes()
    frames = [np.concatenate(each.frames).tobytes() for each in (message, again)]
    assert frames[0] == frames[1]


def test_a_frame_travels_alone():
    assert [len(records) for tag, records in full_message().records() if tag == FRAMES] == [1] * 5


def test_a_message_of_nothing_is_a_heartbeat():
    message = merged(2, [])
    assert message.empty
    assert list(message.records()) == []
    assert decoded(2, ALIVE, heartbeat(b"name")) == RankMessage(2)
    assert not RankMessage(2, parts=np.zeros(1, PART)).empty


def test_a_heartbeat_reports_what_its_rank_is_doing():
    sample = SampleUnderWay(7, 3, 12.5)
    assert decoded(2, ALIVE, heartbeat(b"", sample)) == RankMessage(2, under_way=sample)
    assert decoded(2, ALIVE, heartbeat(b"", writes=True)) == RankMessage(2, writes=True)


def test_counts_and_the_last_message_are_decoded():
    assert decoded(3, WRITTEN, np.array([7])).written == 7
    goodbye = np.array([(2.5,)], GOODBYE)
    last = decoded(3, STOP, goodbye)
    assert (last.stopped, last.database_seconds) == (True, 2.5)


def test_a_rank_that_cannot_write_is_an_error_with_its_number():
    with pytest.raises(OSError, match=r"rank 3 on .*: disc full"):
        decoded(3, UNWRITTEN, failed_sample(-1, -1, 3, "disc full"))


def test_of_a_long_text_the_first_line_and_the_end_are_kept():
    lines = ["Traceback (most recent call last):", *["  ä deep"] * 300, "ValueError: too warm"]
    [record] = failed_sample(1, 2, 0, "\n".join(lines))
    kept = record["text"].decode().split("\n")
    assert (kept[0], kept[-1]) == (lines[0], lines[-1])
    assert 950 < len(record["text"]) <= 1000
    [record] = failed_sample(1, 2, 0, "ä" * 900)
    assert record["text"].decode().endswith("ä" * 400)
    [record] = failed_sample(1, 2, 0, "short")
    assert record["text"] == b"short"


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


def keys(parts, rows):
    """Return string and sample of the rows of each part."""
    return [rows[begin:end][["string", "sample"]].tolist() for *_, begin, end in parts]


def test_samples_of_several_ranks_are_told_apart():
    parts, samples = returned((2, rows(5, 3, 2)), (1, rows(5, 0, 3), rows(4, 7, 1)))
    scheduler = Handed()
    strings, found, new = first_returns(scheduler, parts, samples)
    assert scheduler.parts == [(2, 5, 3, 2, False), (1, 5, 0, 3, False), (1, 4, 7, 1, False)]
    assert strings == {5: False, 4: False}
    each = keys(found, new)
    assert [*chain(*each)] == [(5, 3), (5, 4), (5, 0), (5, 1), (5, 2), (4, 7)]
    assert [part[:2] for part in found] == [part[0] for part in each]


def test_what_others_have_returned_and_what_was_left_out_is_no_news():
    parts, samples = returned((1, rows(5, 0, 2, seconds=1.0)), left_out=[5])
    scheduler = Handed(known=[(5, 0)])
    strings, found, new = first_returns(scheduler, parts, samples)
    assert scheduler.parts == [(1, 5, 0, 2, True)]
    assert keys(found, new) == [[(5, 1)]]
    assert strings == {5: True}
    assert scheduler.batch_sizer.mean_seconds == 1.0


def test_of_some_parts_of_messages_alone_the_rows_are_those():
    parts, samples = returned((1, rows(0, 8, 3)), (2, rows(1, 0, 1), rows(2, 10, 1)))
    _, found, new = first_returns(Handed(), parts[1:], samples)
    assert keys(found, new) == [[(1, 0)], [(2, 10)]]
