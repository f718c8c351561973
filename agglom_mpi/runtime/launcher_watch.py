"""Ends a rank whose launcher is gone: nobody else would."""

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from agglom_mpi.errors import FAILURE
from agglom_mpi.launcher import PROC, launching_process

CHECKED_EVERY: Final = 2.0
"""Time between two checks, s."""

TIME_TO_STOP: Final = 30.0
"""Time, s, after which a rank without a launcher that has not stopped by itself is ended: rank 0
stops the others, writes what they still report, and puts the file on the disc."""


class LauncherWatch:
    """A thread that looks whether this rank still descends from the launcher's process.

    Whoever loses a parent gets another one, so that process numbers tell. The thread works in
    every phase of a run, also while the rank waits in MPI.

    Parameters
    ----------
    stop
        Called once when the launcher is gone, by the thread; the rank is ended `TIME_TO_STOP`
        later.

    Attributes
    ----------
    gone
        Whether the launcher is gone.
    """

    def __init__(self, stop: Callable[[], None], proc: Path = PROC) -> None:
        self.gone = False
        self._stop = stop
        self._proc = proc
        self._parent = os.getppid()
        self._launcher: int | None = None
        with suppress(OSError, ValueError):  # only the parent is known
            self._launcher = launching_process(proc)
        self._ended = threading.Event()
        threading.Thread(target=self._watch, name="launcher", daemon=True).start()

    def end(self, code: int) -> None:
        """Look a last time; without the launcher end this process with a code, and without MPI.

        MPI would wait for the launcher.
        """
        self._ended.set()
        self.look()
        if self.gone:
            leave(code)

    def look(self) -> None:
        """Look whether the launcher is there."""
        if self._launcher is not None:
            try:
                self.gone |= launching_process(self._proc) != self._launcher
            except (FileNotFoundError, ProcessLookupError):  # just now: the next look decides
                return
            except (OSError, ValueError):  # there is no descriptor left, for example
                pass
            else:
                return
        self.gone |= os.getppid() != self._parent

    def _watch(self) -> None:
        while not self._ended.wait(CHECKED_EVERY):
            self.look()
            if self.gone:
                self._stop()
                if not self._ended.wait(TIME_TO_STOP):
                    leave(FAILURE)
                return


def leave(code: int) -> None:
    """End this process at once, without MPI, which would wait for others."""
    signal.alarm(5)  # nobody may read what is printed
    for stream in filter(None, (sys.stdout, sys.stderr)):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
