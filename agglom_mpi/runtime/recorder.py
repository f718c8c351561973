"""Record samples and decisions in the campaign file, each when what it rests on is written."""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.display.progress import best_of
from agglom_mpi.display.run_display import Display
from agglom_mpi.outcome import FailureReason
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.tally import RunTally
from agglom_mpi.scheduling.interface import runs
from agglom_mpi.search.ensemble import EnsembleResult
from agglom_mpi.search.proposals import (
    Decision,
    GenerationSummary,
    StringEvaluated,
    StringsProposed,
)
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import FORMAT_VERSION, RESULTS, SAMPLES, TableSchema, samples_schema
from agglom_mpi.storage.table import (
    concatenated,
    generation_digest,
    make_row,
    places_used,
    rows_at,
)
from agglom_mpi.storage.writer import CampaignWriter

NOTICE_AFTER: Final = 2.0
"""Seconds of deciding again after which a line says so."""


class DigestAccumulator:
    """Collect what the decisions of a generation rest on, for the digest stored with it.

    These are the rows that the decisions were made from, not what the file returns.

    Parameters
    ----------
    samples
        Rows of `/samples` of earlier legs, (n,).
    version
        Format version of the file.
    schema
        Columns of its `/samples`.
    """

    def __init__(
        self,
        samples: NDArray[np.void],
        version: int = FORMAT_VERSION,
        schema: TableSchema = SAMPLES,
    ) -> None:
        self._version = version
        self._schema = schema
        self._parameters = np.empty((0, 0))
        self._results: dict[int, NDArray[np.void]] = {}
        self._samples = [samples]

    def begin(self, parameters: NDArray[np.float64]) -> None:
        """Begin a generation with its strings, shape (n, k)."""
        self._parameters = parameters
        self._results.clear()

    def add_samples(self, rows: NDArray[np.void]) -> None:
        """Add samples of any strings."""
        self._samples.append(rows)

    def add_result(self, string: int, row: NDArray[np.void]) -> None:
        """Add the result of a string, a row of `/results` of shape (1,)."""
        self._results[string] = row

    def digest(self) -> int:
        """Return the digest of the generation, and forget its samples and earlier ones."""
        strings = sorted(self._results)
        results = concatenated([self._results[string] for string in strings], RESULTS.dtype)
        samples = concatenated(self._samples, self._schema.dtype)
        self._samples = [rows_at(samples, samples["string"] > strings[-1])]
        used = places_used(samples, results)
        stored = samples["reason"][used] != FailureReason.TIMED_OUT  # these are in no row
        rows = rows_at(samples, used[stored])
        return generation_digest(self._parameters, results, rows, self._version, self._schema)


class WriteOrderBarrier:
    """Keep the order of writing where ranks write their samples themselves.

    A decision is made as soon as its samples are known, and stored when the ranks that simulated
    them have reported that they are written. Nothing waits for an answer.
    """

    def __init__(self) -> None:
        self._delivered: Counter[int] = Counter()
        self._written: Counter[int] = Counter()
        self._taken_over: Counter[int] = Counter()
        self._rows: dict[int, deque[NDArray[np.void]]] = {}
        self._kept: Counter[int] = Counter()  # samples in them
        self._entries: deque[tuple[dict[int, int], Callable[[], None]]] = deque()

    def delivered(self, rank: int, rows: NDArray[np.void]) -> None:
        """Add samples, rows of `/samples`, (n,), that a rank writes itself."""
        self._delivered[rank] += len(rows)
        self._rows.setdefault(rank, deque()).append(rows)
        self._kept[rank] += len(rows)
        self._forget_written(rank)

    def written(self, rank: int, count: int) -> None:
        """Count `count` more samples of a rank as written, and store what waited for them."""
        late = min(count, self._taken_over[rank])
        self._taken_over[rank] -= late
        self._written[rank] += count - late
        self._forget_written(rank)
        self.store_ready()

    def take_over(self, rank: int) -> list[NDArray[np.void]]:
        """Return samples that a rank has delivered and perhaps not written; wait no longer for it.

        The caller writes them, and then calls `store_ready`.
        """
        rows = list(self._rows.pop(rank, ()))
        self._kept[rank] = 0
        waiting = max(0, self._delivered[rank] - self._written[rank])
        self._taken_over[rank] += waiting
        self._written[rank] += waiting
        return rows

    def store(self, action: Callable[[], None]) -> None:
        """Call `action` after all samples delivered so far are written, and all earlier actions."""
        needed = {
            rank: count for rank, count in self._delivered.items() if self._written[rank] < count
        }
        self._entries.append((needed, action))
        self.store_ready()

    def finish(self) -> None:
        """Call all actions that wait: every rank has written what it had."""
        while self._entries:
            self._entries.popleft()[1]()

    def _forget_written(self, rank: int) -> None:
        rows = self._rows.get(rank, deque())
        missing = self._delivered[rank] - self._written[rank]
        while rows and self._kept[rank] - len(rows[0]) >= missing:
            self._kept[rank] -= len(rows.popleft())

    def store_ready(self) -> None:
        """Call the actions whose samples are written."""
        while self._entries:
            needed, action = self._entries[0]
            if any(self._written[rank] < count for rank, count in needed.items()):
                return
            self._entries.popleft()
            action()


class RunRecorder:
    """Store samples and decisions once each.

    Parameters
    ----------
    writer
        Of the campaign file.
    stored
        What the file holds already, and is not written again.
    display
        Shows every generation.
    top
        Number of strings in the mean of the best.
    generations
        Largest number of generations.

    Attributes
    ----------
    tally
        Numbers and times of samples and generations.
    barrier
        Records that wait for samples which other ranks write.
    synced
        Called when a generation is on the disc.
    """

    def __init__(
        self,
        writer: CampaignWriter,
        stored: CampaignData,
        display: Display,
        top: int,
        generations: int,
    ) -> None:
        self.tally = RunTally(stored)
        self._generations = generations
        self._writer = writer
        results = stored.result_rows()
        self._stored_results = {
            string: results[i : i + 1] for i, string in enumerate(results["string"].tolist())
        }
        self._stored_generations = set(stored.generation_rows()["generation"].tolist())
        self._display = display
        self._top = top
        self._digest = DigestAccumulator(
            stored.searched_samples,
            stored.sizes.version,
            samples_schema(stored.sizes.quantities, stored.sizes.census),
        )
        self.barrier = WriteOrderBarrier()
        self._strings = set(stored.parameters)
        self.synced: Callable[[], None] = lambda: None

    def store_samples(
        self,
        results: NDArray[np.void],
        final_particles: NDArray[np.void] | None = None,
        writer: int | None = None,
    ) -> None:
        """Store samples of one message, unless the rank `writer` does so itself.

        Parameters
        ----------
        results
            Rows of `/samples`, (n,).
        final_particles
            Rows of `/final_particles`; they may come before or without their samples.
        writer
            The rank that writes them; None if it is this one.
        """
        if writer is None:
            self._writer.put_samples(results, final_particles)
        else:
            self.barrier.delivered(writer, results)

    def count(self, results: NDArray[np.void]) -> None:
        """Count samples that decisions are made from, (n,), each once."""
        self._digest.add_samples(results)
        self.tally.count(results)

    def record(self, decisions: Iterable[Decision]) -> None:
        """Store decisions in their order, each before the next one is made."""
        for decision in decisions:
            match decision:
                case StringsProposed():
                    self._store_strings(decision)
                case StringEvaluated(string, result):
                    self._store_result(string, result)
                case GenerationSummary():
                    self._store_generation(decision)

    def take_over(self, rank: int) -> None:
        """Store what a silent rank has sent and was to write itself."""
        for rows in self.barrier.take_over(rank):
            self._writer.put_samples(rows)
        self._writer.flush()
        self.barrier.store_ready()

    def _store_strings(self, decision: StringsProposed) -> None:
        """Store strings that are not in the file yet; those proposed ahead end a generation."""
        proposals, numbers = decision.proposals, decision.strings
        if not decision.ahead:
            self._digest.begin(proposals.parameters)
        new = np.array([string not in self._strings for string in numbers.tolist()])
        for some in runs(new):
            self._writer.mark_running()
            self._writer.put_strings(
                int(numbers[some.start]),
                proposals.generation,
                proposals.slot[some],
                proposals.origin[some],
                proposals.parents[some],
                proposals.parameters[some],
            )
        self._strings.update(numbers.tolist())

    def _store_result(self, string: int, result: EnsembleResult) -> None:
        row = self._stored_results.get(string)
        if row is None:
            row = make_row(RESULTS.dtype, string=string, **result._asdict())
            self._writer.mark_running()
            self.barrier.store(partial(self._writer.put_result, row))
        self._digest.add_result(string, row)

    def _store_generation(self, summary: GenerationSummary) -> None:
        """Store a generation, and wait until it is on the disc."""
        self.tally.best = best_of(summary)
        if summary.generation in self._stored_generations:
            return
        self.tally.close_generation()
        simulated = self.tally.searched_samples
        commit = partial(
            self._commit,
            generation=summary.generation,
            best_string=summary.best,
            best_objective=summary.objective,
            best_standard_error=summary.standard_error,
            mean_of_top=summary.mean_of_top,
            top=self._top,
            evaluations=summary.evaluations,
            samples_used=summary.samples_used,
            samples_simulated=simulated,
            seconds=self.tally.seconds_of_legs,
            population=summary.population,
            digest=self._digest.digest(),
        )
        self.barrier.store(commit)
        self._display.generation(summary, self._generations, simulated, self.tally.rate)

    def _commit(self, **row: Any) -> None:
        self._writer.mark_running()
        self._writer.put_generation(**row)
        self._writer.sync()
        self.synced()


def decided_again(
    decisions: Iterable[Decision], stop: StopRequest, show: Callable[[], None]
) -> Iterator[Decision]:
    """Yield decisions until somebody asks to stop; all of a generation, which may take seconds.

    Parameters
    ----------
    decisions
        Decisions of stored samples.
    stop
        Whether to stop.
    show
        Called once where they take long.
    """
    begun, is_shown = time.monotonic(), False
    for decision in decisions:
        yield decision
        match decision:
            case GenerationSummary():
                if stop.reason:
                    return
                if not is_shown and time.monotonic() - begun > NOTICE_AFTER:
                    is_shown = True
                    show()
