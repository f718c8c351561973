"""The loop of rank 0: hand out samples, judge what comes back, store it, stop in time."""

import time
from functools import cached_property
from typing import Final, NamedTuple

from agglom_mpi.database.reader import CampaignFile
from agglom_mpi.database.writer import CampaignWriter
from agglom_mpi.exit_codes import FAILURE, FINISHED, STOPPED
from agglom_mpi.farm.books import Books, Stored, Watcher
from agglom_mpi.farm.clock import StopRequest
from agglom_mpi.farm.crew import Crew, Delivery
from agglom_mpi.farm.gallery import Gallery
from agglom_mpi.farm.messages import POLL
from agglom_mpi.farm.scheduler import Scheduler
from agglom_mpi.farm.work import Work
from agglom_mpi.simulation.outcome import EXCEPTION, FAILED, REASONS

TICK: Final = 0.5
"""Seconds between updates of the display."""


class End(NamedTuple):
    """How a run ended: exit code, state for the file, and why in words."""

    code: int
    state: str
    reason: str


class Master:
    """One leg of a campaign, or of other work.

    Parameters
    ----------
    work, file, writer
        What to run, and where it is kept.
    watcher
        Shown how it goes.
    """

    def __init__(
        self, work: Work, file: CampaignFile, writer: CampaignWriter, watcher: Watcher
    ) -> None:
        self._work = work
        self._writer = writer
        self._watcher = watcher
        self._stored = Stored(file)
        self._failing: set[int] = set()
        self.books = Books(writer, self._stored, watcher, work.top)
        self.inversion = work.inversion(self._stored.restore, self.books)

    @cached_property
    def gallery(self) -> Gallery:
        """The pictures that are asked for, once all is decided."""
        assert self.inversion.finished
        return Gallery(self._work.pictures(self.inversion), self._writer, self.inversion.parameters)

    def replay(self) -> bool:
        """Decide again what the stored samples decide; whether that finishes the campaign."""
        for row in self._stored.samples:
            self.inversion.accept(int(row["string"]), int(row["sample"]), row)
        self.books.failures = int((self._stored.samples["reason"] == EXCEPTION).sum())
        self.inversion.start()
        return self.inversion.finished and self.gallery.complete

    def run(self, crew: Crew, stop: StopRequest) -> End:
        """Simulate until the campaign is finished or something asks to stop."""
        pairs = self._stored.samples[["string", "sample"]].tolist()
        scheduler = Scheduler(self.inversion, crew.size, pairs)
        self.books.begun = time.monotonic()
        shown = time.monotonic()
        while not self.inversion.finished:
            if stop.reason:
                return End(STOPPED, "stopped", stop.reason)
            if self.books.failures >= self._work.max_failures:
                return End(FAILURE, "failed", f"{self.books.failures} samples raised errors")
            self._hand_out(crew, scheduler)
            for delivery in crew.deliveries(POLL):
                self._take(scheduler, delivery)
            self._writer.flush_due()
            if time.monotonic() - shown > TICK:
                shown = time.monotonic()
                self._tick(crew, shown)
        return self._take_pictures(crew, stop)

    def _take_pictures(self, crew: Crew, stop: StopRequest) -> End:
        """Let all ranks take the pictures that are asked for and not there yet."""
        tasks = self.gallery.open()
        if len(tasks):
            samples = f"{len(tasks)} sample{'' if len(tasks) == 1 else 's'}"
            self._watcher.message(f"taking pictures of {samples}, {tasks['frames'][0]} of each")
        for number in range(len(tasks)):
            crew.send(number % crew.size, tasks[number : number + 1])
        while not self.gallery.done:
            if stop.reason:
                return End(STOPPED, "stopped", stop.reason)
            for delivery in crew.deliveries(POLL):
                for failure in delivery.failures:
                    self._report_exception(failure)
                    self.gallery.give_up(int(failure["string"]), int(failure["sample"]))
                self._count(delivery)
            self._writer.flush_due()
        return End(FINISHED, "finished", self.finished_because)

    def wind_up(self, crew: Crew, code: int) -> None:
        """Stop all ranks with an exit code, and store and judge what they still have."""
        for delivery in crew.dismiss(code):
            for failure in delivery.failures:
                self._report_exception(failure)
            self._count(delivery)
            for row in delivery.results:
                self.inversion.accept(int(row["string"]), int(row["sample"]), row)
        self.books.finish()

    def _hand_out(self, crew: Crew, scheduler: Scheduler) -> None:
        for _ in range(2):
            for rank in range(crew.size):
                tasks = scheduler.assign(rank)
                if len(tasks):
                    crew.send(rank, tasks)

    def _take(self, scheduler: Scheduler, delivery: Delivery) -> None:
        for failure in delivery.failures:
            self._report_exception(failure)
        self._count(delivery)
        for row in delivery.results:
            string, sample = int(row["string"]), int(row["sample"])
            scheduler.returned(delivery.rank, string, sample, float(row["seconds"]))
            if row["state"] == FAILED:
                self._count_failure(row)
            self.inversion.accept(string, sample, row)

    def _count(self, delivery: Delivery) -> None:
        """Store what a rank sent, or take note that it does so itself."""
        if len(delivery.results) or delivery.finals is not None:
            writes = delivery.rank if self._writer.shared and delivery.rank else None
            self.books.simulated(delivery.results, delivery.finals, writes)
        if delivery.frames is not None:
            self.gallery.hang(delivery.frames)
        if delivery.written:
            self.books.written(delivery.rank, delivery.written)

    def _count_failure(self, row) -> None:  # type: ignore[no-untyped-def]
        if row["reason"] == EXCEPTION:
            self.books.failures += 1
        elif row["string"] not in self._failing:
            self._failing.add(int(row["string"]))
            self._watcher.message(
                f"string {row['string']} sample {row['sample']} failed: {REASONS[row['reason']]}; "
                "more of this string are counted, not shown"
            )

    def _report_exception(self, failure) -> None:  # type: ignore[no-untyped-def]
        host, text = failure["host"].decode(), failure["text"].decode()
        self._writer.put_failure(
            int(failure["string"]),
            int(failure["sample"]),
            rank=int(failure["rank"]),
            host=host,
            text=text,
        )
        self._watcher.error(
            f"rank {failure['rank']} on {host}: string {failure['string']} sample "
            f"{failure['sample']} raised\n{text}"
        )

    def _tick(self, crew: Crew, now: float) -> None:
        elapsed = now - self.books.begun
        busy = self.books.busy_seconds / (elapsed * crew.size)
        samples = len(self._stored.samples) + self.books.samples
        self._watcher.tick(samples, self.books.rate, busy, len(self.inversion.live))

    @property
    def finished_because(self) -> str:
        """Why the search ended, in words."""
        return self._work.finished_because(self.inversion)
