"""Samples that ranks have returned, as one array: what is new among them, and whose it was."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.runtime.messages import RankMessage
from agglom_mpi.scheduling.interface import ReturnedPart
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.scheduling.static_scheduler import StaticScheduler
from agglom_mpi.storage.table import concatenated

Rows = NDArray[np.void]


class NewPart(NamedTuple):
    """Consecutive samples of one string that no rank has returned before: a range of rows."""

    string: int
    first: int
    begin: int
    end: int


class RankPart(NamedTuple):
    """A part of a task of a rank, and where its rows begin among those of all parts."""

    rank: int
    part: ReturnedPart
    begin: int


class FirstReturns(NamedTuple):
    """What is new among returned samples.

    Attributes
    ----------
    strings
        Strings of all of them, new or not, and whether ranks left out samples of each.
    parts
        The new ones.
    rows
        All new ones, (n,).
    """

    strings: dict[int, bool]
    parts: list[NewPart]
    rows: Rows


def rank_parts(messages: Sequence[RankMessage]) -> list[RankPart]:
    """Return the parts of tasks that messages report, in order, as their rows lie together."""
    found, begin = [], 0
    for message in messages:
        columns = (message.parts[name].tolist() for name in ReturnedPart._fields)
        for string, first, size, left_out in zip(*columns, strict=True):
            part = ReturnedPart(string, first, size, bool(left_out))
            found.append(RankPart(message.rank, part, begin))
            begin += size
    return found


def first_returns(
    scheduler: Scheduler | StaticScheduler, returned: Sequence[RankPart], rows: Rows
) -> FirstReturns:
    """Take samples off those in flight, and return what is new among them.

    Parameters
    ----------
    scheduler
        Who has assigned them.
    returned
        Parts of tasks.
    rows
        Rows of `/samples` of these parts and perhaps others, (n,).

    Raises
    ------
    RuntimeError
        If a rank sent something else than what it was to do next.
    """
    strings: dict[int, bool] = {}
    parts, kept, end = [], [], 0
    for rank, part, begin in returned:
        for new in scheduler.returned(rank, part):
            size = new.stop - new.start
            parts.append(NewPart(part.string, part.first + new.start, end, end + size))
            kept.append((begin + new.start, begin + new.stop))
            end += size
        strings[part.string] = strings.get(part.string, False) or part.left_out
    if end != len(rows):
        rows = concatenated([rows[begin:end] for begin, end in kept], rows.dtype)
    scheduler.batch_sizer.learn(rows["seconds"].tolist())
    return FirstReturns(strings, parts, rows)
