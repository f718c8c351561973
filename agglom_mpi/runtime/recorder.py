"""Record decisions in the campaign file, and notify progress listeners."""

import time
from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.display.progress import Best, Progress
from agglom_mpi.display.remaining_time import DurationStatistics
from agglom_mpi.outcome import EXCEPTION, FAILED
from agglom_mpi.runtime.generation_digest import DigestAccumulator, result_row
from agglom_mpi.runtime.messages import storable
from agglom_mpi.runtime.write_order import WriteOrderBarrier
from agglom_mpi.search.ensemble import EnsembleResult
from agglom_mpi.search.inversion import GenerationSummary
from agglom_mpi.search.proposals import Proposals
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.table import runs_of
from agglom_mpi.storage.writer import CampaignWriter


class ProgressListener(Protocol):
    """Somebody who is shown how a run goes."""

    def generation(self, summary: GenerationSummary, total: int, samples: int, rate: float) -> None:
        """Show a finished generation, one of `total` at most.

        `samples` are simulated so far; `rate` is that of this leg in samples/s.
        """

    def tick(self, progress: Progress) -> None:
        """Show how it goes; called from time to time."""

    def message(self, text: str) -> None:
        """Show one line."""

    def error(self, text: str) -> None:
        """Show what went wrong, however quiet the run is."""


def _seconds_of_legs(data: CampaignData) -> float:
    """Wall-clock time of all earlier legs; of a killed one up to its last generation."""
    legs, generations = data.legs(), data.generation_rows()
    ended = float(np.nansum(legs["stopped"] - legs["started"]))
    return max(ended, float(generations["seconds"].max()) if len(generations) else 0.0)


class RunRecorder:
    """Observer of the inversion: stores what it decides, once, and shows it.

    Parameters
    ----------
    writer
        Of the campaign file.
    stored
        What the file holds already, and is not written again.
    watcher
        Shown every generation.
    top
        Number of strings in the mean of the best.
    generations
        Most generations there are.

    Attributes
    ----------
    samples, busy_seconds
        Samples of this leg, and the time that they took, s.
    failures, failed
        Samples of all legs that raised or took too long, and that failed for any reason.
    best
        What the last generation found.
    laps
        How long generations of this leg took, s.
    fresh_costs
        What fresh samples of this leg took, s.
    """

    def __init__(
        self,
        writer: CampaignWriter,
        stored: CampaignData,
        watcher: ProgressListener,
        top: int,
        generations: int,
    ) -> None:
        self.samples = 0
        self.busy_seconds = 0.0
        rows, searched = stored.all_sample_rows(), stored.searched_samples
        judged = stored.judged_timed_out
        timed_out = len(judged) + len(stored.fresh_timed_out)
        self.failures = int((rows["reason"] == EXCEPTION).sum()) + timed_out
        self.failed = int((rows["state"] == FAILED).sum()) + timed_out
        self.best: Best | None = None
        self.laps = DurationStatistics()
        self.fresh_costs = DurationStatistics()
        self._generations = generations
        self.begin()
        self._writer = writer
        results = stored.result_rows()
        self._stored_results = {
            string: results[i : i + 1] for i, string in enumerate(results["string"].tolist())
        }
        self._stored_generations = set(stored.generation_rows()["generation"].tolist())
        self._stored_samples, self._stored_searched = len(rows), len(searched) + len(judged)
        self._stored_seconds = _seconds_of_legs(stored)
        self._watcher = watcher
        self._top = top
        self._evidence = DigestAccumulator(searched, stored.format_version)
        self._backlog = WriteOrderBarrier()
        self._strings = set(stored.parameters)
        self.synced: Callable[[], None] = lambda: None

    def begin(self) -> None:
        """Let this leg begin now."""
        self._begun = self._turned = time.monotonic()

    @property
    def elapsed(self) -> float:
        """Seconds of this leg."""
        return max(1e-9, time.monotonic() - self._begun)

    @property
    def lap(self) -> float:
        """Seconds of the generation that is under way."""
        return time.monotonic() - self._turned

    @property
    def rate(self) -> float:
        """Samples per second of this leg."""
        return self.samples / self.elapsed

    @property
    def all_samples(self) -> int:
        """Samples of all legs, fresh ones included."""
        return self._stored_samples + self.samples

    @property
    def seconds(self) -> float:
        """Wall-clock seconds of all legs."""
        return self._stored_seconds + self.elapsed

    def simulated(
        self,
        results: NDArray[np.void],
        finals: NDArray[np.void] | None = None,
        writes: int | None = None,
    ) -> None:
        """Store the samples of one batch, unless the rank `writes` does so itself.

        Particles may come before or without their samples.
        """
        if writes is None:
            self._writer.put_samples(results, finals)
        else:
            self._backlog.delivered(writes, results)

    def counted(self, results: NDArray[np.void]) -> None:
        """Take samples that decisions are made from, each once."""
        self._evidence.simulated(storable(results))
        self._took(results)

    def estimated(self, results: NDArray[np.void]) -> None:
        """Take samples that no decision is made from, each once."""
        self._took(results)
        for seconds in results["seconds"].tolist():
            self.fresh_costs.add(seconds)

    def _took(self, results: NDArray[np.void]) -> None:
        self.samples += len(results)
        self.busy_seconds += sum(results["seconds"].tolist())
        self.failed += results["state"].tolist().count(FAILED)

    def left_out(self, results: NDArray[np.void]) -> None:
        """Take samples that were begun at most, as they turned out not to be needed."""
        self.busy_seconds += sum(results["seconds"].tolist())

    def announced(self, batch: Proposals, ids: NDArray[np.int64]) -> None:
        """Store strings of a coming generation before any of their samples is handed out."""
        self._store_strings(batch, ids)

    def proposed(self, batch: Proposals, ids: NDArray[np.int64]) -> None:
        """Store new strings before any of their samples is handed out."""
        self._evidence.proposed(batch.parameters)
        self._store_strings(batch, ids)

    def _store_strings(self, batch: Proposals, ids: NDArray[np.int64]) -> None:
        """Store those that are not in the file yet; announced ones end a generation."""
        new = np.array([string not in self._strings for string in ids.tolist()])
        for first, count in runs_of(new):
            self._writer.mark_running()
            some = slice(first, first + count)
            self._writer.put_strings(
                int(ids[first]),
                batch.generation,
                batch.slot[some],
                batch.origin[some],
                batch.parents[some],
                batch.parameters[some],
            )
        self._strings.update(ids.tolist())

    def judged(self, string: int, result: EnsembleResult) -> None:
        """Store the result of a string."""
        row = self._stored_results.get(string)
        if row is None:
            row = result_row(string, result)
            self._writer.mark_running()
            self._backlog.store(partial(self._writer.put_result, row))
        self._evidence.judged(string, row)

    def written(self, rank: int, count: int) -> None:
        """Take note that so many more samples of a rank are in the file."""
        self._backlog.written(rank, count)

    def take_over(self, rank: int) -> None:
        """Store what a rank has sent that was to write it itself, and is not heard any more."""
        for rows in self._backlog.take_over(rank):
            self._writer.put_samples(rows)
        self._writer.flush()
        self._backlog.taken_over()

    def finish(self) -> None:
        """Store what waits: all ranks have stopped, and written what they had."""
        self._backlog.finish()

    def generation_done(self, summary: GenerationSummary) -> None:
        """Store a generation, and wait until it is on the disc."""
        self.best = Best(
            summary.best, summary.objective, summary.standard_error, summary.mean_of_top
        )
        if summary.generation in self._stored_generations:
            return
        self.laps.add(self.lap)
        self._turned = time.monotonic()
        simulated = self._stored_searched + self.samples
        store = partial(
            self._writer.put_generation,
            summary.generation,
            best_string=summary.best,
            best_objective=summary.objective,
            best_standard_error=summary.standard_error,
            mean_of_top=summary.mean_of_top,
            top=self._top,
            evaluations=summary.evaluations,
            samples_used=summary.samples_used,
            samples_simulated=simulated,
            seconds=self.seconds,
            population=summary.population,
            digest=self._evidence.digest(),
        )
        self._backlog.store(lambda: self._seal(store))
        self._watcher.generation(summary, self._generations, simulated, self.rate)

    def _seal(self, store: Callable[[], None]) -> None:
        self._writer.mark_running()
        store()
        self._writer.sync()
        self.synced()
