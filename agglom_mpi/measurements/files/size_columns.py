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
SIEVES: Final = ("sieve", "sieve size", "class")
"""Headings of sizes that are no diameters of single grains."""
SIZES: Final = ("size", "diameter", "particle size", "particle diameter", *SIEVES)
_WEIGHTS: Final[dict[str, ShareWeight]] = {
    **{"number": "number", "area": "area", "mass": "mass", "volume": "mass"},
}

KNOWN_HEADINGS: Final[dict[str, tuple[Role, ShareWeight | None]]] = {
    **dict.fromkeys(SIZES, ("size", None)),
    **{"lower": ("lower", None), "upper": ("upper", None), "area": ("area", None)},
    **{amount: (amount, None) for amount in AMOUNTS},
    **{
        f"{word} {amount}": (amount, weight)
        for word, weight in _WEIGHTS.items()
        for amount in AMOUNTS
    },
    **{"count": ("share", "number"), "mass": ("share", "mass"), "volume": ("share", "mass")},
    "error": ("error", None),
}
"""Role of a column and what its amounts are of, by its heading in lower case without the unit."""
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


def _column(position: int, own: Heading, known: Heading) -> SizeColumn | None:
    """Return the column with a heading of the file, and the known heading that it stands for."""
    role, weight = KNOWN_HEADINGS.get(known.title.lower(), (None, None))
    unit = known.unit or own.unit or ""
    unit = "" if unit in RELATIVE else "%" if unit in ("%", "percent") else unit
    is_mass = unit not in ("", "%") and is_unit(unit) and dimensions_of(unit) == {"[mass]": 1.0}
    if role is None or (role in AMOUNTS and unit not in ("", "%") and not is_mass):
        return None  # shares per length are none
    return SizeColumn(position, role, "mass" if is_mass else weight, unit, own)
