"""Columns of tables of measured sizes, known by their headings, and the choice among them.

A heading is one of `KNOWN_HEADINGS`, in upper or lower case, with a unit in brackets. What others
mean is not guessed: an entry of `data` states it under `headings`.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Final, Literal, NamedTuple, TypeAlias

from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.units import dimensions_of, quoted, to_si
from agglom_mpi.file_kinds import quoted_start
from agglom_mpi.measurements.files.size_curve import ShareWeight
from agglom_mpi.measurements.files.text_table import (
    Heading,
    TableError,
    TextTable,
    is_unit,
    parse_heading,
)

Role: TypeAlias = Literal[
    "size", "lower", "upper", "area", "passing", "cumulative retained", "retained", "share", "error"
]
"""Role of a column: a size, its edges or the area of a grain's picture; an amount; its error."""
AMOUNTS: Final[tuple[Role, ...]] = ("passing", "cumulative retained", "retained", "share")
SIEVES: Final = ("sieve", "sieve size", "aperture", "opening", "class")
"""Headings of sizes that are no diameters of single grains."""
SIZES: Final = ("size", "diameter", "particle size", "particle diameter", *SIEVES)
SIZE_HEADINGS: Final = (*SIZES, "lower", "upper", "area")
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
        title.format(of=of, word=word): (amount, weight)
        for title in ("{of} {word}", "{word} by {of}")
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
RELATIVE: Final = ("", "1", "-")
"""Units of numbers without a dimension, such as diameters relative to each other."""
CURVE_EXAMPLE: Final = "sieve size (mm)"
"""Heading that messages give as an example."""


class CurveKeys(NamedTuple):
    """Statements of an entry of `data` on its file; None and empty where it makes none.

    Attributes
    ----------
    weight
        What shares are of.
    column
        Heading of the column to read.
    unit
        Unit of sizes whose heading has none.
    error
        Standard error of each share, or of each value of a cumulative curve.
    counted
        Number of grains that were counted.
    headings
        Known headings, such as `passing (%)`, by those of the file.
    """

    weight: ShareWeight | None = None
    column: str = ""
    unit: str = ""
    error: float | None = None
    counted: int | None = None
    headings: Mapping[str, str] = {}


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


def size_columns(table: TextTable, keys: CurveKeys) -> list[SizeColumn]:
    """Return the columns of a table whose headings are known, or are stated to be known ones.

    Raises
    ------
    FieldError
        If the entry gives the meaning of a heading that the file does not have, or an unknown one.
    """
    if not table.headings and table.width == 1 and not keys.headings:
        return [SizeColumn(0, "size", None, "", Heading(""))]
    stated = {parse_heading(own): parse_heading(text) for own, text in keys.headings.items()}
    columns = (_column(i, own, stated.get(own, own)) for i, own in enumerate(table.headings))
    found = [column for column in columns if column is not None]
    if not set(stated) <= {column.heading for column in found}:
        message = "must give headings of the file known ones, like `finer: passing (%)`"
        raise FieldError((("headings",), message))
    return found


def _column(position: int, own: Heading, known: Heading) -> SizeColumn | None:
    """Return the column with a heading of the file, and the known heading that it stands for."""
    title = known.title if known.title in KNOWN_HEADINGS else known.title.lower()
    role, weight = KNOWN_HEADINGS.get(title, (None, None))
    unit = known.unit or own.unit or ""
    unit = "" if unit in RELATIVE else "%" if unit in ("%", "percent") else unit
    is_mass = unit not in ("", "%") and is_unit(unit) and dimensions_of(unit) == {"[mass]": 1.0}
    if role is None or (role in AMOUNTS and unit not in ("", "%") and not is_mass):
        return None  # shares per length are none
    return SizeColumn(position, role, "mass" if is_mass else weight, unit, own)


def amount_column(columns: Sequence[SizeColumn], keys: CurveKeys) -> SizeColumn | None:
    """Return the column of amounts to read; None of a list of single grains.

    Raises
    ------
    FieldError
        If the entry must name one of several columns, names none, or states another weight.
    """
    found = [each for each in named_columns(columns, keys) if each.role in AMOUNTS]
    fitting = [column for column in found if keys.weight in (None, column.weight or keys.weight)]
    if found and not fitting:
        message = f"is '{keys.weight}', but the file has the columns {_titles(found)}"
        raise FieldError((("weight",), message))
    return only_column(fitting) if fitting else None


def named_columns(columns: Sequence[SizeColumn], keys: CurveKeys) -> Sequence[SizeColumn]:
    """Return the columns that the entry names, or all; raise a FieldError if it names none."""
    if not keys.column:
        return columns
    title, unit = parse_heading(keys.column)
    named = [
        column
        for column in columns
        if column.heading.title.lower() == title.lower() and unit in (None, column.heading.unit)
    ]
    if not named:
        message = f"is {quoted(keys.column)}; the file has {_titles(columns)}"
        raise FieldError((("column",), message))
    return named


def only_column(columns: Sequence[SizeColumn]) -> SizeColumn:
    """Return a column; raise a FieldError if the entry must name one of several."""
    if len(columns) > 1:
        headings = {(each.heading.title.lower(), each.heading.unit) for each in columns}
        which = "name one" if len(headings) == len(columns) else "keep one in the file"
        raise FieldError((("column",), f"must {which} of several columns, {_titles(columns)}"))
    return columns[0]


def size_column(columns: Sequence[SizeColumn], *roles: Role) -> SizeColumn:
    """Return the one column with the first of some roles that there is.

    Raises
    ------
    TableError
        If there are several, or none.
    """
    of_roles = ([each for each in columns if each.role == role] for role in roles)
    found = next(filter(None, of_roles), [])
    if not found:
        raise TableError(f"has no column of sizes; must have a heading like '{CURVE_EXAMPLE}'")
    if len(found) > 1:
        raise TableError(f"has several columns of sizes, {_titles(found)}; keep one of them")
    return found[0]


def size_unit(column: SizeColumn, keys: CurveKeys, kind: str = "m", example: str = "um") -> str:
    """Return the unit of a column of sizes, of the kind of an SI unit.

    Raises
    ------
    FieldError
        Unless either the heading or the entry gives a unit of this kind.
    """
    title, own, given = quoted_start(column.heading.title), column.unit, keys.unit
    if own and given:
        message = f"is {quoted(given)}, but the sizes in column {title} are in {quoted(own)}"
        raise FieldError((("unit",), f"{message}; leave it out"))
    if unit := own or given:
        with suppress(ValueError):
            to_si(f"1 {unit}", kind)
            return unit
    found = f"is {quoted(unit) if unit else 'missing'} for the sizes in column {title}"
    must = f"must be one like '{example}', {'in the file' if own else 'here or in the file'}"
    raise FieldError((("unit",), f"{found}; {must}"))


def _titles(columns: Sequence[SizeColumn]) -> str:
    headings = [column.heading for column in columns[:6]]
    return ", ".join(quoted_start(h.title) + (f" ({h.unit})" if h.unit else "") for h in headings)
