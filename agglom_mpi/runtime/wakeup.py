"""Waking a rank that waits, and how long it waits between two looks.

MPI has no receive that waits without burning a core, and a rank that looks for mail from time to
time looks too late or too often: a look takes some 30 µs, for which the thread that simulates loses
its core. So ranks of one machine ring after each message. Bells carry nothing and nothing depends
on them: what is not rung for is found a little later.
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
"""What `poll` rounds waits to, s; shorter ones are slept."""


class Wakeup:
    """Rung by anybody who knows its name, on this machine.

    Attributes
    ----------
    name
        What others ring it by; empty if only this process can.
    """

    def __init__(self) -> None:
        self.name = b""
        if sys.platform == "linux":
            self.name = ABSTRACT + os.urandom(12).hex().encode()
            self._hears = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._hears.bind(self.name)
            self._rings = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._rings.connect(self.name)
        else:
            self._hears, self._rings = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._hears.setblocking(False)
        self._rings.setblocking(False)
        self._poll = select.poll()
        self._poll.register(self._hears, select.POLLIN)

    def ring(self) -> None:
        """Wake this process, from any thread; never waits."""
        with suppress(OSError):  # there is no room: so many have rung it already
            self._rings.send(b".")

    def ring_at(self, name: bytes) -> bool:
        """Wake another rank; whether there is one of that name on this machine."""
        try:
            self._hears.sendto(b".", name)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return True

    def wait(self, seconds: float) -> bool:
        """Wait until it rings, at most so long, and forget all rings; whether there were any.

        Look after that: whoever rings has done before what he rings for.
        """
        if seconds < SHORT:
            time.sleep(seconds)
        else:
            self._poll.poll(int(1e3 * seconds))
        rung = False
        with suppress(BlockingIOError):
            while self._hears.recv(1):
                rung = True
        return rung


SHORTEST: Final = 5e-5
LONGEST: Final = 4e-3
"""Bounds of the wait, s."""

GROWTH: Final = 1.5
"""From one wait to the next."""

QUIET: Final = 0.05
"""Wait where all that send also wake the receiver, s."""

FIRST: Final = 0.125
"""Wait after mail, in units of the time between mail: a look takes some 30 µs of a core, but with
longer waits a rank whose samples are short runs out of work. At a half, two ranks that wait for
each other would wait ever longer."""

RECENT: Final = 0.1
"""Weight of the last time in the mean."""


class PollBackoff:
    """Short waits while messages come and go, longer ones when nothing happens.

    Attributes
    ----------
    seconds
        How long to wait now if nobody rings.
    """

    def __init__(self) -> None:
        self.seconds = SHORTEST
        self._between = 0.0
        self._found = time.monotonic()
        self._early = False

    def at_most(self, rings: bool) -> float:
        """Return how long to wait now, s, given whether all that send also ring.

        The first wake-up may be faster than the message that it is for.
        """
        if not rings:
            return self.seconds
        return LONGEST if self._early else QUIET

    def looked(self, found: bool, rung: bool = False) -> None:
        """Take note of a look at the mail, whether there was any, and whether it was woken."""
        self._early = rung and not found
        if not found:
            self.seconds = min(GROWTH * self.seconds, LONGEST)
            return
        now = time.monotonic()
        self._between += RECENT * (min(now - self._found, 1.0) - self._between)
        self._found = now
        self.seconds = min(max(FIRST * self._between, SHORTEST), LONGEST)


def there_is_mail(world: "Intracomm", source: int, status: "Status") -> bool:
    """Look for a message, of any tag; what is found goes into the status.

    Looked for twice: MPICH may take a message in at one call and tell of it at the next.
    """
    return world.Iprobe(source, status=status) or world.Iprobe(source, status=status)
