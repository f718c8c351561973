"""The loop of rank 0: assign samples, decide by what comes back, record it, stop in time."""

import time
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.completeness import finished_reason
from agglom_mpi.analysis.failed_samples import no_result
from agglom_mpi.analysis.replay import stored_outcomes
from agglom_mpi.display.progress import RunProgress, remaining_by_work, remaining_in_turns
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import FAILURE, FINISHED, STOPPED
from agglom_mpi.formatting import pluralise
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.failures import FailureLog, HangingSamples
from agglom_mpi.runtime.messages import (
    RankMessage,
    RankPart,
    first_returns,
    merged,
    rank_parts,
    storable,
)
from agglom_mpi.runtime.post_stages import FrameStage, PostStage, ReestimationStage
from agglom_mpi.runtime.recorder import RunRecorder, decided_again
from agglom_mpi.runtime.silence import RankWatch
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.worker_pool import WorkerPool
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.scheduling.static_scheduler import StaticScheduler
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.writer import CampaignWriter

FIRST_MESSAGES: Final = 50
"""Number of messages whose costs do not count: what is done for the first time takes longer."""

IDLE_LEGS: Final = 3
"""Number of earlier legs without a finished sample after which a stop is a failure: a batch script
that starts the run again and again would never end."""

TICK: Final = 0.5
"""Seconds between updates of the display."""


class RunEnd(NamedTuple):
    """How a run ended: exit code, state for the file, and the reason as text."""

    code: int
    state: str
    reason: str
    complete: bool = False
    """Whether nothing is left to do, whatever came of it."""


class Coordinator:
    """One leg of an experiment, as rank 0 sees it.

    Parameters
    ----------
    experiment, file, writer
        What to run, and the campaign file that records it.
    display
        Shows the progress.

    Attributes
    ----------
    inversion
        The decisions.
    recorder
        Records them.
    """

    def __init__(
        self,
        experiment: Experiment,
        file: CampaignData,
        writer: CampaignWriter,
        display: Display,
    ) -> None:
        self._experiment = experiment
        self._writer = writer
        self._display = display
        self._stored = file
        self._fresh = file.fresh_from, file.max_samples
        self._may_assign = True
        self._messages = 0  # with results
        self._spent = 0.0  # processor time on messages whose cost is not learnt yet, in s
        self._failures = FailureLog(writer, file, display)
        self.recorder = RunRecorder(
            writer, self._stored, display, experiment.top, experiment.table_sizes.generations
        )
        self.inversion = experiment.inversion(self._stored.restore, background=True)

    @cached_property
    def reestimation(self) -> ReestimationStage:
        """The fresh samples of the best strings; only after the last decision."""
        assert self.inversion.finished
        plan, known = self._experiment.reestimation_plan(self.inversion), self._stored.fresh_keys
        return ReestimationStage(plan, *self._fresh, known, self.inversion.parameters)

    @cached_property
    def frame_stage(self) -> FrameStage:
        """The frames that are asked for; only after the last decision."""
        assert self.inversion.finished
        plan = self._experiment.frame_plan(self.inversion)
        return FrameStage(plan, self._writer, self.inversion.parameters)

    def replay(self, stop: StopRequest) -> bool:
        """Make the decisions of the stored samples again; return whether all work is done.

        Where that takes long, a line says so. A request to stop ends it after a generation; `run`
        then ends at once.
        """
        for samples in stored_outcomes(
            self._stored.searched_samples, self._stored.judged_timed_out
        ):
            self.recorder.record(self.inversion.complete(*samples))
        generations = pluralise(len(self._stored.generation_rows()), "generation")
        notice = f"deciding {generations} again by the stored samples"
        again = decided_again(self.inversion.start(), stop, lambda: self._display.message(notice))
        self.recorder.record(again)
        return self.inversion.finished and self.reestimation.complete and self.frame_stage.complete

    def run(self, pool: WorkerPool, stop: StopRequest) -> RunEnd:
        """Simulate until the experiment is finished or something asks to stop."""
        self._pool = pool
        self._watch = RankWatch(pool.size, pool.hosts, self._display.error, pool.gone)
        self._last_tick = self._watch.now()
        self._hanging = HangingSamples(
            float(self._stored.all_sample_rows()["seconds"].max(initial=0.0)),
            self._experiment.max_seconds,
            self._watch.name_rank,
            self._display.error,
        )
        self._scheduler = Scheduler(
            self.inversion,
            self._propose_ahead,
            pool.size,
            [
                *self._stored.searched_samples[["string", "sample"]].tolist(),
                *self._stored.judged_timed_out,
            ],
            [result.samples_used for result in self.inversion.results.values()],
        )
        self.recorder.tally.begin()
        while not self.inversion.finished:
            if end := self._end(stop):
                return end
            self._serve(self._scheduler, self._search_progress)
        self._scheduler.cancel_all()
        self._cancel()
        for post_stage in (self.reestimation, self.frame_stage):
            if end := self._run_post_stage(post_stage, stop):
                return end
        return self.end

    @property
    def end(self) -> RunEnd:
        """How a run ends that has done all of its work: as failed if no string has a result."""
        if self._experiment.in_vain(self.inversion):
            self._writer.flush()
            self._stored.refresh()
            return RunEnd(FAILURE, "failed", no_result(self._stored), complete=True)
        reason = self._experiment.end_reason(self.inversion)
        room = self._fresh[1] - self._fresh[0]
        stage, frames = self.reestimation, self._writer.frames.count
        reason = finished_reason(reason, *stage.size, frames, room, stage.volumes)
        return RunEnd(FINISHED, "finished", reason, complete=True)

    def shut_down(self, pool: WorkerPool, end: RunEnd) -> RunEnd:
        """Stop all ranks and record what they still report; return the end as it is then."""
        for message in pool.shut_down(end.code, self._watch.silent):
            self._receive([message])
        for rank in pool.missing:
            self.recorder.take_over(rank)
        self.recorder.barrier.finish()
        if end.complete:
            return self.end  # what ranks had not written before is in the file now
        return self._failed() if end.state == "failed" else end

    def _end(self, stop: StopRequest) -> RunEnd | None:
        """Return how to end before all is done, if there is a reason."""
        if stop.reason:
            return self._stopped(stop.reason)
        if self._pool.gone.suspended:
            return self._stopped("rank 0 was suspended, and ranks on other hosts may have ended")
        if self._pool.deserted:
            host = self._pool.hosts[min(self._pool.deserted)]
            return self._stopped(f"the launcher's process on {host} is gone")
        if self._failures.incomplete or self._failures.count >= self._experiment.max_failures:
            return self._failed()
        return None

    def _stopped(self, reason: str) -> RunEnd:
        """Return the end of a run that can go on; as failed if it would never get further."""
        legs = self._stored.legs()[-IDLE_LEGS:]
        idle_legs = (legs["samples"] == 0) & (legs["exit_code"] == STOPPED)  # killed: -1
        if self.recorder.tally.samples or np.count_nonzero(idle_legs) < IDLE_LEGS:
            return RunEnd(STOPPED, "stopped", reason)
        idle = f"{IDLE_LEGS + 1} runs in turn have ended without a finished sample"
        return RunEnd(FAILURE, "stopped", f"{reason}; {idle}: they need more time")

    def _failed(self) -> RunEnd:
        if self._failures.incomplete:
            why = "samples took too long, and the file has no room left to tell of them"
            return RunEnd(FAILURE, "failed", why)
        return RunEnd(
            FAILURE, "failed", f"{pluralise(self._failures.count, 'sample')} failed with errors"
        )

    def _run_post_stage(self, post_stage: PostStage, stop: StopRequest) -> RunEnd | None:
        """Let all ranks do what is left of a stage; return why that was not finished, or None."""
        if announcement := post_stage.begin(self._pool.size):
            self._display.message(announcement)
        self._may_assign, begun = True, time.monotonic()
        while not post_stage.complete:
            if end := self._end(stop):
                return end
            self._serve(post_stage.scheduler, lambda: self._stage_progress(post_stage, begun))
        return None

    def _propose_ahead(self, generations: int) -> Sequence[int]:
        """Record strings of a coming generation before the scheduler assigns their samples."""
        proposed = self.inversion.propose_ahead(generations)
        if proposed is None:
            return ()
        self.recorder.record([proposed])
        return proposed.strings.tolist()

    def _serve(
        self, scheduler: Scheduler | StaticScheduler, progress: Callable[[], RunProgress]
    ) -> None:
        """Assign tasks, receive what has arrived, and learn what that costs this rank."""
        begun = time.thread_time()
        assigned = self._assign(scheduler, progress)
        messages = list(self._pool.poll())
        if messages:
            self._receive(messages)
            self._may_assign = True
            self._watch.hear(scheduler, messages, self._watch.now())
        if scheduler is self._scheduler:
            self._cancel()
        if assigned or messages:  # else nothing but a poll
            self._spent += time.thread_time() - begun
            sizes = [len(message.results) for message in messages if len(message.results)]
            if sizes:
                self._messages += len(sizes)
                if self._messages > FIRST_MESSAGES:
                    scheduler.batch_sizer.learn_cost(self._spent, len(sizes), sum(sizes))
                self._spent = 0.0

    def _assign(
        self, scheduler: Scheduler | StaticScheduler, progress: Callable[[], RunProgress]
    ) -> bool:
        """Assign tasks where anything has changed, and do what is due; return whether any were."""
        now, assigned = self._watch.now(), False
        if self._may_assign:
            self._may_assign = False
            scheduler.batch_sizer.round_trip = self._pool.round_trip
            for rank, tasks in scheduler.assignments(now):
                assigned = True
                self._pool.send(rank, tasks)
        self._writer.flush_due()
        if now - self._last_tick > TICK:
            self._last_tick, self._may_assign = now, True
            self._display.tick(progress())
            if silent := self._watch.check(scheduler, now):
                for rank in silent:
                    self.recorder.take_over(rank)
                self._writer.sync()  # the host may be lost, and this one next
        return assigned

    def _cancel(self) -> None:
        """Let ranks leave out samples that have turned out to be unnecessary."""
        for rank, strings in self._scheduler.cancellations():
            self._pool.cancel(rank, strings)

    def _receive(self, messages: Sequence[RankMessage]) -> None:
        """Record what ranks report, and make the decisions that follow."""
        for message in messages:
            for failure in message.failures:
                self._failures.add_traceback(failure)
                if failure["frames"]:
                    self.frame_stage.give_up(int(failure["string"]), int(failure["sample"]))
                    self.frame_stage.scheduler.done(message.rank)
            if message.under_way is not None:
                self._hanging.check(message.rank, message.under_way)
        together = merged(0, messages)
        if not together.empty:
            self._store(messages, together)
            self._hanging.learn(together.results)
        if len(together.parts):
            self.recorder.tally.add_times(together.parts)
            returned = rank_parts(messages)
            fresh = [each for each in returned if each.part.first >= self._fresh[0]]
            if len(fresh) < len(returned):
                searched = [each for each in returned if each.part.first < self._fresh[0]]
                self._complete(searched, together.results)
            if fresh:
                self._complete_fresh(fresh, together.results)
        for message in messages:
            for rows in message.frames:
                if self.frame_stage.store(rows):
                    self.frame_stage.scheduler.done(message.rank)
            if message.written:
                self.recorder.barrier.written(message.rank, message.written)

    def _store(self, messages: Sequence[RankMessage], together: RankMessage) -> None:
        """Store the samples of messages, except what a rank writes itself."""
        if self._writer.parallel:
            for each in messages:
                rows = storable(each.results)
                self.recorder.store_samples(rows, each.final_particles, each.rank or None)
        else:
            self.recorder.store_samples(storable(together.results), together.final_particles)

    def _complete(self, returned: Sequence[RankPart], rows: NDArray[np.void]) -> None:
        """Make the decisions that follow from samples, unless other ranks were first."""
        strings, parts, rows = first_returns(self._scheduler, returned, rows)
        if parts:
            self.recorder.count(rows)
            if not self._failures.incomplete:
                self.recorder.record(self.inversion.complete_all(rows, parts))
            self._failures.add_samples(rows)
        decides = not (self.inversion.finished or self._failures.incomplete)
        for string, is_ended in strings.items():
            if is_ended and decides and self.inversion.progress(string) is not None:
                raise RuntimeError(f"a rank left out samples of string {string}, which needs more")
            self._scheduler.update(string)

    def _complete_fresh(self, returned: Sequence[RankPart], rows: NDArray[np.void]) -> None:
        """Take fresh samples, which decide nothing."""
        *_, rows = first_returns(self.reestimation.scheduler, returned, rows)
        self.recorder.tally.count_fresh(rows)
        if not self._failures.incomplete:
            self.reestimation.take(rows)
        self._failures.add_samples(rows)

    def _search_progress(self) -> RunProgress:
        tally, stage = self.recorder.tally, self._experiment.stage(self.inversion)
        rest = stage.total - stage.done
        remaining = remaining_in_turns(tally.generation_times, rest, tally.generation_seconds)
        in_flight = self._scheduler.in_flight.samples
        return tally.progress(self._pool.size, in_flight, stage)._replace(
            strings_open=self.inversion.open_count,
            remaining=remaining if stage.in_turns else None,
        )

    def _stage_progress(self, post_stage: PostStage, begun: float) -> RunProgress:
        """Return the progress of a stage that began at a time of the monotonic clock."""
        tally, stage = self.recorder.tally, post_stage.stage
        rest, done = stage.total - stage.done, stage.done - post_stage.done_before
        elapsed = time.monotonic() - begun
        in_flight = post_stage.scheduler.in_flight.samples
        return tally.progress(self._pool.size, in_flight, stage)._replace(
            remaining=remaining_by_work(tally.fresh_times, done, rest, elapsed)
        )
