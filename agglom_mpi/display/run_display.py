"""What a run shows: progress in place or as log lines, messages, its result."""

import time
from functools import cached_property
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from rich.console import RenderableType
from rich.measure import Measurement

from agglom_mpi.display.progress import RunProgress, best_of, format_rate, log_line
from agglom_mpi.display.terminal import STDOUT, LiveLines, PlainConsole, Terminal, find_terminal
from agglom_mpi.formatting import pluralise
from agglom_mpi.launcher import launched_size

if TYPE_CHECKING:
    from agglom_mpi.search.proposals import GenerationSummary


TABLE_WIDTH: Final = 88
"""Columns of a table of six strings, which files and pipes get at least."""
WIDEST: Final = 10_000
"""Columns of the widest table that they get in full."""

LOG_INTERVAL: Final = 20.0
"""Time without a log line after which the progress is logged, s."""

LOG_SHARE: Final = 0.02
"""Share of the time since the start that passes between log lines in a long run."""


def print_wide(content: RenderableType) -> None:
    """Print a table to standard output, at its full width where that is no terminal."""
    launched = launched_size() is not None
    # Open MPI gives its ranks a terminal of its own, wherever their output really goes.
    force_terminal = False if launched else None
    console = PlainConsole(force_terminal=force_terminal)
    terminal = find_terminal(launched, STDOUT)
    if terminal is not None:
        console.width = terminal.columns
    elif not console.is_terminal:
        options = console.options.update(width=WIDEST)
        natural = Measurement.get(console, options, content).maximum
        console.width = max(TABLE_WIDTH, console.width, natural)
    console.print(content, soft_wrap=terminal is None)


class Display:
    """Shows a run on standard error and its result on standard output.

    Parameters
    ----------
    quiet
        Whether to show nothing but errors.
    """

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._log = PlainConsole(stderr=True)
        self._live: LiveLines | None = None
        self._began = self._last_output = time.monotonic()

    @cached_property
    def _terminal(self) -> Terminal | None:
        return find_terminal(launched_size() is not None)

    def error(self, text: str) -> None:
        """Show an error, also if quiet."""
        self._print(text, "bold red")

    def message(self, text: str) -> None:
        """Show one line, unless quiet."""
        if not self._quiet:
            self._print(text)

    def _print(self, text: str, style: str | None = None) -> None:
        if self._live is not None:
            self._live.print_above(text, style)
        else:
            if self._terminal is not None:
                self._log.width = self._terminal.columns
            self._log.print(text, style=style, soft_wrap=self._terminal is None)
        self._last_output = time.monotonic()

    def table(self, content: RenderableType) -> None:
        """Show a result on standard output."""
        print_wide(content)

    def begin(
        self, what: str, path: str, ranks: int, database: str, judged: int, progress: RunProgress
    ) -> None:
        """Show what is run, and the first live lines.

        Parameters
        ----------
        what
            The campaign in a few words.
        path
            Of the campaign file.
        ranks
        database
            Who writes samples: `gathered` or `parallel`.
        judged
            Strings with results of earlier legs.
        progress
        """
        earlier = f", {judged} of them evaluated before" if judged else ""
        who = f"{ranks} ranks, {database} database" if ranks > 1 else "1 rank"
        self.message(f"{what}{earlier}, {who}, into {path}")
        if self._live is not None:
            self._live.draw(progress)

    def generation(
        self, summary: "GenerationSummary", total: int, samples: int, rate: float
    ) -> None:
        """Log a finished generation, unless live lines show it."""
        if self._live is None and not self._quiet:
            self.message(generation_line(summary, total, samples, rate))

    def tick(self, progress: RunProgress) -> None:
        """Update the live lines, or log the progress if nothing was logged for a while."""
        if self._quiet:
            return
        if self._live is not None:
            self._live.draw(progress)
            return
        now = time.monotonic()
        if now - self._last_output > max(LOG_INTERVAL, LOG_SHARE * (now - self._began)):
            self.message(log_line(progress))

    def __enter__(self) -> Self:
        if self._terminal is not None and not self._quiet:
            self._live = LiveLines(self._terminal)
        self._began = self._last_output = time.monotonic()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.erase()
            self._live = None


class StudyDisplay(Display):
    """Progress where all strings are given: nothing is shown at the end of the one generation."""

    def generation(
        self, summary: "GenerationSummary", total: int, samples: int, rate: float
    ) -> None:
        """Show nothing."""


def generation_line(summary: "GenerationSummary", total: int, samples: int, rate: float) -> str:
    """Return the result of a generation in one line."""
    best = best_of(summary)
    source = f" {best.source}" if best.source else ""
    return (
        f"generation {summary.generation + 1}/{total}: best {best}{source}, "
        f"mean of top {summary.mean_of_top:.3g}, {pluralise(summary.evaluations, 'string')}, "
        f"{pluralise(samples, 'sample')}, {format_rate(rate)}"
    )
