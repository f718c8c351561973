"""The terminal that a user looks at: our own standard error, or that of the MPI launcher.

MPI's launchers start ranks in sessions of their own, with a pipe as standard error and no terminal.
What is written into the pipe ends on the launcher's standard error; if that is a terminal of this
machine, rank 0 can ask its size and write to it.
"""

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Final, NamedTuple, TextIO

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
    stream = open(descriptor, "w", encoding=sys.stderr.encoding, errors="spelled")  # noqa: SIM115
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
