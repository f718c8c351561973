"""The loop of rank 0: hand out samples, judge what comes back, store it, stop in time."""

import time
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.replay import stored_outcomes
from agglom_mpi.display.progress import Progress
from agglom_mpi.errors import FAILURE, FINISHED, STOPPED
from agglom_mpi.outcome import (
    EXCEPTION,
    FAILED,
    REASONS,
    TIMED_OUT,
    summaries,
)
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.messages import NOT_NEEDED, SILENT_AFTER, storable
from agglom_mpi.runtime.post_stages import FrameStage, PostStage, ReestimationStage
from agglom_mpi.runtime.progress_of_run import of_post_stage, of_search
from agglom_mpi.runtime.recorder import ProgressListener, RunRecorder
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.worker_pool import Delivery, WorkerPool
from agglom_mpi.scheduling.in_flight import SampleRange
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.scheduling.static_scheduler import StaticScheduler
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import FAILURE_CAPACITY, TOOK_TOO_LONG
from agglom_mpi.storage.table import runs_of
from agglom_mpi.storage.writer import CampaignWriter

TICK: Final = 0.5
"""Seconds between updates of the display."""


class RunEnd(NamedTuple):
    """How a run ended: exit code, state for the file, and why in words."""

    code: int
    state: str
    reason: str


class Coordinator:
    """One leg of a campaign, or of other work.

    Parameters
    ----------
    work, file, writer
        What to run, and where it is kept.
    watcher
        Shown how it goes.
    """

    def __init__(
        self,
        work: Experiment,
        file: CampaignData,
        writer: CampaignWriter,
        watcher: ProgressListener,
    ) -> None:
        self._work = work
        self._writer = writer
        self._watcher = watcher
        self._stored = file
        self._fresh = file.fresh_from, file.max_samples
        self._failing: set[int] = set()
        self._told_full = False
        self._forgotten = False  # whether samples took too long that the file cannot tell of
        self._ticked, self._news = time.monotonic(), True
        self.silent: set[int] = set()
        self.recorder = RunRecorder(writer, self._stored, watcher, work.top, work.room.generations)
        self.inversion = work.inversion(self._stored.restore, self.recorder, background=True)

    @cached_property
    def reestimation(self) -> ReestimationStage:
        """The fresh samples of the best strings, once all is decided."""
        assert self.inversion.finished
        finalists, stored = self._work.finalists(self.inversion), self._stored
        known = {*stored.fresh_samples[["string", "sample"]].tolist(), *stored.fresh_timed_out}
        return ReestimationStage(finalists, *self._fresh, known, self.inversion.parameters)

    @cached_property
    def frame_stage(self) -> FrameStage:
        """The pictures that are asked for, once all is decided."""
        assert self.inversion.finished
        return FrameStage(
            self._work.pictures(self.inversion), self._writer, self.inversion.parameters
        )

    def replay(self) -> bool:
        """Decide again what the stored samples decide; whether that finishes the campaign."""
        for stored in stored_outcomes(self._stored.searched_samples, self._stored.judged_timed_out):
            self.inversion.accept(*stored)
        self.inversion.start()
        return self.inversion.finished and self.reestimation.complete and self.frame_stage.complete

    def run(self, pool: WorkerPool, stop: StopRequest) -> RunEnd:
        """Simulate until the campaign is finished or something asks to stop."""
        self._pool = pool
        self._scheduler = Scheduler(
            self.inversion,
            pool.size,
            [
                *self._stored.searched_samples[["string", "sample"]].tolist(),
                *self._stored.judged_timed_out,
            ],
            [result.samples_used for result in self.inversion.results.values()],
        )
        self.recorder.begin()
        while not self.inversion.finished:
            if end := self._end(stop):
                return end
            self._serve(self._scheduler, self._searched)
            for delivery in pool.deliveries():
                self._take(delivery)
                self._listen(self._scheduler, delivery.rank)
            self._withdraw()
        self._scheduler.finish()
        self._withdraw()
        for post_stage in (self.reestimation, self.frame_stage):
            if end := self._carry_out(post_stage, stop):
                return end
        return RunEnd(FINISHED, "finished", self.finished_because)

    def _end(self, stop: StopRequest) -> RunEnd | None:
        """Why to end before all is done, if there is a reason."""
        if stop.reason:
            return RunEnd(STOPPED, "stopped", stop.reason)
        if self._forgotten or self.recorder.failures >= self._work.max_failures:
            return self._failed()
        return None

    def _failed(self) -> RunEnd:
        if self._forgotten:
            why = "samples took too long, and the file has no room left to tell of them"
            return RunEnd(FAILURE, "failed", why)
        return RunEnd(FAILURE, "failed", f"{self.recorder.failures} samples failed with errors")

    def _carry_out(self, post_stage: PostStage, stop: StopRequest) -> RunEnd | None:
        """Let all ranks do what is left of a stage; why it is not done, if it is not."""
        if announcement := post_stage.begin(self._pool.size):
            self._watcher.message(announcement)
        self._news, begun = True, time.monotonic()
        while not post_stage.done:
            if end := self._end(stop):
                return end
            self._serve(
                post_stage.scheduler,
                lambda: of_post_stage(post_stage, begun, self.recorder, self._pool.size),
            )
            for delivery in self._pool.deliveries():
                self._take(delivery)
                self._listen(post_stage.scheduler, delivery.rank)
        return None

    def _searched(self) -> Progress:
        in_flight = self._scheduler.held.samples
        return of_search(self._work, self.inversion, self.recorder, self._pool.size, in_flight)

    def _serve(self, work: Scheduler | StaticScheduler, progress: Callable[[], Progress]) -> None:
        """Hand out tasks if there is news, and do what is due from time to time."""
        now = time.monotonic()
        if self._news:
            self._news = False
            work.pace.turnround = self._pool.turnround
            for rank, tasks in work.assignments(now):
                self._pool.send(rank, tasks)
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
                self.recorder.take_over(rank)

    def _withdraw(self) -> None:
        """Let ranks leave out what has turned out not to be needed."""
        for rank, strings in self._scheduler.withdrawals():
            self._pool.withdraw(rank, strings)

    def _listen(self, work: Scheduler | StaticScheduler, rank: int) -> None:
        self._news = True
        if work.heard(rank, time.monotonic()):
            self._watcher.error(f"{self._named(rank)} is back")
        self.silent.discard(rank)

    def _named(self, rank: int) -> str:
        host = self._pool.hosts.get(rank)
        return f"rank {rank}" if host is None else f"rank {rank} on {host}"

    def wind_up(self, pool: WorkerPool, end: RunEnd) -> RunEnd:
        """Stop all ranks, and store and judge what they still have; the end as it is then."""
        for delivery in pool.dismiss(end.code, self.silent):
            self._take(delivery)
        for rank in pool.missing:
            self.recorder.take_over(rank)
        self.recorder.finish()
        return self._failed() if end.code == FAILURE else end

    def _take(self, delivery: Delivery) -> None:
        """Store and judge what a rank sent."""
        for failure in delivery.failures:
            self._report_exception(failure)
            if failure["frames"]:
                self.frame_stage.give_up(int(failure["string"]), int(failure["sample"]))
                self.frame_stage.scheduler.done(delivery.rank)
        if len(delivery.results) or delivery.finals is not None:
            writes = delivery.rank if self._writer.parallel and delivery.rank else None
            self.recorder.simulated(storable(delivery.results), delivery.finals, writes)
            searched, fresh = self._parted(delivery.results)
            if len(searched):
                self._judge(delivery.rank, searched)
            if len(fresh):
                self._estimate(delivery.rank, fresh)
        if delivery.frames is not None and self.frame_stage.store(delivery.frames):
            self.frame_stage.scheduler.done(delivery.rank)
        if delivery.written:
            self.recorder.written(delivery.rank, delivery.written)

    def _parted(self, results: NDArray[np.void]) -> tuple[NDArray[np.void], NDArray[np.void]]:
        """Part results into those that decisions are made from, and fresh samples."""
        if max(results["sample"].tolist(), default=0) < self._fresh[0]:
            return results, results[:0]
        fresh = results["sample"] >= self._fresh[0]
        return results[~fresh], results[fresh]

    def _judge(self, rank: int, results: NDArray[np.void]) -> None:
        """Let decisions be made from what a rank simulated, unless others were first."""
        outcomes = summaries(results)
        self.recorder.left_out(results[results["reason"] == NOT_NEEDED])
        for piece, parts in first_returns(self._scheduler, rank, results):
            for part in parts:
                self.recorder.counted(results[part])
                first = int(results["sample"][part][0])
                if not self._forgotten:
                    self.inversion.accept(piece.string, first, outcomes[part])
                self._count_failures(results[part])
            self._scheduler.judged(piece.string)

    def _estimate(self, rank: int, results: NDArray[np.void]) -> None:
        """Take fresh samples, of which nothing is decided."""
        for _, parts in first_returns(self.reestimation.scheduler, rank, results):
            for part in parts:
                self.recorder.estimated(results[part])
                if not self._forgotten:
                    self.reestimation.take(results[part])
                self._count_failures(results[part])

    def _count_failures(self, rows: NDArray[np.void]) -> None:
        if FAILED in rows["state"].tolist():
            for row in rows[rows["state"] == FAILED]:
                self._count_failure(row)

    def _count_failure(self, row) -> None:  # type: ignore[no-untyped-def]
        if row["reason"] in (EXCEPTION, TIMED_OUT):
            self.recorder.failures += 1
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
    work: Scheduler | StaticScheduler, rank: int, results: NDArray[np.void]
) -> Iterator[tuple[SampleRange, list[slice]]]:
    """Pieces that a rank has done, each with where in the results is what nobody did before."""
    begin, done = 0, results["reason"] != NOT_NEEDED
    work.pace.learn(results["seconds"][done].tolist())
    for piece, new in work.returned(rank, done.tolist()):
        check_turn(rank, piece, results[begin])
        places = ((begin + first, count) for first, count in runs_of(new))
        yield piece, [slice(first, first + count) for first, count in places]
        begin += piece.size


def check_turn(rank: int, piece: SampleRange, row: np.void) -> None:
    """Raise a RuntimeError if a rank sent something else than what it was to do next."""
    sent = int(row["string"]), int(row["sample"])
    if sent != piece[:2]:
        raise RuntimeError(f"rank {rank} sent string and sample {sent}; expected were {piece[:2]}")
