"""Many samples at once: ensembles that follow the running means of arrays of samples.

An ensemble's decisions depend on its samples in their order, so the running means are computed one
after the other, by the same operations as `RunningMean.add`. All else is done for the samples of
many ensembles together: one call of the stopping rule decides where each of them ends.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.search.ensemble import Ensemble, EnsemblePath
from agglom_mpi.search.stopping import EnsembleState, StoppingRule

Rows = NDArray[np.void]


class NewSamples(NamedTuple):
    """An ensemble, and the samples that follow those it has used.

    Attributes
    ----------
    ensemble
        It is not finished.
    parts
        Rows with the columns of `outcome.OUTCOME`, one part after the other, (n,) each.
    """

    ensemble: Ensemble
    parts: list[Rows]

    def column(self, name: str) -> NDArray[np.generic]:
        """Return one column of all parts, (n,)."""
        if len(self.parts) == 1:
            return self.parts[0][name]
        return np.concatenate([rows[name] for rows in self.parts])


def extend(
    batches: Sequence[NewSamples], summarise: Callable[[Rows], list[SampleSummary]]
) -> None:
    """Add samples to ensembles, to each as many as it needs; an ensemble is in one batch only.

    Parameters
    ----------
    batches
        The ensembles with their samples.
    summarise
        Returns the summaries of rows, for ensembles that take one sample after the other.
    """
    by_rule: dict[int, list[tuple[Ensemble, EnsemblePath]]] = {}
    for batch in batches:
        ensemble = batch.ensemble
        if ensemble.follows_paths and (batch.column("state") == COMPLETED).all():
            ratios, particles = batch.column("mean_radius_ratio"), batch.column("particles")
            path = ensemble.path(ratios, particles)
            by_rule.setdefault(id(ensemble.rule), []).append((ensemble, path))
        else:
            _add_one_by_one(batch, summarise)
    for group in by_rule.values():
        _follow(group[0][0].rule, group)


def _add_one_by_one(
    batch: NewSamples, summarise: Callable[[Rows], list[SampleSummary]]
) -> None:
    for outcome in chain.from_iterable(map(summarise, batch.parts)):
        if batch.ensemble.finished:
            return
        batch.ensemble.add(outcome)


def _follow(rule: StoppingRule, group: list[tuple[Ensemble, EnsemblePath]]) -> None:
    """Let ensembles of one rule follow their paths, each to where the rule first holds."""
    ends = _where_it_holds(rule, [path for _, path in group])
    begin = 0
    for ensemble, path in group:
        # One sample satisfies no rule.
        fewest = max(rule.min_samples, 2) - path.counts[0] - 1
        samples = len(path.counts) - 1
        place = bisect_left(ends, begin + max(0, fewest))
        converges = place < len(ends) and ends[place] < begin + samples
        ensemble.follow(path, ends[place] - begin + 1 if converges else samples, converges)
        begin += samples + 1


def _where_it_holds(rule: StoppingRule, paths: list[EnsemblePath]) -> list[int]:
    """Return the numbers of the steps of all paths at which a rule holds, ascending.

    The paths lie one behind the other: step i leads from state i to state i + 1, and the step from
    the end of one path to the beginning of the next has no meaning.
    """
    columns = [
        np.fromiter(chain.from_iterable(column), np.float64)[:, None]
        for column in zip(*(path[:4] for path in paths), strict=True)
    ]
    counts, ratios, means, squares = columns
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        errors = np.sqrt(squares / (counts - 1.0) / counts)
        states = counts.astype(np.int64), ratios, np.abs(means), errors
        before, after = (
            EnsembleState(*(column[part] for column in states), None)
            for part in (slice(None, -1), slice(1, None))
        )
        holds = rule.holds(before, after)
    return np.flatnonzero(np.broadcast_to(holds, (len(counts) - 1, 1))).tolist()
