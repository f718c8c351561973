"""When and how to look at the mail: a blocking receive would burn a core."""

import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm, Status

SHORTEST: Final = 5e-5
LONGEST: Final = 4e-3
"""Bounds of the wait, s."""

GROWTH: Final = 1.5
"""From one wait to the next."""

QUIET: Final = 0.05
"""Wait where all that send also ring a bell, s."""

FIRST: Final = 0.125
"""Wait after mail, in units of the time between mail: a look takes some 30 µs of a core, but with
longer waits a rank whose samples are short runs out of work. At a half, two ranks that wait for
each other would wait ever longer."""

RECENT: Final = 0.1
"""Weight of the last time in the mean."""


class Waiting:
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

        The first bell may be faster than the message that it rings for.
        """
        if not rings:
            return self.seconds
        return LONGEST if self._early else QUIET

    def looked(self, found: bool, rung: bool = False) -> None:
        """Take note of a look at the mail, whether there was any, and whether a bell had rung."""
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
