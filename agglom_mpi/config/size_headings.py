"""Headings of tables of measured sizes, in the words of instruments and laboratories.

A heading states the role of its column by English words and by the signs of ISO 9276: `Q3` is the
cumulative share by volume, `p0` the share of a class by number. All of its words must be known:
`half diameter` is no diameter, and `number density` no number. An entry says what others mean.
"""

import re
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple, TypeAlias

from agglom_mpi.config.size_curve import ShareWeight
from agglom_mpi.config.size_file import BESIDE_DIAMETERS, DIAMETERS, RELATIVE
from agglom_mpi.config.text_table import Heading
from agglom_mpi.declaration.units import dimensions_of

Role: TypeAlias = Literal[
    "size",
    "lower",
    "upper",
    "middle",
    "projected area",
    "passing",
    "cumulative",
    "cumulative retained",
    "retained",
    "amount",
    "error",
]
"""Role of a column: a size, an amount, or the error of an amount."""

SIZES: Final[tuple[Role, ...]] = ("size", "lower", "upper", "middle", "projected area")
CURVES: Final[tuple[Role, ...]] = ("passing", "cumulative", "cumulative retained")
AMOUNTS: Final[tuple[Role, ...]] = (*CURVES, "retained", "amount")

_SIZE_WORDS: Final = {
    *("sieve", "sieves", "mesh", "opening", "aperture", "x", "channel", "class", "feret"),
    *("minferet", "diam", *DIAMETERS),
}
_BESIDE_SIZES: Final = {
    *("edge", "limit", "bound", "range", "nominal", "bin", "d", "interval", "no", "test"),
    *BESIDE_DIAMETERS,
}
"""Words that may stand beside those of a size."""
_EDGES: Final[dict[Role, set[str]]] = {
    "lower": {"lower", "from", "x1", "low"},
    "upper": {"upper", "to", "x2", "high", "xo", "x0"},
    "middle": {"mid", "middle", "centre", "center", "midpoint", "xm"},
}
_PASSING: Final = {"passing", "passed", "pass", "undersize", "finer", "below", "under"}
_CUMULATIVE: Final = {"cumulative", "cumul", "cum", "cumulated", "accumulated"}
_OVERSIZE: Final = {"oversize", "coarser", "above"}
_ERROR: Final = {"error", "errors", "sd", "std", "stdev", "sigma", "uncertainty", "deviation", "±"}
_WEIGHTS: Final[dict[ShareWeight, set[str]]] = {
    "number": {"number", "numbers", "count", "counts", "particles"},
    "area": {"area", "surface"},
    "mass": {"volume", "vol", "mass", "weight", "wt", "v/v", "w/w"},
}
_PERCENT: Final = {"%", "percent", "percentage"}
_OTHER_AMOUNTS: Final = {
    *("frequency", "share", "shares", "fraction", "amount", "chan", "histogram", "proportion"),
    *("relative", *_PERCENT),
}
_BESIDE_AMOUNTS: Final = {
    *("by", "in", "of", "on", "than", "the", "each", "standard", "diff", "differential"),
    *("sieve", "channel", "class", "distribution", "particle", "grain", "grains"),
}
"""Words that may stand beside those of an amount."""
_SIGN: Final = re.compile(r"(Q|[pP]|[dΔ]Q)([023])")
"""Cumulative shares and shares of classes by ISO 9276; q3, in lower case, is a density."""
_SIGN_WEIGHTS: Final[dict[str, ShareWeight]] = {"0": "number", "2": "area", "3": "mass"}


class SizeColumn(NamedTuple):
    """A column of a table of measured sizes.

    Attributes
    ----------
    position
        Number in the table, from 0.
    role
    weight
        What an amount is of: number, area or mass; None if the heading does not state it.
    unit
        Unit as written, `%` of percentages, empty if there is none.
    title
        Title as written.
    """

    position: int
    role: Role
    weight: ShareWeight | None
    unit: str
    title: str

    @property
    def is_percent(self) -> bool:
        """Whether its numbers are percentages."""
        return self.unit == "%"

    @property
    def is_length(self) -> bool:
        """Whether its numbers are sizes with a unit."""
        return _dimension(self.unit) == {"[length]": 1.0}


def size_columns(headings: Sequence[Heading]) -> list[SizeColumn]:
    """Return the columns of a table whose roles their headings state."""
    found = (_column(index, heading) for index, heading in enumerate(headings))
    return [column for column in found if column is not None]


def is_size_title(title: str) -> bool:
    """Return whether a title, in lower case and without its unit, is that of a column of sizes."""
    return _size_role(_words(title)) is not None


def names_other_amounts(heading: Heading) -> bool:
    """Return whether a column has amounts by none of the weights: by intensity, or per length."""
    words = _words(heading.title)
    is_percent = "%" in f"{heading.title}{heading.unit or ''}"
    return is_percent or bool(words & {"density", "intensity"})


def _column(index: int, heading: Heading) -> SizeColumn | None:
    words, unit = _words(heading.title), heading.unit or ""
    if sign := _SIGN.fullmatch(heading.title.split()[0] if heading.title else ""):
        words = words - {sign[0].lower()} | {"cumulative" if sign[1] == "Q" else "share"}
    if (words | {unit.lower()}) & _PERCENT:
        words, unit = words | {"%"}, "%"
    unit = "" if unit in RELATIVE else unit
    role = _size_role(words)
    weight = next((key for key, names in _WEIGHTS.items() if words & names), None)
    if role is None and (unit in ("", "%") or _is_mass(unit)):  # not in shares per length
        role = _amount_role(words)
        weight = "mass" if _is_mass(unit) else weight
    if sign and role in AMOUNTS:
        role, weight = ("passing" if sign[1] == "Q" else role), _SIGN_WEIGHTS[sign[2]]
    return None if role is None else SizeColumn(index, role, weight, unit, heading.title)


def _size_role(words: set[str]) -> Role | None:
    """Return the role of a column of sizes."""
    if words == {"area"}:  # that of a particle's picture
        return "projected area"
    others, is_size = words - _SIZE_WORDS - _BESIDE_SIZES, bool(words & _SIZE_WORDS)
    if is_size and not others:
        return "lower" if "min" in words else "upper" if "max" in words else "size"
    return next((role for role, names in _EDGES.items() if others and others <= names), None)


def _amount_role(words: set[str]) -> Role | None:
    """Return the role of a column of amounts, or of their errors."""
    named = _OTHER_AMOUNTS.union(*_WEIGHTS.values())
    curves = _OVERSIZE | _PASSING | _CUMULATIVE | {"retained"}
    if words - named - curves - _ERROR - _BESIDE_AMOUNTS:
        return None
    if words & _ERROR:
        return None if "relative" in words else "error"
    if words & _OVERSIZE or ("retained" in words and words & _CUMULATIVE):
        return "cumulative retained"
    if "retained" in words:
        return "retained"
    if words & _PASSING:
        return "passing"
    if words & _CUMULATIVE:
        return "cumulative"
    return "amount" if words & named else None


def _words(text: str) -> set[str]:
    """Return the words of a title; a sign such as that of `dV/dlogD` belongs to its word."""
    spaced = text.lower().replace("%", " % ")
    return set(re.split(r"[\s.,:;()_-]+", spaced)) - {""}


def _is_mass(unit: str) -> bool:
    return _dimension(unit) == {"[mass]": 1.0}


def _dimension(unit: str) -> dict[str, float]:
    """Return the dimensions of a unit; none of what is no unit."""
    try:
        return dimensions_of(unit) if unit else {}
    except ValueError:
        return {}
