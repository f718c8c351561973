"""Many samples at once: ensembles that follow the running means of arrays of samples.

An ensemble's decisions depend on its samples in their order, so the running means are computed one
after the other, by the same operations as `RunningMean.add`. All else is done for the samples of
many ensembles together: one call of the stopping rule decides where each of them ends.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.search.ensemble import Ensemble, EnsemblePath
from agglom_mpi.search.objectives.objective import Objective, RadiusObjective
from agglom_mpi.search.stopping import EnsembleState, StoppingRule, rows_of

Rows = NDArray[np.void]

EARLIER, LATER = slice(None, -1), slice(1, None)
"""States before and after each step of a path."""


class SampleBatch:
    """Samples of any strings, with the columns that ensembles need as lists.

    Parameters
    ----------
    rows
        With the columns of `outcome.OUTCOME`, (n,).
    summarise
        Returns the summaries of rows, for ensembles that take one sample after the other.

    Attributes
    ----------
    ratios, particles
        Mean of b^f/b⁰ and number of particles left of each sample, (n,).
    """

    def __init__(self, rows: Rows, summarise: Callable[[Rows], list[SampleSummary]]) -> None:
        self.ratios: NDArray[np.float64] = rows["mean_radius_ratio"]
        self.particles: NDArray[np.int64] = rows["particles"]
        self._rows = rows
        self._summarise = summarise
        self._deviations: dict[int, tuple[Objective, list[float]]] = {}
        self._grains: dict[int, list[float]] = {}

    @cached_property
    def all_completed(self) -> bool:
        """Whether no sample failed."""
        states = self._rows["state"].tolist()
        return states.count(COMPLETED) == len(states)

    def completed(self, begin: int, end: int) -> bool:
        """Return whether none of a range of samples failed."""
        return self.all_completed or bool((self._rows["state"][begin:end] == COMPLETED).all())

    def summaries(self, begin: int, end: int) -> list[SampleSummary]:
        """Return the summaries of a range of samples."""
        return self._summarise(self._rows[begin:end])

    @cached_property
    def ratio_list(self) -> list[float]:
        """The same as `ratios`."""
        return self.ratios.tolist()

    def deviations(self, objective: RadiusObjective) -> list[float]:
        """Return the deviation of each sample, (n,), whose ensemble mean an objective counts."""
        found = self._deviations.get(id(objective))
        if found is None:  # with the objective, whose identity no other one gets as long as it is
            found = objective, objective.deviation(self.ratios).tolist()
            self._deviations[id(objective)] = found
        return found[1]

    def grains(self, particles: int) -> list[float]:
        """Return the grains per particle left of each sample, (n,), that began with `particles`."""
        found = self._grains.get(particles)
        if found is None:
            without = self.particles == 0
            if (without & (self._rows["state"] == COMPLETED)).any():
                raise ZeroDivisionError("a completed sample has no particles")
            found = (particles / np.where(without, 1, self.particles)).tolist()
            self._grains[particles] = found
        return found


class SamplePart(NamedTuple):
    """Consecutive samples of one string: a range of a batch."""

    batch: SampleBatch
    begin: int
    end: int

    def part(self, begin: int, end: int) -> "SamplePart":
        """Return a range of the range."""
        return SamplePart(self.batch, self.begin + begin, self.begin + end)


class NewSamples(NamedTuple):
    """An ensemble that is not finished, and the samples that follow those it has used, in order."""

    ensemble: Ensemble
    parts: list[SamplePart]

    def path(self) -> EnsemblePath:
        """Return the path of the ensemble through the samples."""
        objective, particles = self.ensemble.radius_objective, self.ensemble.particles
        ratios, deviations, grains = [], [], []
        for batch, begin, end in self.parts:
            ratios += batch.ratio_list[begin:end]
            deviations += batch.deviations(objective)[begin:end]
            grains += batch.grains(particles)[begin:end]
        return self.ensemble.path(ratios, deviations, grains)


def extend(batches: Sequence[NewSamples]) -> None:
    """Add samples to ensembles, to each as many as it needs; each ensemble stands there once."""
    by_rule: dict[int, list[tuple[Ensemble, EnsemblePath]]] = {}
    for new in batches:
        ensemble = new.ensemble
        if ensemble.follows_paths and all(
            batch.completed(begin, end) for batch, begin, end in new.parts
        ):
            by_rule.setdefault(id(ensemble.rule), []).append((ensemble, new.path()))
        else:
            _add_one_by_one(new)
    for group in by_rule.values():
        _follow(group[0][0].rule, group)


def _add_one_by_one(new: NewSamples) -> None:
    for batch, begin, end in new.parts:
        for outcome in batch.summaries(begin, end):
            if new.ensemble.finished:
                return
            new.ensemble.add(outcome)


def _follow(rule: StoppingRule, group: list[tuple[Ensemble, EnsemblePath]]) -> None:
    """Let ensembles of one rule follow their paths, each to where the rule first holds."""
    ends, fewest = _where_it_holds(rule, [path for _, path in group]), max(rule.min_samples, 2)
    begin = 0
    for ensemble, path in group:
        samples = len(path.ratios) - 1
        # One sample satisfies no rule.
        place = bisect_left(ends, begin + max(0, fewest - path.completed - 1))
        converges = place < len(ends) and ends[place] < begin + samples
        ensemble.follow(path, ends[place] - begin + 1 if converges else samples, converges)
        begin += samples + 1


def _where_it_holds(rule: StoppingRule, paths: list[EnsemblePath]) -> list[int]:
    """Return the numbers of the steps of all paths at which a rule holds, ascending.

    The paths lie one behind the other: step i leads from state i to state i + 1, and the step from
    the end of one path to the beginning of the next has no meaning.
    """
    columns: tuple[list[float], ...] = [], [], [], []
    for count, *numbers, _ in paths:
        counts = range(count, count + len(numbers[0]))
        for column, part in zip(columns, (counts, *numbers), strict=True):
            column.extend(part)
    counts, ratios, means, squares = np.array(columns)[:, :, None]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        errors = np.sqrt(squares / (counts - 1.0) / counts)
        states = EnsembleState(counts.astype(np.int64), ratios, np.abs(means), errors, None)
        holds = rule.holds(rows_of(states, EARLIER), rows_of(states, LATER))
    if isinstance(holds, np.ndarray):
        return np.flatnonzero(holds).tolist()
    return list(range(len(counts) - 1)) if holds else []
