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
from agglom_mpi.search.proposals import Proposals, restored
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.table import runs_of
from agglom_mpi.storage.timeouts import judged_as_timed_out, timed_out
from agglom_mpi.storage.writer import CampaignWriter
from agglom_mpi.variables import NAMES


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


class Stored:
    """What earlier legs left in a campaign file, read once at the start.

    Attributes
    ----------
    samples, fresh
        Samples that decisions may see, and those that none does.
    timed_out, late
        Samples, as (string, sample), that have no row because they took too long: those that were
        judged, and fresh ones.
    """

    def __init__(self, file: CampaignData) -> None:
        strings = file.string_rows()
        self.parameters = {
            int(row["string"]): np.array([row[name] for name in NAMES]) for row in strings
        }
        results = file.result_rows()
        self.results = {int(row["string"]): results[i : i + 1] for i, row in enumerate(results)}
        self.generations = {int(row["generation"]) for row in file.generation_rows()}
        rows, failures = file.all_sample_rows(), file.failures()
        fresh = rows["sample"] >= file.fresh_from
        self.samples, self.fresh = rows[~fresh], rows[fresh]
        self.timed_out = judged_as_timed_out(failures, rows, results)
        late = timed_out(failures, rows)
        self.late = {pair for pair in late if pair[1] >= file.fresh_from}
        self.format_version = int(file.attributes["format_version"])
        self.seconds = _seconds_of_legs(file)

    @property
    def failures(self) -> int:
        """Samples that raised or took too long."""
        raised = sum(
            int((rows["reason"] == EXCEPTION).sum()) for rows in (self.samples, self.fresh)
        )
        return raised + len(self.timed_out) + len(self.late)

    @property
    def failed(self) -> int:
        """Samples that failed for any reason."""
        failed = sum(int((rows["state"] == FAILED).sum()) for rows in (self.samples, self.fresh))
        return failed + len(self.timed_out) + len(self.late)

    @property
    def count(self) -> int:
        """Samples, fresh ones included."""
        return len(self.samples) + len(self.fresh)

    @property
    def estimated(self) -> set[tuple[int, int]]:
        """Fresh samples, as (string, sample), that need no simulation."""
        return {*self.fresh[["string", "sample"]].tolist(), *self.late}

    def restore(self, batch: Proposals, first: int) -> Proposals:
        """Replace proposals by what is stored of them, bit for bit."""
        return restored(batch, first, self.parameters)


def _seconds_of_legs(file: CampaignData) -> float:
    """Wall-clock time of all earlier legs; of a killed one up to its last generation."""
    legs = file.legs()
    whole = float(np.nansum(legs["stopped"] - legs["started"]))
    generations = file.generation_rows()
    return max(whole, float(generations["seconds"].max()) if len(generations) else 0.0)


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
        stored: Stored,
        watcher: ProgressListener,
        top: int,
        generations: int,
    ) -> None:
        self.samples = 0
        self.busy_seconds = 0.0
        self.failures = 0
        self.failed = stored.failed
        self.best: Best | None = None
        self.laps = DurationStatistics()
        self.fresh_costs = DurationStatistics()
        self._generations = generations
        self.begin()
        self._writer = writer
        self._stored = stored
        self._watcher = watcher
        self._top = top
        self._evidence = DigestAccumulator(stored.samples, stored.format_version)
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
        return self._stored.count + self.samples

    @property
    def seconds(self) -> float:
        """Wall-clock seconds of all legs."""
        return self._stored.seconds + self.elapsed

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
        row = self._stored.results.get(string)
        if row is None:
            row = result_row(string, result)
            self._writer.mark_running()
            self._backlog.store(partial(self._writer.put_result, string, **result._asdict()))
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
        if summary.generation in self._stored.generations:
            return
        self.laps.add(self.lap)
        self._turned = time.monotonic()
        simulated = len(self._stored.samples) + len(self._stored.timed_out) + self.samples
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
