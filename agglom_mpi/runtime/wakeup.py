"""Waking a rank that waits for messages, and how long it waits between two polls.

MPI has no receive that waits without burning a core. Polling is too late or too frequent: a poll
takes some 30 µs, in which the simulating thread loses its core. So ranks on one host wake each
other after each message. A wake-up carries nothing and nothing depends on it: without one, a
message is found a little later.
"""

import os
import select
import socket
import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm, Status


ABSTRACT: Final = b"\0agglom-"
"""Names that begin with a zero byte are no files, and end with the process (Linux)."""

SHORT: Final = 1e-3
"""`poll` rounds waits to this, in s; shorter ones are slept."""


class Wakeup:
    """A socket that wakes its process; anybody on this host who knows its name can ring it.

    Attributes
    ----------
    name
        Name of the socket; empty if only this process can ring it.
    """

    def __init__(self) -> None:
        self.name = b""
        if sys.platform == "linux":
            self.name = ABSTRACT + os.urandom(12).hex().encode()
            self._receiver = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._receiver.bind(self.name)
            self._sender = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._sender.connect(self.name)
        else:
            self._receiver, self._sender = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._receiver.setblocking(False)
        self._sender.setblocking(False)
        self._poll = select.poll()
        self._poll.register(self._receiver, select.POLLIN)

    def ring(self) -> None:
        """Wake this process, from any thread; never waits."""
        with suppress(OSError):  # the buffer is full: it was rung many times already
            self._sender.send(b".")

    def ring_at(self, name: bytes) -> bool:
        """Wake another rank; return False if there is none of that name on this host."""
        try:
            self._receiver.sendto(b".", name)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return True

    def wait(self, seconds: float) -> bool:
        """Wait until it rings, at most `seconds`; return whether it has rung.

        Poll for messages after that: whoever rings has sent before.
        """
        if seconds < SHORT:
            time.sleep(seconds)
        else:
            self._poll.poll(int(1e3 * seconds))
        rung = False
        with suppress(BlockingIOError):
            while self._receiver.recv(1):
                rung = True
        return rung


SHORTEST: Final = 5e-5
LONGEST: Final = 4e-3
"""Bounds of the wait, s."""

GROWTH: Final = 1.5
"""Factor from one wait to the next."""

QUIET: Final = 0.05
"""Wait where all senders also wake the receiver, s."""

FIRST: Final = 0.125
"""Wait after a message, in units of the time between messages: a poll takes some 30 µs of a core,
but with longer waits a rank whose samples are short runs out of work. At a half, two ranks that
wait for each other would wait ever longer."""

RECENT: Final = 0.1
"""Weight of the last time in the mean."""


class PollBackoff:
    """Short waits while messages come and go, longer ones when nothing happens.

    Attributes
    ----------
    seconds
        Time until the next poll where senders do not wake the receiver, in s.
    """

    def __init__(self) -> None:
        self.seconds = SHORTEST
        self._between = 0.0
        self._last_found = time.monotonic()
        self._early = False

    def timeout(self, woken: bool) -> float:
        """Return how long to wait now in s; `woken` if all senders wake the receiver."""
        if not woken:
            return self.seconds
        # A wake-up may be faster than the message that it is for.
        return LONGEST if self._early else QUIET

    def polled(self, found: bool, rung: bool = False) -> None:
        """Adapt to a poll: whether there were messages, and whether a wake-up led to it."""
        self._early = rung and not found
        if not found:
            self.seconds = min(GROWTH * self.seconds, LONGEST)
            return
        now = time.monotonic()
        self._between += RECENT * (min(now - self._last_found, 1.0) - self._between)
        self._last_found = now
        self.seconds = min(max(FIRST * self._between, SHORTEST), LONGEST)


def message_waits(world: "Intracomm", source: int, status: "Status") -> bool:
    """Return whether a message of any tag waits to be received; it is described in `status`."""
    # Twice: MPICH may take a message in at one call and report it at the next.
    return world.Iprobe(source, status=status) or world.Iprobe(source, status=status)
