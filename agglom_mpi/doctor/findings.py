"""What a check has found."""

from typing import NamedTuple


class Finding(NamedTuple):
    """Result of one check.

    Attributes
    ----------
    topic : str
        What was checked, a word or two.
    found : str
        What was found, one line.
    advice : str
        What to change, and how; empty if nothing.
    broken : bool
        Whether campaigns cannot run, or not on several ranks, unless this is changed.
    """

    topic: str
    found: str
    advice: str = ""
    broken: bool = False
