"""Many samples at once: ensembles that follow their running means through arrays of samples.

An ensemble's decisions depend on its samples in their order. So the running means of many ensembles
are computed one sample after the other, by one compiled loop; then one call of the stopping rule
decides where each of them ends.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.search.ensemble import Ensemble, EnsembleMeans
from agglom_mpi.search.mean_paths import MeanPaths, mean_paths
from agglom_mpi.search.objectives.objective import Objective, RadiusObjective
from agglom_mpi.search.stopping import EnsembleState, StoppingRule, rows_of

Rows = NDArray[np.void]
Floats = NDArray[np.float64]

RATIO, DEVIATION, GRAINS = range(3)
"""Numbers of a sample whose means are followed; see `EnsembleMeans`."""

EARLIER, LATER = slice(None, -1), slice(1, None)
"""States before and after each step of a path."""


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
        self._numbers: dict[tuple[int, int], tuple[Objective, Floats]] = {}

    @cached_property
    def _all_completed(self) -> bool:
        return self._rows["state"].tobytes().count(COMPLETED) == len(self._rows)

    def completed(self, begin: int, end: int) -> bool:
        """Return whether none of a range of samples failed."""
        return self._all_completed or bool((self._rows["state"][begin:end] == COMPLETED).all())

    def summaries(self, begin: int, end: int) -> list[SampleSummary]:
        """Return the summaries of a range of samples."""
        return self._summarise(self._rows[begin:end])

    def numbers(self, objective: RadiusObjective, particles: int) -> Floats:
        """Return the numbers of each sample whose means an ensemble follows, (3, n).

        Parameters
        ----------
        objective
            That of the ensemble.
        particles
            Number of particles at the start of a sample.

        Raises
        ------
        ZeroDivisionError
            If a completed sample has no particles.
        """
        key = id(objective), particles
        found = self._numbers.get(key)
        if found is None:  # with the objective, whose identity no other one gets as long as it is
            found = self._numbers[key] = objective, self._compute_numbers(objective, particles)
        return found[1]

    def _compute_numbers(self, objective: RadiusObjective, particles: int) -> Floats:
        left, numbers = self._rows["particles"], np.empty((3, len(self._rows)))
        numbers[RATIO] = self._rows["mean_radius_ratio"]
        numbers[DEVIATION] = objective.deviation(numbers[RATIO])
        if not left.all():
            if (self._rows["state"][left == 0] == COMPLETED).any():
                raise ZeroDivisionError("a completed sample has no particles")
            left = np.where(left == 0, 1, left)
        np.divide(particles, left, out=numbers[GRAINS])
        return numbers


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
    by_rule: dict[int, list[NewSamples]] = {}
    for ensemble, parts in batches:
        completed = (batch.completed(begin, end) for batch, begin, end in parts)
        if ensemble.follows_means and all(completed):
            by_rule.setdefault(id(ensemble.rule), []).append((ensemble, parts))
        else:
            _add_one_by_one(ensemble, parts)
    for group in by_rule.values():
        _follow(group[0][0].rule, group)


def _add_one_by_one(ensemble: Ensemble, parts: list[SamplePart]) -> None:
    for batch, begin, end in parts:
        for outcome in batch.summaries(begin, end):
            if ensemble.finished:
                return
            ensemble.add(outcome)


def _follow(rule: StoppingRule, group: list[NewSamples]) -> None:
    """Let ensembles of one rule follow their means, each to where the rule first holds."""
    sizes = [sum(end - begin for _, begin, end in parts) for _, parts in group]
    paths = _paths(group, sizes)
    ends, fewest = _where_it_holds(rule, paths), max(rule.min_samples, 2)
    ratios, deviations, grains = paths.means
    squares, begin = paths.squares[DEVIATION], 0
    for (ensemble, _), size in zip(group, sizes, strict=True):
        # One sample satisfies no rule.
        place = bisect_left(ends, begin + max(0, fewest - ensemble.completed - 1))
        added, allowed = size, ensemble.max_samples - ensemble.samples_used
        converges = place < len(ends) and ends[place] < begin + size
        if converges:
            added = ends[place] - begin + 1
        last = begin + min(added, allowed)
        columns = paths.counts, ratios, deviations, squares, grains
        means = EnsembleMeans(*[column.item(last) for column in columns])
        ensemble.follow(means, converges and added <= allowed)
        begin += size + 1


def _paths(group: list[NewSamples], sizes: list[int]) -> MeanPaths:
    """Return the running means of ensembles before and after each of their new samples."""
    numbers = [
        batch.numbers(ensemble.radius_objective, ensemble.particles)[:, begin:end]
        for ensemble, parts in group
        for batch, begin, end in parts
    ]
    now = [ensemble.means for ensemble, _ in group]
    means = np.array([(each.ratio, each.deviation, each.grains) for each in now])
    squares = np.array([(0.0, each.squares, 0.0) for each in now])
    counts = [each.completed for each in now]
    return mean_paths(np.concatenate(numbers, axis=1), sizes, counts, means, squares)


def _where_it_holds(rule: StoppingRule, paths: MeanPaths) -> list[int]:
    """Return the numbers of the steps of all paths at which a rule holds, ascending.

    Step i leads from state i to state i + 1. That from the end of one path to the beginning of the
    next has no meaning.
    """
    counts, ratios = paths.counts[:, None], paths.means[RATIO][:, None]
    objectives = np.abs(paths.means[DEVIATION][:, None])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        errors = np.sqrt(paths.squares[DEVIATION][:, None] / (counts - 1) / counts)
        states = EnsembleState(counts, ratios, objectives, errors, None)
        holds = rule.holds(rows_of(states, EARLIER), rows_of(states, LATER))
    if isinstance(holds, np.ndarray):
        return np.flatnonzero(holds).tolist()
    return list(range(len(counts) - 1)) if holds else []


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
