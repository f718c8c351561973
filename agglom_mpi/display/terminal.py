"""Which terminal there is, and lines that are drawn again in place.

MPI's launchers start ranks in sessions of their own, with a pipe as standard error and no terminal.
What is written into the pipe ends on the launcher's standard error; if that is a terminal of this
machine, rank 0 can ask its size and write to it.

The cursor waits at the beginning of the first of them, so that nothing needs to be known of what
is on the screen: whatever became of the lines, by a resize or by what others wrote, they are
overwritten from there, and what follows is erased. It is never hidden: a run that is killed leaves
a terminal as it was. Two empty lines come first, for what shells and launchers say of a Ctrl-C.
"""

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Final, NamedTuple, TextIO

from rich.console import Console, RenderableType
from rich.text import Text

from agglom_mpi.display.progress import Progress, lines

LAUNCHERS: Final = {"mpirun", "mpiexec", "mpiexec.hydra", "orterun", "prterun", "prun"}
"""Programs, as Linux calls their processes, whose standard error is where ranks' own ends."""

ELSEWHERE: Final = re.compile(r"-{1,2}(errfile|output-filename|output$|stdout|stderr)")
"""Options of launchers that send what ranks write to files, or tag it."""

DUMB: Final = {"", "dumb", "unknown"}
STDOUT: Final = 1
STDERR: Final = 2
PROC: Final = Path("/proc")


class Terminal(NamedTuple):
    """Somewhere to draw, and whether it is ours to draw on now: shells put jobs in background."""

    stream: TextIO
    in_foreground: Callable[[], bool]

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines now; 80 by 24 if it does not say."""
        with suppress(OSError, ValueError):
            columns, rows = os.get_terminal_size(self.stream.fileno())
            if columns and rows:
                return columns, rows
        return 80, 24

    @property
    def columns(self) -> int:
        """Columns now."""
        return self.size[0]


def find_terminal(launched: bool, output: int = STDERR) -> Terminal | None:
    """Find the terminal that our standard output or error is or ends on; None if there is none.

    Parameters
    ----------
    launched
        Whether an MPI launcher started us: it may give ranks a terminal of its own making.
    output
        `STDOUT` or `STDERR`.
    """
    if os.environ.get("TERM", "") in DUMB:
        return None
    with suppress(OSError, ValueError):
        if launched:
            return _of_launcher(output)
        stream = sys.stdout if output == STDOUT else sys.stderr
        return Terminal(stream, lambda: _ours(stream)) if stream.isatty() else None
    return None


def _ours(stream: TextIO) -> bool:
    try:
        return os.tcgetpgrp(stream.fileno()) == os.getpgrp()
    except (OSError, ValueError):  # not the terminal of this session: nobody else's, either
        return True


def _of_launcher(output: int) -> Terminal | None:
    """Open the launcher's terminal, if what we write ends there."""
    below = os.getpid()
    for process in _ancestors():
        if (PROC / str(process) / "comm").read_text().strip() in LAUNCHERS:
            break
        below = process
    else:
        return None
    if _sends_elsewhere(process) or not _reads_from_us({process, below} - {os.getpid()}, output):
        return None
    path = os.readlink(PROC / str(process) / "fd" / str(output))
    # We lead a session: opening a terminal must not make it ours.
    descriptor = os.open(path, os.O_WRONLY | os.O_NOCTTY)
    if not os.isatty(descriptor):
        os.close(descriptor)
        return None
    stream = open(descriptor, "w", encoding=sys.stderr.encoding, errors="ascii_replacement")  # noqa: SIM115
    return Terminal(stream, lambda: _leads(process))


def _ancestors() -> Iterator[int]:
    process = os.getppid()
    while process > 1:
        yield process
        process = int(_stat(process)[1])


def _stat(process: int) -> list[str]:
    """Return what Linux says of a process after its name: state, parent, group, session, …."""
    return (PROC / str(process) / "stat").read_text().rpartition(")")[2].split()


def _sends_elsewhere(process: int) -> bool:
    """Whether a launcher was asked to send what ranks write to another place."""
    command = (PROC / str(process) / "cmdline").read_bytes().decode(errors="replace").split("\0")
    own = takewhile(lambda word: not Path(word).name.startswith("agglom"), command)
    return any(map(ELSEWHERE.match, own))


def _reads_from_us(processes: set[int], output: int) -> bool:
    """Whether one of them holds the other end of what we have as an output."""
    ours = os.readlink(PROC / "self" / "fd" / str(output))
    held = (link for process in processes for link in (PROC / str(process) / "fd").iterdir())
    return any(os.readlink(link) == ours for link in held)


def _leads(process: int) -> bool:
    """Whether a process is in the foreground of its terminal."""
    try:
        _, _, group, _, _, foreground = _stat(process)[:6]
    except (OSError, ValueError):  # it is gone
        return False
    return group == foreground


ERASE_LINE: Final = "\x1b[K"
ERASE_BELOW: Final = "\x1b[J"
CUT: Final = "\x1b[?7l"
"""What is too long for a line is lost: the terminal may be narrower by now than it just said."""
WRAP: Final = "\x1b[?7h"
EMPTY: Final = (Text(), Text())


class Live:
    """Lines of a `Progress` on a terminal, and messages above them."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._shown: Progress | None = None
        self._console = Console(
            file=terminal.stream,
            force_terminal=True,
            legacy_windows=False,
            highlight=False,
            markup=False,
            emoji=False,
        )

    def show(self, progress: Progress) -> None:
        """Draw, unless somebody else has the terminal now."""
        self._shown = progress
        if self._terminal.in_foreground():
            self._write(self._drawn(progress))

    def say(self, content: RenderableType, style: str | None = None) -> None:
        """Print something that stays, above the lines."""
        self._console.width = self._terminal.columns
        with self._console.capture() as capture:
            self._console.print(content, style=style)
        again = ""
        if self._shown is not None and self._terminal.in_foreground():
            again = self._drawn(self._shown)
        self._write(f"\r{ERASE_BELOW}{capture.get()}{again}")

    def stop(self) -> None:
        """Erase the lines."""
        if self._shown is not None and self._terminal.in_foreground():
            self._write(f"\r{ERASE_BELOW}")
        self._shown = None

    def _drawn(self, progress: Progress) -> str:
        columns, rows = self._terminal.size
        encoding = self._terminal.stream.encoding or "utf-8"
        found = [*EMPTY, *lines(progress, columns, encoding)][: max(1, rows - 1)]
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
        except (OSError, ValueError):  # the terminal was closed; the run goes on
            self._shown = None
