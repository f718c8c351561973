"""One thing that was looked at."""

from typing import NamedTuple


class Finding(NamedTuple):
    """What was found, and what to do about it.

    Attributes
    ----------
    topic : str
        What was looked at, a word or two.
    found : str
        One line.
    advice : str
        What would be better, and how to get it; empty if all is well.
    broken : bool
        Whether campaigns do not run at all like this, or not on several ranks.
    """

    topic: str
    found: str
    advice: str = ""
    broken: bool = False
