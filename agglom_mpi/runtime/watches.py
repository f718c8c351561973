"""Threads that end a rank whose launcher is gone, or whose rank 0 is silent.

Also of that: one rank of each host reports that rank 0 is silent. Rank 0 in its turn observes the
others in `silence`.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from agglom_mpi.errors import FAILURE
from agglom_mpi.formatting import format_duration
from agglom_mpi.launcher import PROC, launching_process
from agglom_mpi.runtime.abort_flag import ActiveClock
from agglom_mpi.runtime.messages import own_host

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


LOOKED_EVERY: Final = 0.5
"""Time between two looks at the clock, s."""

NAMED_AFTER: Final = 15.0
"""Time without a message, s, after which rank 0 names a rank, and a rank of each host rank 0."""

CUT_OFF_AFTER: Final = 50.0
"""Time without a message of rank 0, s, after which ranks on other hosts end: the host of rank 0, or
the connection to it, is lost."""

ENDS_AFTER: Final = 600.0
"""The same of ranks on the host of rank 0, s, and of all ranks where rank 0 cannot send heartbeats
while it decides or writes: it may be held up."""


def patience(*, same_host: bool, beats: bool) -> tuple[float, float]:
    """Return the times, s, without a message of rank 0 after which a rank reports it, and ends.

    Parameters
    ----------
    same_host
        Whether the rank is on the host of rank 0.
    beats
        Whether rank 0 sends heartbeats also while it decides or writes.
    """
    if not beats:
        return ENDS_AFTER / 2.0, ENDS_AFTER
    return NAMED_AFTER, ENDS_AFTER if same_host else CUT_OFF_AFTER


class CoordinatorWatch:
    """A thread that knows when rank 0 was heard last, also if this rank waits for MPI to send.

    Its clock stands still while this process is stopped. Before the first message of rank 0, which
    may be getting its file ready, nothing is reported before `ENDS_AFTER`.

    Parameters
    ----------
    rank
        This rank.
    patience
        Times without a message of rank 0 after which it is reported, and this rank ends, s.
    speaks
        Whether this rank reports that rank 0 is silent: one of each host does.
    """

    def __init__(self, rank: int, patience: tuple[float, float], *, speaks: bool) -> None:
        self._name = f"rank {rank} on {own_host().decode()}"
        self._patience, self._first = patience, (ENDS_AFTER, ENDS_AFTER)
        self._speaks = speaks
        self._delay = 0.0 if speaks else 1.0  # the launcher ends all when one has gone
        self._clock = ActiveClock()
        self._now = self._heard = self._clock.read()
        self._deaf = self._named = self._met = False
        self._ended = threading.Event()
        threading.Thread(target=self._work, name="coordinator", daemon=True).start()

    def hear(self) -> None:
        """Take into account that a message of rank 0 has come."""
        self._heard, self._met = self._now, True

    def listen(self, listens: bool) -> None:
        """Set whether this rank takes in messages: not while it writes to the campaign file."""
        self._deaf = not listens

    def stop(self) -> None:
        """Look no more."""
        self._ended.set()

    def look(self) -> None:
        """Report that rank 0 is silent or back, or end this rank."""
        self._now = self._clock.read()
        if self._deaf:
            self._heard = self._now
        silence = self._now - self._heard
        named, ends = self._patience if self._met else self._first
        if silence >= ends + self._delay:
            self._report(
                f"rank 0 has not been heard of for {format_duration(ends)}: the ranks of this host "
                "end; run the same command again to go on"
            )
            leave(FAILURE)
        elif silence >= named and not self._named:
            self._named = True
            self._report(
                f"rank 0 has not been heard of for {format_duration(named)}; in "
                f"{format_duration(ends - named)} the ranks of this host end"
            )
        elif silence < named and self._named:
            self._named = False
            self._report("rank 0 is back")

    def _work(self) -> None:
        while not self._ended.wait(LOOKED_EVERY):
            self.look()

    def _report(self, text: str) -> None:
        if self._speaks:
            with suppress(OSError):  # nobody reads it
                os.write(2, f"{self._name}: {text}\n".encode(errors="replace"))
