"""Many samples at once: ensembles take them through compiled code, as far as they need them.

An ensemble's decisions depend on its samples in their order, and its judge takes those of a string
one after the other: see `judge`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.judge import EnsembleMeans, samples_needed
from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.statistics import Floats

Rows = NDArray[np.void]


class SampleBatch:
    """Samples of any strings.

    Parameters
    ----------
    rows
        With the columns of `outcome.OUTCOME`, (n,).
    summarise
        Returns the summaries of rows, for ensembles that take one sample after the other.
    """

    def __init__(self, rows: Rows, summarise: Callable[[Rows], list[SampleSummary]]) -> None:
        self._rows = rows
        self._summarise = summarise

    @cached_property
    def _columns(self) -> tuple[NDArray[np.bool_], Floats, NDArray[np.int64]]:
        """Whether each sample completed, its b^f/b⁰, and its particles left, (n,)."""
        completed, left = self._rows["state"] == COMPLETED, self._rows["particles"]
        if not left[completed].all():
            raise ZeroDivisionError("a completed sample has no particles")
        return completed, self._rows["mean_radius_ratio"].copy(), left.copy()

    def columns(self, begin: int, end: int) -> tuple[NDArray[Any], ...]:
        """Return what a judge takes of a range of samples.

        Raises
        ------
        ZeroDivisionError
            If a completed sample has no particles.
        """
        return tuple(column[begin:end] for column in self._columns)

    def summaries(self, begin: int, end: int) -> list[SampleSummary]:
        """Return the summaries of a range of samples."""
        return self._summarise(self._rows[begin:end])


class SamplePart(NamedTuple):
    """Consecutive samples of one string: a range of a batch."""

    batch: SampleBatch
    begin: int
    end: int

    def part(self, begin: int, end: int) -> "SamplePart":
        """Return a range of the range."""
        return SamplePart(self.batch, self.begin + begin, self.begin + end)


NewSamples: TypeAlias = tuple[Ensemble, list[SamplePart]]
"""An ensemble that is not finished, and the samples that follow those it has used, in order."""


def extend(batches: Sequence[NewSamples]) -> None:
    """Add samples to ensembles, to each as many as it needs; each ensemble stands there once."""
    for ensemble, parts in batches:
        for batch, begin, end in parts:
            if not ensemble.finished:
                _add(ensemble, batch, begin, end)


def _add(ensemble: Ensemble, batch: SampleBatch, begin: int, end: int) -> None:
    """Add consecutive samples to an ensemble: those after a failed one, too, one by one."""
    if ensemble.follows_means:
        allowed = begin + ensemble.max_samples - ensemble.samples_used
        begin += _follow(ensemble, batch, begin, min(end, allowed))
    if not ensemble.finished and begin < end:
        for outcome in batch.summaries(begin, end):
            ensemble.add(outcome)
            if ensemble.finished:
                return


def _follow(ensemble: Ensemble, batch: SampleBatch, begin: int, end: int) -> int:
    """Let an ensemble follow its means up to the first sample that failed; return how many."""
    completed, ratios, left = batch.columns(begin, end)
    if not completed.all():
        size = int(completed.argmin())
        completed, ratios, left = completed[:size], ratios[:size], left[:size]
    if not len(completed):
        return 0
    judge = ensemble.judge(ensemble.means, len(completed))
    taken = samples_needed(judge, completed, ratios, left)
    state = judge.state[0].item()
    ensemble.follow(EnsembleMeans(*state[: len(EnsembleMeans._fields)]), judge.is_decided)
    return taken


class WaitingSamples:
    """Runs of consecutive samples of strings; of several copies of a sample the first counts."""

    def __init__(self) -> None:
        self._runs: dict[int, dict[int, SamplePart]] = {}  # by string and first sample

    def add(self, string: int, first: int, part: SamplePart, used: int) -> None:
        """Add consecutive samples of a string, except those that are there or used already.

        Parameters
        ----------
        string, first
            Their string, and the number of the first one.
        part
            The samples.
        used
            Number of samples that the string has used.
        """
        runs = self._runs.setdefault(string, {})
        if runs or first < used:
            size = part.end - part.begin
            for start, stop in list(gaps(max(first, used), first + size, runs)):
                runs[start] = part.part(start - first, stop - first)
        else:
            runs[first] = part

    def take(self, string: int, used: int, limit: float) -> list[SamplePart]:
        """Remove and return the samples that follow the `used` ones without a gap, up to a limit.

        Parameters
        ----------
        string
            Their string.
        used
            Number of samples that it has used.
        limit
            Number of samples that it may have used then.
        """
        runs, parts = self._runs.get(string, {}), []
        while used < limit and (part := runs.pop(used, None)) is not None:
            size = part.end - part.begin
            if used + size > limit:
                allowed = int(limit) - used
                runs[int(limit)], part = part.part(allowed, size), part.part(0, allowed)
            parts.append(part)
            used += size
        return parts

    def drop(self, string: int) -> None:
        """Remove all samples of a string."""
        self._runs.pop(string, None)

    def clear(self) -> None:
        """Remove all samples."""
        self._runs.clear()


def gaps(begin: int, end: int, runs: Mapping[int, SamplePart]) -> Iterator[tuple[int, int]]:
    """Yield begin and end of the parts of a range of samples that no run, by its first, holds."""
    for first in sorted(runs):
        if first >= end:
            break
        if begin < first:
            yield begin, first
        begin = max(begin, first + runs[first].end - runs[first].begin)
    if begin < end:
        yield begin, end
