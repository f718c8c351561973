"""How long to wait before looking at the mail again: a blocking receive would burn a core."""

from typing import Final

SHORTEST: Final = 5e-5
LONGEST: Final = 4e-3
"""Bounds of the wait, s."""

GROWTH: Final = 1.5
"""From one wait to the next; with 2, two ranks that wait for each other wait ever longer."""


class Waiting:
    """Short waits while messages come and go, longer ones when nothing happens.

    Attributes
    ----------
    seconds
        How long to wait now.
    """

    def __init__(self) -> None:
        self.seconds = SHORTEST

    def looked(self, found: bool) -> None:
        """Take note of a look at the mail, and whether there was any."""
        self.seconds = SHORTEST if found else min(GROWTH * self.seconds, LONGEST)
