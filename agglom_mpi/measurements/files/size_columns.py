"""Columns of tables of measured sizes, known by their headings.

A heading is one of `KNOWN_HEADINGS`, in upper or lower case, with a unit in brackets. What others
mean is not guessed: an entry of `data` states it under `headings`.
"""

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple, TypeAlias

from agglom_mpi.declaration.units import dimensions_of
from agglom_mpi.measurements.files.size_curve import ShareWeight
from agglom_mpi.measurements.files.text_table import Heading, TextTable, is_unit

Role: TypeAlias = Literal[
    "size", "lower", "upper", "area", "passing", "cumulative retained", "retained", "share", "error"
]
"""Role of a column: a size, its edges or the area of a grain's picture; an amount; its error."""
AMOUNTS: Final[tuple[Role, ...]] = ("passing", "cumulative retained", "retained", "share")
SIEVES: Final = ("sieve", "sieve size", "aperture", "opening", "class")
"""Headings of sizes that are no diameters of single grains."""
SIZES: Final = ("size", "diameter", "particle size", "particle diameter", *SIEVES)
_WORDS: Final[dict[str, Role]] = {
    **{amount: amount for amount in AMOUNTS},
    **dict.fromkeys(("finer", "undersize", "cumulative passing"), "passing"),
    **dict.fromkeys(("oversize", "coarser"), "cumulative retained"),
    **dict.fromkeys(("fraction", "frequency"), "share"),
}
"""Amounts by their English words."""
_WEIGHTS: Final[dict[str, ShareWeight]] = {
    **{"number": "number", "area": "area", "mass": "mass", "volume": "mass"},
    **{"weight": "mass", "vol": "mass"},
}
_SIGNS: Final[dict[str, ShareWeight]] = {"0": "number", "2": "area", "3": "mass"}
"""Weight of an amount (number, area, mass) by the digit of its sign in ISO 9276."""

KNOWN_HEADINGS: Final[dict[str, tuple[Role, ShareWeight | None]]] = {
    **dict.fromkeys(SIZES, ("size", None)),
    **{"lower": ("lower", None), "upper": ("upper", None), "area": ("area", None)},
    **{word: (amount, None) for word, amount in _WORDS.items()},
    **{
        f"{of} {word}": (amount, weight)
        for of, weight in _WEIGHTS.items()
        for word, amount in _WORDS.items()
    },
    **{f"Q{digit}": ("passing", weight) for digit, weight in _SIGNS.items()},
    **{"count": ("share", "number"), "mass": ("share", "mass"), "volume": ("share", "mass")},
    **dict.fromkeys(("error", "sd", "std"), ("error", None)),
}
"""Role of a column and what its amounts are of, by its heading without the unit.

Words are in lower case; the signs of ISO 9276 are as written, as q3 is a density.
"""
SIZE_HEADINGS: Final = (*SIZES, "lower", "upper", "area")

RELATIVE: Final = ("", "1", "-")
"""Units of numbers without a dimension, such as diameters relative to each other."""


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
    heading
        Heading as written.
    """

    position: int
    role: Role
    weight: ShareWeight | None
    unit: str
    heading: Heading


def size_columns(table: TextTable, stated: Mapping[Heading, Heading]) -> list[SizeColumn]:
    """Return the columns of a table whose headings are known, or are `stated` to be known ones."""
    if not table.headings and table.width == 1:
        return [SizeColumn(0, "size", None, "", Heading(""))]
    found = (_column(i, own, stated.get(own, own)) for i, own in enumerate(table.headings))
    return [column for column in found if column is not None]


def _meaning(title: str) -> tuple[Role, ShareWeight | None] | None:
    return KNOWN_HEADINGS.get(title if title in KNOWN_HEADINGS else title.lower())


def _column(position: int, own: Heading, known: Heading) -> SizeColumn | None:
    """Return the column with a heading of the file, and the known heading that it stands for."""
    role, weight = _meaning(known.title) or (None, None)
    unit = known.unit or own.unit or ""
    unit = "" if unit in RELATIVE else "%" if unit in ("%", "percent") else unit
    is_mass = unit not in ("", "%") and is_unit(unit) and dimensions_of(unit) == {"[mass]": 1.0}
    if role is None or (role in AMOUNTS and unit not in ("", "%") and not is_mass):
        return None  # shares per length are none
    return SizeColumn(position, role, "mass" if is_mass else weight, unit, own)
