"""The loop of rank 0: hand out samples, judge what comes back, store it, stop in time."""

import time
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.database.reader import CampaignFile
from agglom_mpi.database.schema import FAILURE_CAPACITY, TOOK_TOO_LONG
from agglom_mpi.database.table import unbroken
from agglom_mpi.database.writer import CampaignWriter
from agglom_mpi.exit_codes import FAILURE, FINISHED, STOPPED
from agglom_mpi.farm.books import Books, Stored, Watcher
from agglom_mpi.farm.chores import Chore
from agglom_mpi.farm.clock import StopRequest
from agglom_mpi.farm.crew import Crew, Delivery
from agglom_mpi.farm.errands import Errands
from agglom_mpi.farm.gallery import Gallery
from agglom_mpi.farm.lanes import Piece
from agglom_mpi.farm.messages import NOT_NEEDED, SILENT_AFTER, final_results
from agglom_mpi.farm.outlook import of_chore, of_search
from agglom_mpi.farm.reestimation import Reestimation
from agglom_mpi.farm.replay import stored_outcomes
from agglom_mpi.farm.scheduler import Scheduler
from agglom_mpi.farm.work import Work
from agglom_mpi.report.progress import Progress
from agglom_mpi.simulation.outcome import (
    EXCEPTION,
    FAILED,
    REASONS,
    TIMED_OUT,
    measured,
)

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
        self._fresh = file.fresh_from, file.max_samples
        self._failing: set[int] = set()
        self._told_full = False
        self._forgotten = False  # whether samples took too long that the file cannot tell of
        self._ticked, self._news = time.monotonic(), True
        self.silent: set[int] = set()
        self.books = Books(writer, self._stored, watcher, work.top, work.room.generations)
        self.inversion = work.inversion(self._stored.restore, self.books, background=True)

    @cached_property
    def reestimation(self) -> Reestimation:
        """The fresh samples of the best strings, once all is decided."""
        assert self.inversion.finished
        finalists, known = self._work.finalists(self.inversion), self._stored.estimated
        return Reestimation(finalists, *self._fresh, known, self.inversion.parameters)

    @cached_property
    def gallery(self) -> Gallery:
        """The pictures that are asked for, once all is decided."""
        assert self.inversion.finished
        return Gallery(self._work.pictures(self.inversion), self._writer, self.inversion.parameters)

    def replay(self) -> bool:
        """Decide again what the stored samples decide; whether that finishes the campaign."""
        for stored in stored_outcomes(self._stored.samples, self._stored.timed_out):
            self.inversion.accept(*stored)
        self.books.failures = self._stored.failures
        self.inversion.start()
        return self.inversion.finished and self.reestimation.complete and self.gallery.complete

    def run(self, crew: Crew, stop: StopRequest) -> End:
        """Simulate until the campaign is finished or something asks to stop."""
        self._crew = crew
        self._scheduler = Scheduler(
            self.inversion,
            crew.size,
            [*self._stored.samples[["string", "sample"]].tolist(), *self._stored.timed_out],
            [result.samples_used for result in self.inversion.results.values()],
        )
        self.books.begin()
        while not self.inversion.finished:
            if end := self._end(stop):
                return end
            self._serve(self._scheduler, self._searched)
            for delivery in crew.deliveries():
                self._take(delivery)
                self._listen(self._scheduler, delivery.rank)
            self._withdraw()
        self._scheduler.finish()
        self._withdraw()
        for chore in (self.reestimation, self.gallery):
            if end := self._carry_out(chore, stop):
                return end
        return End(FINISHED, "finished", self.finished_because)

    def _end(self, stop: StopRequest) -> End | None:
        """Why to end before all is done, if there is a reason."""
        if stop.reason:
            return End(STOPPED, "stopped", stop.reason)
        if self._forgotten or self.books.failures >= self._work.max_failures:
            return self._failed()
        return None

    def _failed(self) -> End:
        if self._forgotten:
            why = "samples took too long, and the file has no room left to tell of them"
            return End(FAILURE, "failed", why)
        return End(FAILURE, "failed", f"{self.books.failures} samples failed with errors")

    def _carry_out(self, chore: Chore, stop: StopRequest) -> End | None:
        """Let all ranks do what is left of a chore; why it is not done, if it is not."""
        if announcement := chore.begin(self._crew.size):
            self._watcher.message(announcement)
        self._news, begun = True, time.monotonic()
        while not chore.done:
            if end := self._end(stop):
                return end
            self._serve(chore.errands, lambda: of_chore(chore, begun, self.books, self._crew.size))
            for delivery in self._crew.deliveries():
                self._take(delivery)
                self._listen(chore.errands, delivery.rank)
        return None

    def _searched(self) -> Progress:
        in_flight = self._scheduler.lanes.samples
        return of_search(self._work, self.inversion, self.books, self._crew.size, in_flight)

    def _serve(self, work: Scheduler | Errands, progress: Callable[[], Progress]) -> None:
        """Hand out tasks if there is news, and do what is due from time to time."""
        now = time.monotonic()
        if self._news:
            self._news = False
            work.pace.turnround = self._crew.turnround
            for rank, tasks in work.assignments(now):
                self._crew.send(rank, tasks)
        self._writer.flush_due()
        if now - self._ticked > TICK:
            away = now - self._ticked > SILENT_AFTER / 2  # this rank itself: mail is unread
            self._ticked, self._news = now, True
            self._watcher.tick(progress())
            work.heard(0, now)
            for rank in () if away else work.clock(now, SILENT_AFTER):
                self._watcher.error(
                    f"{self._named(rank)} has not been heard of for {SILENT_AFTER:g} s; others do "
                    "its work"
                )
                self.silent.add(rank)
                self.books.take_over(rank)

    def _withdraw(self) -> None:
        """Let ranks leave out what has turned out not to be needed."""
        for rank, strings in self._scheduler.withdrawals():
            self._crew.withdraw(rank, strings)

    def _listen(self, work: Scheduler | Errands, rank: int) -> None:
        self._news = True
        if work.heard(rank, time.monotonic()):
            self._watcher.error(f"{self._named(rank)} is back")
        self.silent.discard(rank)

    def _named(self, rank: int) -> str:
        host = self._crew.hosts.get(rank)
        return f"rank {rank}" if host is None else f"rank {rank} on {host}"

    def wind_up(self, crew: Crew, end: End) -> End:
        """Stop all ranks, and store and judge what they still have; the end as it is then."""
        for delivery in crew.dismiss(end.code, self.silent):
            self._take(delivery)
        for rank in crew.missing:
            self.books.take_over(rank)
        self.books.finish()
        return self._failed() if end.code == FAILURE else end

    def _take(self, delivery: Delivery) -> None:
        """Store and judge what a rank sent."""
        for failure in delivery.failures:
            self._report_exception(failure)
            if failure["frames"]:
                self.gallery.give_up(int(failure["string"]), int(failure["sample"]))
                self.gallery.errands.done(delivery.rank)
        if len(delivery.results) or delivery.finals is not None:
            writes = delivery.rank if self._writer.shared and delivery.rank else None
            self.books.simulated(final_results(delivery.results), delivery.finals, writes)
            searched, fresh = self._parted(delivery.results)
            if len(searched):
                self._judge(delivery.rank, searched)
            if len(fresh):
                self._estimate(delivery.rank, fresh)
        if delivery.frames is not None and self.gallery.hang(delivery.frames):
            self.gallery.errands.done(delivery.rank)
        if delivery.written:
            self.books.written(delivery.rank, delivery.written)

    def _parted(self, results: NDArray[np.void]) -> tuple[NDArray[np.void], NDArray[np.void]]:
        """Part results into those that decisions are made from, and fresh samples."""
        if max(results["sample"].tolist(), default=0) < self._fresh[0]:
            return results, results[:0]
        fresh = results["sample"] >= self._fresh[0]
        return results[~fresh], results[fresh]

    def _judge(self, rank: int, results: NDArray[np.void]) -> None:
        """Let decisions be made from what a rank simulated, unless others were first."""
        outcomes = measured(results)
        self.books.left_out(results[results["reason"] == NOT_NEEDED])
        for piece, parts in first_returns(self._scheduler, rank, results):
            for part in parts:
                self.books.counted(results[part])
                first = int(results["sample"][part][0])
                if not self._forgotten:
                    self.inversion.accept(piece.string, first, outcomes[part])
                self._count_failures(results[part])
            self._scheduler.judged(piece.string)

    def _estimate(self, rank: int, results: NDArray[np.void]) -> None:
        """Take fresh samples, of which nothing is decided."""
        for _, parts in first_returns(self.reestimation.errands, rank, results):
            for part in parts:
                self.books.estimated(results[part])
                if not self._forgotten:
                    self.reestimation.take(results[part])
                self._count_failures(results[part])

    def _count_failures(self, rows: NDArray[np.void]) -> None:
        if FAILED in rows["state"].tolist():
            for row in rows[rows["state"] == FAILED]:
                self._count_failure(row)

    def _count_failure(self, row) -> None:  # type: ignore[no-untyped-def]
        if row["reason"] in (EXCEPTION, TIMED_OUT):
            self.books.failures += 1
        elif row["string"] not in self._failing:
            self._failing.add(int(row["string"]))
            self._watcher.message(
                f"string {row['string']} sample {row['sample']} failed: {REASONS[row['reason']]}; "
                "more of this string are counted, not shown"
            )

    def _report_exception(self, failure) -> None:  # type: ignore[no-untyped-def]
        host, text = failure["host"].decode(), failure["text"].decode()
        room = self._writer.has_room_for_failures
        kept = self._writer.put_failure(
            int(failure["string"]),
            int(failure["sample"]),
            rank=int(failure["rank"]),
            host=host,
            text=text,
        )
        says = text if text.startswith(TOOK_TOO_LONG) else f"raised\n{text}"
        self._watcher.error(
            f"rank {failure['rank']} on {host}: string {failure['string']} sample "
            f"{failure['sample']} {says}"
        )
        if not (room or self._told_full):
            self._told_full = True
            self._watcher.error(
                f"{self._writer.path}: has room for {FAILURE_CAPACITY} failures; "
                "more texts are lost"
            )
        self._forgotten |= not kept and text.startswith(TOOK_TOO_LONG)

    @property
    def finished_because(self) -> str:
        """Why the search ended, in words."""
        return self._work.finished_because(self.inversion)


def first_returns(
    work: Scheduler | Errands, rank: int, results: NDArray[np.void]
) -> Iterator[tuple[Piece, list[slice]]]:
    """Pieces that a rank has done, each with where in the results is what nobody did before."""
    begin, done = 0, results["reason"] != NOT_NEEDED
    work.pace.learn(results["seconds"][done].tolist())
    for piece, new in work.returned(rank, done.tolist()):
        check_turn(rank, piece, results[begin])
        places = ((begin + first, count) for first, count in unbroken(new))
        yield piece, [slice(first, first + count) for first, count in places]
        begin += piece.size


def check_turn(rank: int, piece: Piece, row: np.void) -> None:
    """Raise a RuntimeError if a rank sent something else than what it was to do next."""
    sent = int(row["string"]), int(row["sample"])
    if sent != piece[:2]:
        raise RuntimeError(f"rank {rank} sent string and sample {sent}; expected were {piece[:2]}")
