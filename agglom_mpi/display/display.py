"""Progress of a run, in place or as log lines."""

import time
from functools import cached_property
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from rich.console import Console, RenderableType

from agglom_mpi.display.progress import Progress, in_words, per_second
from agglom_mpi.display.terminal import STDOUT, Live, Terminal, find_terminal
from agglom_mpi.formatting import value_with_error
from agglom_mpi.launcher import launched_size

if TYPE_CHECKING:
    from agglom_mpi.search.decisions import GenerationSummary


WIDEST: Final = 88
"""Columns that a table of six strings takes; files and pipes get them all."""

INTERVAL: Final = 20.0
"""Seconds without a log line after which one says how it goes."""

PATIENCE: Final = 0.02
"""Share of the time since the start that may pass without one: a long run says less often."""


def print_wide(content: RenderableType) -> None:
    """Print a table to standard output, not squeezed where that is no terminal."""
    launched = launched_size() is not None
    # Open MPI gives its ranks a terminal, whatever it then does with what they print there.
    terminal = False if launched else None
    # Titles and paths are the user's: neither [markup] nor :emoji: is meant.
    console = Console(markup=False, emoji=False, highlight=False, force_terminal=terminal)
    seen = find_terminal(launched, STDOUT)
    if seen is not None:
        console.width = seen.columns
    elif not console.is_terminal:
        console.width = max(WIDEST, console.width)
    console.print(content, soft_wrap=seen is None)


class Display:
    """Shows a run on standard error and its result on standard output.

    Parameters
    ----------
    quiet
        Show nothing but errors.
    """

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._log = Console(stderr=True, highlight=False, emoji=False, markup=False)
        self._live: Live | None = None
        self._began = self._said = time.monotonic()

    @cached_property
    def _terminal(self) -> Terminal | None:
        return find_terminal(launched_size() is not None)

    def error(self, text: str) -> None:
        """Show a mistake, also if quiet."""
        self._say(text, "bold red")

    def message(self, text: str) -> None:
        """Show one line."""
        if not self._quiet:
            self._say(text)

    def _say(self, text: str, style: str | None = None) -> None:
        if self._live is not None:
            self._live.say(text, style)
        else:
            if self._terminal is not None:
                self._log.width = self._terminal.columns
            self._log.print(text, style=style, soft_wrap=self._terminal is None)
        self._said = time.monotonic()

    def table(self, content: RenderableType) -> None:
        """Show a result."""
        print_wide(content)

    def begin(
        self, what: str, path: str, ranks: int, database: str, judged: int, progress: Progress
    ) -> None:
        """Say what runs; called when there is a place to show it.

        `judged` strings are known from earlier legs.
        """
        continued = f", {judged} of them judged before" if judged else ""
        who = f"{ranks} ranks, {database} database" if ranks > 1 else "1 rank"
        self.message(f"{what}{continued}, {who}, into {path}")
        if self._live is not None:
            self._live.show(progress)

    def generation(
        self, summary: "GenerationSummary", total: int, samples: int, rate: float
    ) -> None:
        """Log a finished generation; live lines say as much."""
        if self._live is None and not self._quiet:
            self.message(generation_line(summary, total, samples, rate))

    def tick(self, progress: Progress) -> None:
        """Refresh the live lines, or log one if nothing was for a while."""
        if self._quiet:
            return
        if self._live is not None:
            self._live.show(progress)
            return
        now = time.monotonic()
        if now - self._said > max(INTERVAL, PATIENCE * (now - self._began)):
            self.message(in_words(progress))

    def __enter__(self) -> Self:
        if self._terminal is not None and not self._quiet:
            self._live = Live(self._terminal)
        self._began = self._said = time.monotonic()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None


def generation_line(summary: "GenerationSummary", total: int, samples: int, rate: float) -> str:
    """Say what a generation found."""
    best = value_with_error(summary.objective, summary.standard_error)
    return (
        f"generation {summary.generation + 1}/{total}: best {best} (string {summary.best}), "
        f"mean of top {summary.mean_of_top:.3g}, {summary.evaluations} strings, "
        f"{samples} samples, {per_second(rate)}"
    )
