"""Ranks that do not hear rank 0: one of each host says so, and in the end all of them leave."""

import os
import threading
from contextlib import suppress
from typing import Final, NamedTuple

from agglom_mpi.errors import FAILURE
from agglom_mpi.formatting import format_duration
from agglom_mpi.runtime.active_clock import ActiveClock
from agglom_mpi.runtime.launcher_watch import leave
from agglom_mpi.runtime.messages import own_host

LOOKED_EVERY: Final = 0.5
"""Time between two looks at the clock, s."""

NAMED_AFTER: Final = 15.0
"""Time without a message of rank 0, s, after which a rank of each host reports it."""

CUT_OFF_AFTER: Final = 50.0
"""Time without a message of rank 0, s, after which ranks on other hosts end: the host of rank 0, or
the connection to it, is lost."""

ENDS_AFTER: Final = 600.0
"""The same of ranks on the host of rank 0, s, and of all ranks where rank 0 cannot send heartbeats
while it decides or writes: it may be held up."""


class Patience(NamedTuple):
    """How long a rank does without a message of rank 0, s.

    Attributes
    ----------
    named
        After which it is reported.
    ends
        After which this rank ends.
    """

    named: float
    ends: float

    @classmethod
    def of(cls, *, same_host: bool, beats: bool) -> "Patience":
        """Return that of a rank.

        Parameters
        ----------
        same_host
            Whether it is on the host of rank 0.
        beats
            Whether rank 0 sends heartbeats also while it decides or writes.
        """
        if not beats:
            return cls(ENDS_AFTER / 2.0, ENDS_AFTER)
        return cls(NAMED_AFTER, ENDS_AFTER if same_host else CUT_OFF_AFTER)


class CoordinatorWatch:
    """A thread that knows when rank 0 was heard last, also if this rank waits for MPI to send.

    Its clock stands still while this process is stopped. Before the first message of rank 0, which
    may be getting its file ready, nothing is reported before `ENDS_AFTER`.

    Parameters
    ----------
    rank
        This rank.
    patience
        What it has with rank 0.
    speaks
        Whether this rank reports that rank 0 is silent: one of each host does.
    """

    def __init__(self, rank: int, patience: Patience, *, speaks: bool) -> None:
        self._name = f"rank {rank} on {own_host().decode()}"
        self._patience, self._first = patience, Patience(ENDS_AFTER, ENDS_AFTER)
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
