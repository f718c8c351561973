"""Progress of a campaign that another process runs, read from its file."""

import time
from pathlib import Path
from typing import Final

import numpy as np

from agglom_mpi.analysis.ranking import ranks_itself
from agglom_mpi.display.progress import (
    DurationStatistics,
    RemainingTime,
    RunProgress,
    best_of,
    format_rounded,
    remaining_by_work,
    remaining_in_turns,
)
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import FAILURE, FINISHED, INTERRUPTED, STOPPED
from agglom_mpi.outcome import FAILED
from agglom_mpi.search.proposals import GenerationSummary
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

EXIT_CODES: Final = {"finished": FINISHED, "stopped": STOPPED, "failed": FAILURE}
"""Exit codes by the state at the end of the run, the same as the run's own."""

SAMPLE_COLUMNS: Final = ("string", "sample", "state", "seconds", "finished")
"""Columns of `/samples` that are kept, a fifth of a row."""

MIN_INTERVAL: Final = 1.0
"""Time between readings of the file, s, at least."""

READING_SHARE: Final = 0.05
"""Share of the time that reading may take."""

SILENCE: Final = 10.0
"""Time, beyond three times the longest sample, for which a run may write nothing, s."""


def wait_for_file(path: Path) -> bool:
    """Wait until a run has made its file; return False after Ctrl-C."""
    try:
        if not path.exists():
            Display().message(f"{path} does not exist yet: waiting for the run to begin")
        while not path.exists():
            time.sleep(MIN_INTERVAL)
    except KeyboardInterrupt:
        return False
    return True


def follow(file: CampaignData) -> int:
    """Show the progress of a campaign until its run ends, and return the exit code of the run.

    After Ctrl-C it is `INTERRUPTED`. The file does not say that a run was killed: then this shows
    since when nothing has changed, and waits for another run to continue the campaign.
    """
    display = Display()
    try:
        with display:
            source = FileProgress(file)
            while True:
                begun = time.monotonic()
                progress = source.read(time.time())
                for summary in source.new_generations():
                    display.generation(
                        summary,
                        source.data.generation_capacity,
                        progress.samples,
                        progress.rate or 0.0,
                    )
                if len(source.data.legs()) and source.data.status().state in EXIT_CODES:
                    return EXIT_CODES[source.data.status().state]
                display.tick(progress)
                time.sleep(max(MIN_INTERVAL, (time.monotonic() - begun) / READING_SHARE))
    except KeyboardInterrupt:
        return INTERRUPTED


class FileProgress:
    """Progress of a run as its campaign file shows it.

    Attributes
    ----------
    data
        Rows of the file as they were read last; each reading takes little more than new rows.
    """

    def __init__(self, file: CampaignData) -> None:
        self.data = CampaignData(file.path, file.attributes, SAMPLE_COLUMNS, file.allow_code)
        self._campaign = recorded_campaign(file)
        self._shown = max(0, len(self.data.generation_rows()) - 1)

    def new_generations(self) -> list[GenerationSummary]:
        """Return the generations since the last call; at first the last generation alone."""
        new = self._generations(self._shown)
        self._shown += len(new)
        return new

    def _generations(self, first: int) -> list[GenerationSummary]:
        """Return the generations from a place among them on."""
        return [
            GenerationSummary(
                int(row["generation"]),
                int(row["best_string"]),
                float(row["best_objective"]),
                float(row["best_standard_error"]),
                float(row["mean_of_top"]),
                row["population"],
                int(row["evaluations"]),
                int(row["samples_used"]),
                ranks_itself(self.data),
            )
            for row in self.data.generation_rows()[first:]
        ]

    def read(self, now: float) -> RunProgress:
        """Read new rows at the Unix time `now`, s, and return the progress of the run."""
        data = self.data
        data.refresh()
        legs, samples, status = data.legs(), data.all_sample_rows(), data.status()
        if not len(legs):
            note = "the run has not begun"
            return RunProgress(0, data.generation_capacity, "generations", 0.0, 0, note=note)
        leg = legs[-1]
        ours = samples[samples["finished"] >= leg["started"]]
        changed = max(status.updated, leg["started"], samples["finished"].max(initial=0.0))
        silent = now - changed > SILENCE + 3.0 * ours["seconds"].max(initial=0.0)
        ongoing = changed if silent else now
        end = ongoing if status.state == "running" else status.updated
        elapsed = max(1e-9, end - leg["started"])
        progress = RunProgress(
            done=0,
            total=0,
            unit="",
            elapsed=elapsed,
            samples=len(samples),
            failed=int((samples["state"] == FAILED).sum()) + len(data.timed_out),
            best=best_of(last[0]) if (last := self._generations(-1)) else None,
        )
        if len(ours):
            busy = float(ours["seconds"].sum()) / (elapsed * leg["ranks"])
            progress = progress._replace(rate=len(ours) / elapsed, busy=busy)
        progress = self._in_phase(progress, ours, elapsed)
        if silent and status.state == "running":
            note = silence_note(changed, now, killed=live_status(data).state != "running")
            progress = progress._replace(note=note, remaining=None)
        return progress

    def _in_phase(self, progress: RunProgress, ours: np.ndarray, elapsed: float) -> RunProgress:
        """Return the progress of the search or, once it is over, of the stage after it."""
        final, frames = self._campaign.final, self._campaign.output.frames
        fresh = self.data.all_sample_rows()["sample"] >= self.data.fresh_from
        if not self._searched(fresh):
            return self._in_search(progress, elapsed)
        total, done = 0, int(fresh.sum())
        if final is not None:
            room = self.data.max_samples - self.data.fresh_from
            total = final.strings * min(final.samples, room) * len(final.volumes)
            done += self.data.volume_count
        if done < total or frames is None:
            # Samples of larger volumes take longer than those that the forecast would rest on.
            known = final is not None and not final.larger
            remaining = self._remaining_fresh(ours, total - done) if known else None
            return progress._replace(
                done=min(done, total), total=total, unit="fresh samples", remaining=remaining
            )
        strings, samples = self._campaign.max_framed
        total = strings * samples * frames.count
        return progress._replace(done=self.data.frame_count, total=total, unit="pictures")

    def _searched(self, fresh: np.ndarray) -> bool:
        """Return whether the search is over; after --generations, only fresh samples show it."""
        generations, samples = self.data.generation_rows(), self.data.all_sample_rows()
        if not len(generations):
            return False
        criteria = self._campaign.stopping.criteria.values()
        if any(criterion.is_seen_in(generations[-1]) for criterion in criteria):
            return True
        finished = samples["finished"]
        later = fresh.any() and finished[fresh].max() >= finished[~fresh].max(initial=0.0)
        return bool(later) or len(generations) == self.data.generation_capacity

    def _in_search(self, progress: RunProgress, elapsed: float) -> RunProgress:
        """Return the progress of the search after `elapsed` seconds of this leg."""
        generations, capacity = self.data.generation_rows(), self.data.generation_capacity
        done, earlier = len(generations), self.data.legs()[:-1]
        before = float(np.nansum(earlier["stopped"] - earlier["started"]))
        ends = generations["seconds"][generations["seconds"] > before]
        durations = DurationStatistics(np.diff(ends, prepend=before).tolist())
        present = elapsed - (float(ends[-1]) - before if len(ends) else 0.0)
        strings = self.data.string_rows()
        proposed = strings["string"][strings["generation"] == done]
        return progress._replace(
            done=done,
            total=capacity,
            unit="generations",
            strings_open=len(np.setdiff1d(proposed, self.data.result_rows()["string"])),
            remaining=remaining_in_turns(durations, capacity - done, max(0.0, present)),
            may_end_sooner=bool(self._campaign.stopping.criteria),
        )

    def _remaining_fresh(self, ours: np.ndarray, rest: int) -> RemainingTime | None:
        """Forecast the remaining fresh samples by the rate of this leg."""
        mine = ours[ours["sample"] >= self.data.fresh_from]
        if not len(mine):
            return None
        begun = float((mine["finished"] - mine["seconds"]).min())
        took = float(mine["finished"].max()) - begun
        return remaining_by_work(
            DurationStatistics(mine["seconds"].tolist()), len(mine), rest, took
        )


def silence_note(since: float, now: float, *, killed: bool = False) -> str:
    """Return the note that nothing has changed between two Unix times, s; or that it was killed."""
    clock = time.strftime(
        "%H:%M:%S" if now - since < 43200.0 else "%Y-%m-%d %H:%M", time.localtime(since)
    )
    duration = format_rounded(now - since, 1)
    cause = "the run was killed" if killed else "was it killed?"
    return f"nothing has changed since {clock}, for {duration}: {cause}"
