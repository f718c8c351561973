"""Samples that ranks have returned, as one array: what is new among them, and whose it was."""

from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.messages import NOT_NEEDED, RankMessage
from agglom_mpi.scheduling.in_flight import SampleRange
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.scheduling.static_scheduler import StaticScheduler
from agglom_mpi.storage.table import concatenated, rows_at

Rows = NDArray[np.void]


class ReturnedSamples(NamedTuple):
    """Samples of several messages.

    Attributes
    ----------
    rows
        Rows of `/samples`, message by message, (n,).
    counts
        Rank and number of samples of each message.
    """

    rows: Rows
    counts: list[tuple[int, int]]

    @classmethod
    def of(cls, messages: Sequence[RankMessage], rows: Rows) -> Self:
        """Return the samples of messages, whose results together are `rows`, (n,)."""
        counts = [(message.rank, len(message.results)) for message in messages]
        return cls(rows, [pair for pair in counts if pair[1]])

    def split(self, fresh_from: int) -> tuple["ReturnedSamples | None", "ReturnedSamples | None"]:
        """Split into samples of the search and fresh ones, numbered from `fresh_from` on."""
        if self.rows["sample"].max() < fresh_from:
            return self, None
        fresh = self.rows["sample"] >= fresh_from
        return self._where(~fresh), self._where(fresh)

    def _where(self, chosen: NDArray[np.bool_]) -> "ReturnedSamples | None":
        counts, begin = [], 0
        for rank, count in self.counts:
            if kept := int(np.count_nonzero(chosen[begin : begin + count])):
                counts.append((rank, kept))
            begin += count
        return type(self)(rows_at(self.rows, chosen), counts) if counts else None


class NewPart(NamedTuple):
    """Consecutive samples of one string that no rank has returned before: a range of rows."""

    string: int
    first: int
    begin: int
    end: int


class FirstReturns(NamedTuple):
    """What is new among returned samples.

    Attributes
    ----------
    strings
        Strings of all of them, new or not, without repetition.
    parts
        The new ones.
    rows
        All new ones, (n,).
    skipped
        Samples that were left out as unnecessary, (n,).
    """

    strings: list[int]
    parts: list[NewPart]
    rows: Rows
    skipped: Rows


def first_returns(
    scheduler: Scheduler | StaticScheduler, returned: ReturnedSamples
) -> FirstReturns:
    """Take samples off those in flight, and return what is new among them.

    Raises
    ------
    RuntimeError
        If a rank sent something else than what it was to do next.
    """
    rows = returned.rows
    done = _done(rows)
    scheduler.batch_sizer.learn(list(compress(rows["seconds"].tolist(), done)))
    strings, samples = rows["string"], rows["sample"]
    found: dict[int, None] = {}
    parts, begin = [], 0
    for rank, count in returned.counts:
        for part, new in scheduler.returned(rank, done[begin : begin + count]):
            check_order(rank, part, (strings.item(begin), samples.item(begin)))
            found[part.string] = None
            for where in new:
                first = part.first + where.start
                parts.append(NewPart(part.string, first, begin + where.start, begin + where.stop))
            begin += part.size
    if sum(part.end - part.begin for part in parts) == len(rows):
        return FirstReturns(list(found), parts, rows, rows[:0])
    return FirstReturns(list(found), *_only(rows, parts), rows[rows["reason"] == NOT_NEEDED])


def _done(rows: Rows) -> list[bool]:
    """Return whether each of some samples was simulated, not left out as unnecessary."""
    reasons = rows["reason"].tobytes()
    if NOT_NEEDED not in reasons:
        return [True] * len(rows)
    return [reason != NOT_NEEDED for reason in reasons]


def _only(rows: Rows, parts: list[NewPart]) -> tuple[list[NewPart], Rows]:
    """Return parts, and rows without all others."""
    kept, begin = [], 0
    for part in parts:
        end = begin + part.end - part.begin
        kept.append(part._replace(begin=begin, end=end))
        begin = end
    return kept, concatenated([rows[part.begin : part.end] for part in parts], rows.dtype)


def check_order(rank: int, part: SampleRange, sent: tuple[int, int]) -> None:
    """Raise a RuntimeError if a rank sent another string and sample than it was to do next."""
    if sent != part[:2]:
        raise RuntimeError(f"rank {rank} sent string and sample {sent}; expected were {part[:2]}")
