"""The terminal of a process, found through an MPI launcher too, and live lines on it.

MPI's launchers start ranks in sessions of their own, with a pipe as standard error and no terminal.
What is written into the pipe ends on the launcher's standard error; if that is a terminal of this
machine, rank 0 can ask its size and write to it.

Live lines are drawn again in place. The cursor waits at the beginning of the first of them, so that
the contents of the screen need not be known: whatever became of the lines, by a resize or by the
output of others, they are overwritten from there, and what follows is erased. The cursor is never
hidden, so that a killed run leaves the terminal as it was. Two empty lines come first, for what
shells and launchers print after a Ctrl-C.
"""

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Any, Final, NamedTuple, TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from agglom_mpi.display.progress import RunProgress, terminal_lines
from agglom_mpi.formatting import ASCII_REPLACEMENT, printable


class PlainConsole(Console):
    """Console that shows texts as they are written.

    Titles, names and paths are the user's: [brackets] and :colons: in them are plain text, and
    control characters do not reach the terminal.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the segments of something; of texts, but not of styles, made printable."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))


LAUNCHERS: Final = {"mpirun", "mpiexec", "mpiexec.hydra", "orterun", "prterun", "prun"}
"""Process names of the launchers on whose standard error that of the ranks ends."""

REDIRECTION: Final = re.compile(r"-{1,2}(errfile|output-filename|output$|stdout|stderr)")
"""Options of launchers that send the output of ranks to files, or tag it."""

DUMB_TERMINALS: Final = {"", "dumb", "unknown"}
STDOUT: Final = 1
STDERR: Final = 2
PROC: Final = Path("/proc")


class Terminal(NamedTuple):
    """A terminal to draw on, and whether this process is in its foreground now."""

    stream: TextIO
    in_foreground: Callable[[], bool]

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows at present; 80 by 24 if they are unknown."""
        with suppress(OSError, ValueError):
            columns, rows = os.get_terminal_size(self.stream.fileno())
            if columns and rows:
                return columns, rows
        return 80, 24

    @property
    def columns(self) -> int:
        """Columns at present."""
        return self.size[0]


def find_terminal(launched: bool, output: int = STDERR) -> Terminal | None:
    """Return the terminal on which standard output or error ends; None if there is none.

    Parameters
    ----------
    launched
        Whether an MPI launcher started this process: it may give ranks a terminal of its own.
    output
        `STDOUT` or `STDERR`.
    """
    if os.environ.get("TERM", "") in DUMB_TERMINALS:
        return None
    with suppress(OSError, ValueError):
        if launched:
            return _launcher_terminal(output)
        stream = sys.stdout if output == STDOUT else sys.stderr
        return Terminal(stream, lambda: _in_foreground(stream)) if stream.isatty() else None
    return None


def _in_foreground(stream: TextIO) -> bool:
    """Return whether this process is in the foreground of its terminal."""
    try:
        return os.tcgetpgrp(stream.fileno()) == os.getpgrp()
    except (OSError, ValueError):  # a terminal of no session, which nobody else draws on
        return True


def _launcher_terminal(output: int) -> Terminal | None:
    """Open the launcher's terminal, if the output of this process ends there."""
    below = os.getpid()
    for process in _ancestors():
        if (PROC / str(process) / "comm").read_text().strip() in LAUNCHERS:
            break
        below = process
    else:
        return None
    if _redirects_output(process) or not _is_read_by({process, below} - {os.getpid()}, output):
        return None
    path = os.readlink(PROC / str(process) / "fd" / str(output))
    # This process leads a session: opening a terminal must not make it the session's.
    descriptor = os.open(path, os.O_WRONLY | os.O_NOCTTY)
    if not os.isatty(descriptor):
        os.close(descriptor)
        return None
    stream = open(descriptor, "w", encoding=sys.stderr.encoding, errors=ASCII_REPLACEMENT)  # noqa: SIM115
    return Terminal(stream, lambda: _process_in_foreground(process))


def _ancestors() -> Iterator[int]:
    """Yield the parent of this process, its parent and so on."""
    process = os.getppid()
    while process > 1:
        yield process
        process = int(_stat(process)[1])


def _stat(process: int) -> list[str]:
    """Return the fields of `/proc/PID/stat` after the name: state, parent, group, session, …."""
    return (PROC / str(process) / "stat").read_text().rpartition(")")[2].split()


def _redirects_output(process: int) -> bool:
    """Return whether a launcher was asked to redirect the output of its ranks."""
    command = (PROC / str(process) / "cmdline").read_bytes().decode(errors="replace").split("\0")
    own = takewhile(lambda word: not Path(word).name.startswith("agglom"), command)
    return any(map(REDIRECTION.match, own))


def _is_read_by(processes: set[int], output: int) -> bool:
    """Return whether one of the processes holds the other end of an output of this process."""
    ours = os.readlink(PROC / "self" / "fd" / str(output))
    held = (link for process in processes for link in (PROC / str(process) / "fd").iterdir())
    return any(os.readlink(link) == ours for link in held)


def _process_in_foreground(process: int) -> bool:
    """Return whether another process is in the foreground of its terminal."""
    try:
        _, _, group, _, _, foreground = _stat(process)[:6]
    except (OSError, ValueError):  # it is gone
        return False
    return group == foreground


ERASE_LINE: Final = "\x1b[K"
ERASE_BELOW: Final = "\x1b[J"
CUT: Final = "\x1b[?7l"
"""Cuts lines that are too long: the terminal may have become narrower since it was asked."""
WRAP: Final = "\x1b[?7h"
EMPTY_LINES: Final = (Text(), Text())


class LiveLines:
    """Lines of a `RunProgress` on a terminal, drawn in place, and messages above them."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._shown: RunProgress | None = None
        self._console = PlainConsole(
            file=terminal.stream, force_terminal=True, legacy_windows=False
        )

    def draw(self, progress: RunProgress) -> None:
        """Draw the lines, unless the process is in the background."""
        self._shown = progress
        if self._terminal.in_foreground():
            self._write(self._drawn(progress))

    def print_above(self, content: RenderableType, style: str | None = None) -> None:
        """Print something above the lines, where it stays."""
        self._console.width = self._terminal.columns
        with self._console.capture() as capture:
            self._console.print(content, style=style)
        lines = ""
        if self._shown is not None and self._terminal.in_foreground():
            lines = self._drawn(self._shown)
        self._write(f"\r{ERASE_BELOW}{capture.get()}{lines}")

    def erase(self) -> None:
        """Erase the lines."""
        if self._shown is not None and self._terminal.in_foreground():
            self._write(f"\r{ERASE_BELOW}")
        self._shown = None

    def _drawn(self, progress: RunProgress) -> str:
        """Return the control sequences and texts that draw the lines."""
        columns, rows = self._terminal.size
        encoding = self._terminal.stream.encoding or "utf-8"
        found = [*EMPTY_LINES, *terminal_lines(progress, columns, encoding)][: max(1, rows - 1)]
        drawn = f"{ERASE_LINE}\r\n".join(map(self._styled, found))
        up = f"\x1b[{len(found) - 1}A" if len(found) > 1 else ""
        return f"{CUT}\r{drawn}{ERASE_BELOW}{WRAP}\r{up}"

    def _styled(self, line: Text) -> str:
        system = self._console._color_system
        return "".join(
            segment.style.render(segment.text, color_system=system)
            if segment.style
            else segment.text
            for segment in line.render(self._console)
        )

    def _write(self, text: str) -> None:
        try:
            self._terminal.stream.write(text)
            self._terminal.stream.flush()
        except (OSError, ValueError):  # the terminal was closed, which does not concern the run
            self._shown = None
