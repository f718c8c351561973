"""Samples that failed, and those that may never end: counted, reported, their tracebacks stored."""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.failed_samples import cause_of
from agglom_mpi.display.run_display import Display
from agglom_mpi.outcome import FAILED, REASONS, FailureReason
from agglom_mpi.runtime.abort_flag import SampleUnderWay
from agglom_mpi.runtime.messages import storable
from agglom_mpi.scheduling.interface import volume_string
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import FAILURE_CAPACITY, TOOK_TOO_LONG
from agglom_mpi.storage.writer import CampaignWriter

FACTOR: Final = 20.0
"""Time of a sample relative to the longest one so far after which it is reported."""

MIN_SECONDS: Final = 10.0
"""Minimum time, s, after which a sample is reported."""

FIRST_SECONDS: Final = 300.0
"""Time, s, after which a sample is reported while the file has none to compare it with."""


class HangingSamples:
    """Report samples that take `FACTOR` times as long as the longest one, and again at twice that.

    Parameters
    ----------
    longest
        Time of the longest sample in the file, s; 0 if it has none.
    max_seconds
        Time after which a sample is ended, s; None without a limit.
    name_rank
        Returns the name of a rank and its host.
    show
        Shows one line.
    """

    def __init__(
        self,
        longest: float,
        max_seconds: float | None,
        name_rank: Callable[[int], str],
        show: Callable[[str], None],
    ) -> None:
        self._longest = longest
        self._max_seconds = max_seconds
        self._name_rank = name_rank
        self._show = show
        self._reported: dict[int, tuple[tuple[int, int], int]] = {}  # sample, how often; by rank

    def learn(self, rows: NDArray[np.void]) -> None:
        """Learn the times of samples, rows of `/samples`, (n,)."""
        if len(rows) and rows["seconds"].max() > self._longest:
            finished = storable(rows)  # not one that was ended early
            self._longest = max(self._longest, float(finished["seconds"].max(initial=0.0)))

    def check(self, rank: int, sample: SampleUnderWay) -> None:
        """Report the sample that a rank simulates if it has taken too long."""
        key = sample.string, sample.sample
        before, times = self._reported.get(rank, (key, 0))
        times = times if before == key else 0
        limit = max(MIN_SECONDS, FACTOR * self._longest) if self._longest else FIRST_SECONDS
        if sample.seconds <= limit * 2**times:
            return
        while sample.seconds > limit * 2**times:
            times += 1
        self._reported[rank] = key, times
        most, compared = self._max_seconds, "no sample is finished yet"
        if self._longest:
            compared = f"the longest sample so far took {self._longest:.2g} s"
        if most is None or sample.seconds < most:
            remedy = " ends samples that take too long, unless they are in a function of your own"
        else:
            remedy = f", {most:g} s, does not end it: it is in a function that does not return"
        self._show(
            f"{self._name_rank(rank)}: string {volume_string(sample.string).text} sample "
            f"{sample.sample} has been under way for {sample.seconds:.0f} s, and {compared}; "
            f"stopping.max_seconds{remedy}"
        )


class FailureLog:
    """Count failed samples, and store and show why they failed.

    Parameters
    ----------
    writer
        Of the campaign file.
    stored
        What earlier legs have written.
    display
        Shows every timeout, the first exception of each cause, and the first physical failure of a
        string.

    Attributes
    ----------
    count
        Samples of all legs that raised or took too long.
    incomplete
        Whether a sample took too long and the file has no room left to record it: from then on no
        decision may be made, as none could be made again.
    """

    def __init__(self, writer: CampaignWriter, stored: CampaignData, display: Display) -> None:
        tables = [stored.all_sample_rows(), *map(stored.volume_rows, stored.volumes)]
        raised = sum(int((rows["reason"] == FailureReason.EXCEPTION).sum()) for rows in tables)
        self.count = raised + len(stored.judged_timed_out) + len(stored.fresh_timed_out)
        self.incomplete = False
        self._writer = writer
        self._display = display
        self._strings: set[int] = set()  # with a physical failure that was shown
        self._causes: set[str] = set()  # of exceptions that were shown
        self._full_shown = False

    def add_samples(self, rows: NDArray[np.void]) -> None:
        """Count the failed ones among samples, rows of `/samples`, (n,)."""
        if FAILED not in rows["state"].tobytes():
            return
        for row in rows[rows["state"] == FAILED]:
            if row["reason"] in (FailureReason.EXCEPTION, FailureReason.TIMED_OUT):
                self.count += 1
            elif row["string"] not in self._strings:
                self._strings.add(int(row["string"]))
                name = volume_string(int(row["string"])).text
                self._display.message(
                    f"string {name} sample {row['sample']} failed: "
                    f"{REASONS[row['reason']]}; more of this string are counted, not shown"
                )

    def add_traceback(self, failure: np.void) -> None:
        """Store and show an exception or timeout, a record of `FAILED_SAMPLE`."""
        host, text = failure["host"].decode(), failure["text"].decode()
        room = self._writer.log.has_room_for_failures
        kept = self._writer.log.put_failure(
            int(failure["string"]),
            int(failure["sample"]),
            rank=int(failure["rank"]),
            host=host,
            text=text,
        )
        self._show(failure, host, text)
        if not (room or self._full_shown):
            self._full_shown = True
            self._display.error(
                f"{self._writer.path}: has room for {FAILURE_CAPACITY} failures; "
                "more texts are lost"
            )
        self.incomplete |= not kept and text.startswith(TOOK_TOO_LONG)

    def _show(self, failure: np.void, host: str, text: str) -> None:
        """Show a timeout, or an exception unless one of the same cause was shown."""
        cause, late = cause_of(text), text.startswith(TOOK_TOO_LONG)
        if cause in self._causes and not late:
            return
        self._causes.add(cause)
        shown = text if late else f"raised\n{text.rstrip()}\nmore of these are counted, not shown"
        self._display.error(
            f"rank {failure['rank']} on {host}: string "
            f"{volume_string(int(failure['string'])).text} sample {failure['sample']} {shown}"
        )
