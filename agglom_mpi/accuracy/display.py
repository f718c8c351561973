"""What a study shows while it runs: set-ups done of all of them."""

import time
from typing import TYPE_CHECKING, Final

from agglom_mpi.report.display import Display

if TYPE_CHECKING:
    from agglom_mpi.farm.work import Work
    from agglom_mpi.search import GenerationSummary, Inversion

INTERVAL: Final = 20.0
"""Seconds between log lines where there is no live line."""


class StudyDisplay(Display):
    """Counts set-ups instead of generations."""

    unit = "set-ups"

    def begin(
        self, work: "Work", path: str, ranks: int, inversion: "Inversion", database: str
    ) -> None:
        """Say what runs, and prepare the live line."""
        super().begin(work, path, ranks, inversion, database)
        self._said = time.monotonic()

    def total(self, work: "Work") -> int:
        """Count the set-ups."""
        return work.room.strings

    def generation(self, summary: "GenerationSummary", samples: int, rate: float) -> None:
        """All set-ups are one generation; there is nothing to say at its end."""

    def tick(self, samples: int, rate: float, busy: float, live: int) -> None:
        """Refresh the live line, or log one now and then."""
        done = self._total - live
        self.progress(done, f"{samples} samples, {rate:.0f}/s, {busy:.0%} busy")
        if not self.live and time.monotonic() - self._said > INTERVAL:
            self._said = time.monotonic()
            self.message(f"{done} of {self._total} set-ups measured, {samples} samples")
