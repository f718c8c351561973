"""A bell: wakes a rank that waits for mail or for its own results, from another thread or rank.

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
from typing import Final

ABSTRACT: Final = b"\0agglom-"
"""Names that begin with a zero byte are no files, and end with the process (Linux)."""

SHORT: Final = 1e-3
"""What `poll` rounds waits to, s; shorter ones are slept."""


class Bell:
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
        """Ring this bell, from any thread; never waits."""
        with suppress(OSError):  # there is no room: so many have rung it already
            self._rings.send(b".")

    def ring_at(self, name: bytes) -> bool:
        """Ring the bell of another rank; whether there is one of that name on this machine."""
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
