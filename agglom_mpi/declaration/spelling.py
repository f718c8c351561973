"""Numbers as texts: their limits, spellings beside Python's own, and advice on misspelt ones."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

MIN_MAGNITUDE: Final = 1e-100
MAX_MAGNITUDE: Final = 1e100
"""Limits of magnitudes other than 0, so that squares and products fit into float64."""

NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"
"""Regular expression of a number; a Fortran program writes 1.0D-1 for 0.1."""

_PYTHON: Final = str.maketrans("dD", "ee")
_MINUS: Final = str.maketrans("\N{MINUS SIGN}", "-")
_REMEDIES: Final = (
    (re.compile(r"\d,\d"), "write a decimal point, and no comma, like 2500.5"),
    (re.compile(r"10\s*(?:\^|\*\*)|[x×·*]\s*10"), "write a power of ten like 2.5e7"),
    (re.compile(r"\d[\s_'’]\d{3}(?!\d)"), "write the digits of a number without gaps"),
)


def with_plain_minus(text: str) -> str:
    """Return a text with `-` in place of the typographic minus sign."""
    return text.translate(_MINUS)


def as_python(number: str) -> str:
    """Return a number that `NUMBER` matches as Python spells it."""
    return number.translate(_PYTHON)


def read_plain(text: str) -> float:
    """Return the number of a text; raise a ValueError where it is none."""
    plain = with_plain_minus(text.strip())
    return float(as_python(plain) if re.fullmatch(NUMBER, plain) else plain)


def remedy(text: str) -> str:
    """Return `; write …` for a text whose number is misspelt, such as `2500,5`, or nothing."""
    return next((f"; {advice}" for slip, advice in _REMEDIES if slip.search(text)), "")


def suggestion(name: str, allowed: Iterable[str]) -> str:
    """Return `did you mean 'NAME'?`, or all that is allowed if nothing is near.

    A name is near if all words of the unknown one are among its own, as those of `speed` are among
    those of `relative_speed`, or if it is spelt much the same.
    """
    names = list(allowed)
    words = set(name.split("_"))
    longer = [candidate for candidate in names if words <= set(candidate.split("_"))]
    near = longer if len(longer) == 1 else get_close_matches(name, names, n=1)
    return f"did you mean '{near[0]}'?" if near else f"allowed: {', '.join(names)}"
