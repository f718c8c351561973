"""What a run shows: a live line on a terminal, log lines elsewhere, nothing but errors if quiet."""

import os
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from agglom_mpi.report.numbers import with_error

if TYPE_CHECKING:
    from agglom_mpi.farm.work import Work
    from agglom_mpi.search import GenerationSummary, Inversion

WIDEST: Final = 88
"""Columns that a table of six strings takes; files and pipes get them all."""


def print_wide(content: RenderableType) -> None:
    """Print a table to standard output, not squeezed where that is no terminal."""
    # Open MPI gives its ranks a terminal, whatever it then does with what they print there.
    terminal = False if "OMPI_COMM_WORLD_SIZE" in os.environ else None
    # Titles and paths are the user's: neither [markup] nor :emoji: is meant.
    console = Console(
        soft_wrap=True, markup=False, emoji=False, highlight=False, force_terminal=terminal
    )
    if not console.is_terminal:
        console.width = max(WIDEST, console.width)
    console.print(content)


class Display:
    """Shows a run on standard error and its result on standard output."""

    unit = "generations"

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._log = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)
        self._progress: Progress | None = None
        self._task = TaskID(0)
        self._total = 0

    def error(self, text: str) -> None:
        """Show a mistake, also if quiet."""
        console = self._progress.console if self._progress else self._log
        console.print(text, style="bold red", markup=False)

    def message(self, text: str) -> None:
        """Show one line."""
        if not self._quiet:
            (self._progress.console if self._progress else self._log).print(text, markup=False)

    def table(self, content: RenderableType) -> None:
        """Show a result."""
        print_wide(content)

    def begin(
        self, work: "Work", path: str, ranks: int, inversion: "Inversion", database: str
    ) -> None:
        """Say what runs, and prepare the live line."""
        self._total = self.total(work)
        done = len(inversion.results)
        continued = f", {done} of them judged before" if done else ""
        who = f"{ranks} ranks, {database} database" if ranks > 1 else "1 rank"
        self.message(
            f"{work.campaign.title or work.campaign.name}: {work.largest}"
            f"{continued}, {who}, into {path}"
        )
        if self._log.is_terminal and not self._quiet:
            self._progress = Progress(
                TextColumn("{task.description}"),
                BarColumn(bar_width=20),
                TextColumn("{task.completed:.0f}/{task.total:.0f} {task.fields[status]}"),
                TimeElapsedColumn(),
                console=self._log,
            )
            self._task = self._progress.add_task(self.unit, total=self._total, status="")

    def total(self, work: "Work") -> int:
        """Count the generations."""
        return work.room.generations

    @property
    def live(self) -> bool:
        """Whether there is a live line."""
        return self._progress is not None

    def progress(self, done: int | None, status: str | None = None) -> None:
        """Refresh the live line, if there is one."""
        if self._progress:
            self._progress.update(self._task, completed=done)
            if status is not None:
                self._progress.update(self._task, status=status)

    def generation(self, summary: "GenerationSummary", samples: int, rate: float) -> None:
        """Show a finished generation."""
        best = with_error(summary.objective, summary.standard_error)
        self.message(
            f"generation {summary.generation + 1}/{self._total}: best {best} (string "
            f"{summary.best}), mean of top {summary.mean_of_top:.3g}, {summary.evaluations} "
            f"strings, {samples} samples, {rate:.0f}/s"
        )
        self.progress(summary.generation + 1)

    def tick(self, samples: int, rate: float, busy: float, live: int) -> None:
        """Refresh the live line."""
        self.progress(
            None, f"{samples} samples, {rate:.0f}/s, {busy:.0%} busy, {live} strings open"
        )

    def __enter__(self) -> Self:
        if self._progress:
            self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._progress:
            self._progress.stop()
            self._progress = None
