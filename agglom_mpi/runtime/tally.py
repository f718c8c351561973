"""Numbers and times of the samples and generations of a run, for its display and its file."""

import time

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.display.progress import Best, DurationStatistics, RunProgress
from agglom_mpi.outcome import FAILED
from agglom_mpi.runtime.experiment import StageProgress
from agglom_mpi.storage.reader import CampaignData


class RunTally:
    """Count the samples of a leg, and measure how long they and the generations take.

    Parameters
    ----------
    stored
        What earlier legs have written.

    Attributes
    ----------
    samples, busy_seconds, cpu_seconds
        Samples of this leg, and the wall-clock and the processor time of their simulation, in s. A
        rank is busy while it simulates, so that the busy share is one of wall-clock time.
    generation_times, fresh_times
        How long generations and fresh samples of this leg took, in s.
    best
        The best string of the last generation; None before the first one.
    """

    def __init__(self, stored: CampaignData) -> None:
        self.samples = 0
        self.busy_seconds = self.cpu_seconds = 0.0
        self.generation_times = DurationStatistics()
        self.fresh_times = DurationStatistics()
        self.best: Best | None = None
        rows, judged = stored.all_sample_rows(), stored.judged_timed_out
        timed_out = len(judged) + len(stored.fresh_timed_out)
        larger = [stored.volume_rows(volume)["state"] == FAILED for volume in stored.volumes]
        self._failed = int((rows["state"] == FAILED).sum()) + timed_out
        self._failed += sum(int(failed.sum()) for failed in larger)
        self._stored_samples = len(rows) + stored.volume_count
        self._stored_searched = len(stored.searched_samples) + len(judged)
        # Of all earlier legs; of a killed one up to its last generation.
        legs, generations = stored.legs(), stored.generation_rows()
        ended = float(np.nansum(legs["stopped"] - legs["started"]))
        self._stored_seconds = max(ended, float(generations["seconds"].max(initial=0.0)))
        self.begin()

    def begin(self) -> None:
        """Start the clock of this leg."""
        self._begun = self._generation_begun = time.monotonic()

    def close_generation(self) -> None:
        """Note the time of the generation under way, and start the clock of the next one."""
        self.generation_times.add(self.generation_seconds)
        self._generation_begun = time.monotonic()

    @property
    def generation_seconds(self) -> float:
        """Time of the generation under way so far, in s."""
        return time.monotonic() - self._generation_begun

    @property
    def searched_samples(self) -> int:
        """Samples of all legs that decisions may see; of this one all."""
        return self._stored_searched + self.samples

    @property
    def seconds_of_legs(self) -> float:
        """Wall-clock time of all legs, in s."""
        return self._stored_seconds + self._elapsed

    @property
    def rate(self) -> float:
        """Samples per second of this leg."""
        return self.samples / self._elapsed

    @property
    def _elapsed(self) -> float:
        return max(1e-9, time.monotonic() - self._begun)

    def progress(self, ranks: int, in_flight: int, stage: StageProgress) -> RunProgress:
        """Return the progress as far as it is known in every phase of a run."""
        elapsed = self._elapsed
        return RunProgress(
            done=stage.done,
            total=stage.total,
            unit=stage.unit,
            elapsed=elapsed,
            samples=self._stored_samples + self.samples,
            rate=self.rate if self.samples else None,
            busy=self.busy_seconds / (elapsed * ranks) if self.samples else None,
            in_flight=in_flight,
            failed=self._failed,
            best=self.best,
            may_end_sooner=stage.may_end_sooner,
        )

    def count(self, results: NDArray[np.void]) -> None:
        """Count samples, rows of `/samples`, (n,), each once."""
        self.samples += len(results)
        self.add_times(results)
        self._failed += results["state"].tobytes().count(FAILED)

    def count_fresh(self, results: NDArray[np.void]) -> None:
        """Count samples that no decision is made from, (n,), each once."""
        self.count(results)
        for seconds in results["seconds"].tolist():
            self.fresh_times.add(seconds)

    def add_times(self, records: NDArray[np.void]) -> None:
        """Add the times of samples, or of those that parts of tasks have left out, (n,)."""
        self.busy_seconds += float(records["seconds"].sum())
        self.cpu_seconds += float(records["cpu_seconds"].sum())
