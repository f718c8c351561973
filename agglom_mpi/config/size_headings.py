"""Headings of tables of measured sizes, in the words of instruments and laboratories.

A heading states the role of its column by its words, English or German and some French, and by the
signs of ISO 9276: `Q3` is the cumulative share by volume, `p0` the share of a class by number.
"""

import re
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple, TypeAlias

from agglom_mpi.config.size_curve import ShareWeight
from agglom_mpi.config.size_file import RELATIVE, is_diameter
from agglom_mpi.config.text_table import Heading, parse_heading
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
    *("size", "sizes", "sieve", "sieves", "mesh", "opening", "aperture", "x", "channel", "class"),
    *("siebweite", "maschenweite", "korngröße", "korngrösse", "korngroesse", "partikelgröße"),
    *("partikelgrösse", "kornklasse", "klasse", "tamis", "feret", "minferet", "diam"),
}
_BESIDE_SIZES: Final = {
    *("particle", "grain", "of", "the", "edge", "limit", "bound", "range", "nominal", "equivalent"),
    *("bin", "d", "min", "max", "interval", "no", "test"),
}
"""Words that may stand beside those of a size."""
_LOWER: Final = {"lower", "from", "von", "x1", "low"}
_UPPER: Final = {"upper", "to", "bis", "x2", "high", "xo", "x0"}
_MIDDLE: Final = {"mid", "middle", "centre", "center", "midpoint", "xm", "klassenmitte"}
_PASSING: Final = {
    *("passing", "passed", "pass", "undersize", "finer", "below", "under", "durchgang"),
    *("siebdurchgang", "passant", "passants", "tamisat", "tamisats"),
}
_CUMULATIVE: Final = {
    *("cumulative", "cumul", "cum", "cumulated", "kumuliert", "kumulativ", "summe"),
    *("summenverteilung", "cumulé", "cumulés", "accumulated"),
}
_RETAINED: Final = {"retained", "rückstand", "rueckstand", "siebrückstand", "refus"}
_OVERSIZE: Final = {"oversize", "coarser", "above", "rückstandssumme", "rueckstandssumme"}
_ERROR: Final = {
    *("error", "errors", "sd", "std", "stdev", "sigma", "uncertainty", "deviation"),
    *("fehler", "unsicherheit", "standardabweichung"),
}
_WEIGHTS: Final[dict[ShareWeight, set[str]]] = {
    "number": {"number", "numbers", "count", "counts", "anzahl", "particles", "nombre"},
    "area": {"area", "surface", "oberfläche"},
    "mass": {
        *("volume", "vol", "mass", "weight", "masse", "massenanteil", "volumen", "wt"),
        *("volumenanteil", "gewicht", "poids"),
    },
}
_OTHER_AMOUNTS: Final = {
    *("frequency", "share", "shares", "fraction", "percent", "percentage", "amount", "anteil"),
    *("häufigkeit", "chan", "histogram", "proportion", "relative"),
}
_SIGN: Final = re.compile(r"(?<!\w)(Q|[pP]|[dΔ]Q)([023])(?!\w)")
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
    return _size_role(title, _words(title)) is not None


def names_other_amounts(heading: Heading) -> bool:
    """Return whether a column has amounts by none of the weights: by intensity, or per length."""
    words = _words(heading.title)
    is_percent = "%" in f"{heading.title}{heading.unit or ''}"
    return is_percent or bool(words & {"density", "dichte", "intensity", "intensität"})


def _column(index: int, heading: Heading) -> SizeColumn | None:
    if (heading.unit or "").lower() in _LOWER | _UPPER | _MIDDLE:  # `Diameter (Lower) um`
        rest = parse_heading(heading.title)
        heading = Heading(f"{rest.title} {heading.unit}", rest.unit)
    text = f"{heading.title} {heading.unit or ''}"
    words = _words(text)
    is_percent = "%" in text or bool(words & {"percent", "percentage", "prozent"})
    unit = "%" if is_percent else heading.unit or ""
    unit = "" if unit in RELATIVE else unit
    role = None if is_percent else _size_role(heading.title.lower(), _words(heading.title))
    sign = _SIGN.search(heading.title)
    weight = next((key for key, names in _WEIGHTS.items() if words & names), None)
    if sign is not None:
        role, weight = ("passing" if sign[1] == "Q" else "amount"), _SIGN_WEIGHTS[sign[2]]
    elif role is None:
        role = _amount_role(words, text)
        if role in AMOUNTS and unit not in ("", "%") and not _is_mass(unit):
            return None  # a density, in shares per length
        if role is not None and _is_mass(unit):
            weight = "mass"
    return None if role is None else SizeColumn(index, role, weight, unit, heading.title)


def _size_role(title: str, words: set[str]) -> Role | None:
    """Return the role of a column of sizes."""
    if title == "area":  # that of a particle's picture
        return "projected area"
    others = words - _SIZE_WORDS - _BESIDE_SIZES
    is_size = bool(words & _SIZE_WORDS) or is_diameter(title)
    if is_diameter(title):
        others = {word for word in others if not is_diameter(word)}
    roles: tuple[tuple[Role, set[str]], ...] = (
        *(("lower", _LOWER), ("upper", _UPPER), ("middle", _MIDDLE)),
    )
    for role, names in roles:
        if others & names and others <= names:
            return role
    if is_size and words & {"min", "max"}:
        return "lower" if "min" in words else "upper"
    is_alone = not others or (is_diameter(title) and not others & _ERROR)
    return "size" if is_size and is_alone else None


def _amount_role(words: set[str], text: str) -> Role | None:
    """Return the role of a column of amounts, or of their errors."""
    if words & _ERROR or "±" in text:
        return "error"
    if words & _OVERSIZE or (words & _RETAINED and words & _CUMULATIVE):
        return "cumulative retained"
    if words & _RETAINED:
        return "retained"
    if words & _PASSING:
        return "passing"
    if words & _CUMULATIVE:
        return "cumulative"
    if words & {"intensity", "intensität"}:
        return None
    named = _OTHER_AMOUNTS.union(*_WEIGHTS.values())
    return "amount" if words & named or "%" in text else None


def _words(text: str) -> set[str]:
    return set(re.findall(r"[^\W_]+", text.lower()))


def _is_mass(unit: str) -> bool:
    return _dimension(unit) == {"[mass]": 1.0}


def _dimension(unit: str) -> dict[str, float]:
    """Return the dimensions of a unit; none of what is no unit."""
    try:
        return dimensions_of(unit) if unit else {}
    except ValueError:
        return {}
