"""The finding of a check."""

from typing import NamedTuple


class Finding(NamedTuple):
    """Result of one check.

    Attributes
    ----------
    topic : str
        Subject of the check, a word or two.
    found : str
        Result, one line.
    advice : str
        Advised change; empty if there is none.
    broken : bool
        Whether campaigns cannot run, or not on several ranks, unless this is changed.
    """

    topic: str
    found: str
    advice: str = ""
    broken: bool = False
