"""A campaign that runs elsewhere, followed by looking at its file."""

import time
from typing import Final

import numpy as np

from agglom_mpi.analysis.resimulation import recorded_campaign
from agglom_mpi.display.display import Display
from agglom_mpi.display.progress import Best, Progress
from agglom_mpi.display.remaining_time import (
    DurationStatistics,
    RemainingTime,
    in_units,
    remaining_by_work,
    remaining_in_turns,
)
from agglom_mpi.errors import FAILURE, FINISHED, INTERRUPTED, STOPPED
from agglom_mpi.outcome import FAILED
from agglom_mpi.search.decisions import GenerationSummary
from agglom_mpi.storage.reader import CampaignData

CODES: Final = {"finished": FINISHED, "stopped": STOPPED, "failed": FAILURE}
"""Exit codes by how the run ended, the same as its own."""

SHORTEST: Final = 1.0
"""Seconds between looks."""

SHARE: Final = 0.05
"""Share of the time that looking may take."""

SAMPLE_COLUMNS: Final = ("string", "sample", "state", "seconds", "finished")
"""Columns of `/samples` that are kept, a fifth of a row."""

PATIENCE: Final = 10.0
"""Seconds, beyond three times the longest sample, that a run may write nothing."""


def follow(file: CampaignData) -> int:
    """Show how a campaign goes until its run ends; the exit code, that of the run.

    A run that was killed says nothing: it is told since when nothing has changed, and waited for
    another one to go on with it.
    """
    display = Display()
    try:
        with display:
            follower = Follower(file)
            data = follower.data
            while True:
                looked = time.monotonic()
                progress = follower.look(time.time())
                for summary in follower.new_generations():
                    display.generation(
                        summary, data.generation_capacity, progress.samples, progress.rate or 0.0
                    )
                if len(data.legs()) and data.status().state in CODES:
                    return CODES[data.status().state]
                display.tick(progress)
                time.sleep(max(SHORTEST, (time.monotonic() - looked) / SHARE))
    except KeyboardInterrupt:
        return INTERRUPTED


class Follower:
    """What a campaign file says of the run that writes it, look by look.

    Attributes
    ----------
    data
        What is in the file, of which each look reads little more than what is new.
    """

    def __init__(self, file: CampaignData) -> None:
        self.data = CampaignData(file.path, file.attributes, SAMPLE_COLUMNS)
        self._campaign = recorded_campaign(file)
        self._told = max(0, len(self.data.generation_rows()) - 1)

    def new_generations(self) -> list[GenerationSummary]:
        """Return generations not told yet; of those there were at the beginning the last."""
        new = self.data.generation_rows()[self._told :]
        self._told += len(new)
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
            )
            for row in new
        ]

    def look(self, now: float) -> Progress:
        """Read what is new at the Unix time `now`, and tell how far the run is."""
        data = self.data
        data.refresh()
        legs, samples, status = data.legs(), data.all_sample_rows(), data.status()
        if not len(legs):
            note = "the run has not begun"
            return Progress(0, data.generation_capacity, "generations", 0.0, 0, note=note)
        leg = legs[-1]
        ours = samples[samples["finished"] >= leg["started"]]
        changed = max(status.updated, leg["started"], samples["finished"].max(initial=0.0))
        silent = now - changed > PATIENCE + 3.0 * ours["seconds"].max(initial=0.0)
        ongoing = changed if silent else now
        end = ongoing if status.state == "running" else status.updated
        elapsed = max(1e-9, end - leg["started"])
        progress = Progress(
            done=0,
            total=0,
            unit="",
            elapsed=elapsed,
            samples=len(samples),
            failed=int((samples["state"] == FAILED).sum()) + len(data.timed_out),
            best=self._best(),
        )
        if len(ours):
            busy = float(ours["seconds"].sum()) / (elapsed * leg["ranks"])
            progress = progress._replace(rate=len(ours) / elapsed, busy=busy)
        progress = self._in_phase(progress, ours, elapsed)
        if silent and status.state == "running":
            progress = progress._replace(note=silence(changed, now), left=None)
        return progress

    def _best(self) -> Best | None:
        generations = self.data.generation_rows()
        if not len(generations):
            return None
        row = generations[-1]
        names = ("best_string", "best_objective", "best_standard_error", "mean_of_top")
        return Best(*(row[name].item() for name in names))

    def _in_phase(self, progress: Progress, ours: np.ndarray, elapsed: float) -> Progress:
        """Say how far the search is or, once it is over, what comes after it."""
        final, frames = self._campaign.final, self._campaign.output.frames
        fresh = self.data.all_sample_rows()["sample"] >= self.data.fresh_from
        if not self._searched(fresh):
            return self._in_search(progress, elapsed)
        total, done = 0, int(fresh.sum())
        if final is not None:
            room = self.data.max_samples - self.data.fresh_from
            total = final.strings * min(final.samples, room)
        if done < total or frames is None:
            left = self._of_fresh(ours, total - done)
            return progress._replace(
                done=min(done, total), total=total, unit="fresh samples", left=left
            )
        strings, samples = self._campaign.max_framed
        total = strings * samples * frames.count
        return progress._replace(done=self.data.frame_count, total=total, unit="pictures")

    def _searched(self, fresh: np.ndarray) -> bool:
        """Whether the search is over; if --generations ended it, only fresh samples say so."""
        generations, samples = self.data.generation_rows(), self.data.all_sample_rows()
        if not len(generations):
            return False
        target = self._campaign.stopping.target
        if target is not None and generations[-1]["mean_of_top"] <= target.objective:
            return True
        finished = samples["finished"]
        later = fresh.any() and finished[fresh].max() >= finished[~fresh].max(initial=0.0)
        return bool(later) or len(generations) == self.data.generation_capacity

    def _in_search(self, progress: Progress, elapsed: float) -> Progress:
        generations, room = self.data.generation_rows(), self.data.generation_capacity
        done, whole = len(generations), self.data.legs()[:-1]
        before = float(np.nansum(whole["stopped"] - whole["started"]))
        ends = generations["seconds"][generations["seconds"] > before]
        laps = DurationStatistics(np.diff(ends, prepend=before).tolist())
        lap = elapsed - (float(ends[-1]) - before if len(ends) else 0.0)
        strings = self.data.string_rows()
        proposed = strings["string"][strings["generation"] == done]
        return progress._replace(
            done=done,
            total=room,
            unit="generations",
            strings_open=len(np.setdiff1d(proposed, self.data.result_rows()["string"])),
            left=remaining_in_turns(laps, room - done, max(0.0, lap)),
            at_most=self._campaign.stopping.target is not None,
        )

    def _of_fresh(self, ours: np.ndarray, rest: int) -> RemainingTime | None:
        """Forecast the rest of the fresh samples, in the leg's own pace."""
        mine = ours[ours["sample"] >= self.data.fresh_from]
        if not len(mine):
            return None
        begun = float((mine["finished"] - mine["seconds"]).min())
        took = float(mine["finished"].max()) - begun
        return remaining_by_work(
            DurationStatistics(mine["seconds"].tolist()), len(mine), rest, took
        )


def silence(since: float, now: float) -> str:
    """Say since when nothing has changed."""
    clock = time.strftime(
        "%H:%M:%S" if now - since < 43200.0 else "%Y-%m-%d %H:%M", time.localtime(since)
    )
    return f"nothing has changed since {clock}, for {in_units(now - since, 1)}: was it killed?"
