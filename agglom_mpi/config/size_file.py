"""The file of sizes that a scene may name: read beside the campaign, or from its identity."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

from agglom_mpi.config.bounded_reading import quoted_start, read_bounded
from agglom_mpi.config.table_layout import TableError, is_number, is_unit, too_many_rows
from agglom_mpi.config.text_table import TextTable, read_table
from agglom_mpi.declaration.spelling import MAX_MAGNITUDE
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.file_kinds import begins_as_hdf5

MAX_BYTES: Final = 1 << 23
"""Largest size of a file of sizes."""
MAX_ROWS: Final = 100_000
MAX_RATIO: Final = 100.0
"""Largest over smallest diameter, at most."""

EXAMPLE: Final = "diameter (um)"
"""Heading that messages give as an example."""
RELATIVE: Final = ("", "1", "-")
"""Units of diameters that are relative to each other."""
DIAMETERS: Final = {"diameter", "diameters", "size", "sizes"}
"""Words of titles of columns of diameters."""
BESIDE_DIAMETERS: Final = {
    *("particle", "particles", "grain", "grains", "equivalent", "circle", "circular", "sphere"),
    *("spherical", "area", "volume", "projected", "feret", "martin", "mean", "min", "max"),
    *("of", "the", "each"),
}
"""Words that may stand beside them; with any other one, a title may mean half or a logarithm."""
_SIEVE: Final = ("sieve", "mesh", "aperture")
"""Words in titles of columns with the classes of a curve, which is refused by what it is."""
_AMOUNT: Final = {
    *("count", "frequency", "fraction", "share", "volume", "mass", "weight", "percent", "density"),
    *("cumulative", "passing", "retained", "undersize", "oversize", "number"),
}
"""Words in titles of columns with the amount of grains of each size."""


class Diameters(NamedTuple):
    """Diameters of grains: in m if they are `absolute`, else relative to each other."""

    values: tuple[float, ...]
    absolute: bool


SizeReader = Callable[[str], Diameters]
"""Returns the diameters of a file by its name; raises a ValueError that says what is wrong."""


def unread(name: str) -> Diameters:
    """Refuse a file of sizes: a campaign's text alone does not say where it is."""
    raise ValueError(f"is {quoted(name)}, which is read beside a campaign file; this text has none")


def read_beside(folder: Path) -> SizeReader:
    """Return a reader of files in a folder."""
    return lambda name: read_diameters(folder, name)


def recorded_sizes(identity: Mapping[str, Any]) -> SizeReader:
    """Return a reader that gives the diameters of a stored campaign's identity, whatever the file.

    Raises
    ------
    ValueError
        By the reader, if they are damaged.
    """

    def read(name: str) -> Diameters:
        text, unit = (identity.get(f"scene.sizes.{key}") for key in ("diameters", "unit"))
        words = str(text).split()
        values = tuple(float(word) if is_number(word) else 0.0 for word in words)
        try:
            _check(values, lambda row: f"diameter {row + 1}: {quoted_start(words[row])}")
        except ValueError as error:
            raise ValueError(f"is {quoted(name)}: {error}") from None
        return Diameters(values, unit == "m")

    return read


def read_diameters(folder: Path, name: str) -> Diameters:
    """Read the diameters of a table with one grain a row, under a heading like `diameter (um)`.

    Without a heading, or a unit in it, they are relative to each other. Other columns are left out,
    but for amounts: a histogram is refused.

    Raises
    ------
    ValueError
        If it cannot be read, or holds something else.
    """
    content = read_content(folder, name)
    try:
        return _diameters(read_table(content, _is_size, EXAMPLE, MAX_ROWS))
    except ValueError as error:
        raise ValueError(f"is {quoted(name)}: {error}") from None


def read_content(folder: Path, name: str) -> bytes:
    """Return the bytes of a file that a campaign names; raise a ValueError if it is no text."""
    if not name.isprintable():
        raise ValueError(f"is {quoted(name)}, which holds a character that cannot be printed")
    path = folder / name
    if begins_as_hdf5(path):
        raise ValueError(f"is {quoted(name)}, an HDF5 file; must be a text file with a table")
    try:
        return read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise ValueError(
            f"is {quoted(name)}, but {path} cannot be read: {error.strerror}"
        ) from None


def is_diameter(title: str) -> bool:
    """Return whether a column's title, in lower case and without its unit, is that of diameters."""
    words = set(title.replace("-", " ").split())
    return bool(words & DIAMETERS) and words <= DIAMETERS | BESIDE_DIAMETERS


def _is_size(title: str) -> bool:
    """Return whether a column's title is that of diameters, or of the sieves of a curve."""
    return is_diameter(title) or any(word.removesuffix("s") in _SIEVE for word in title.split())


def _diameters(table: TextTable) -> Diameters:
    """Return the diameters of a table."""
    column = _column(table)
    unit = (table.headings[column].unit or "") if table.headings else ""
    numbers = table.numbers(column)
    _check(numbers, lambda row: f"{table.place(row, column)}: {table.field(row, column)}")
    _refuse_histogram(table, column, numbers)
    return Diameters(tuple(in_metres(numbers, unit)), unit not in RELATIVE)


def in_metres(numbers: Sequence[float], unit: str) -> list[float]:
    """Return lengths in m; unchanged of no unit. Raise a TableError if the unit is none of length.

    40 um are 40/1e6 m to the bit, as in a campaign file; 40 * 1e-6 are not.
    """
    factor = _metres(unit)
    whole = round(1.0 / factor)
    divides = whole > 0 and 1.0 / whole == factor
    return [number / whole if divides else number * factor for number in numbers]


def _metres(unit: str) -> float:
    """Return the size of a unit in m, 1 of none."""
    if unit in RELATIVE:
        return 1.0
    if is_unit(unit):
        with suppress(ValueError):
            return to_si(f"1 {unit}", "m")
    raise TableError(
        f"the diameters have the unit {quoted_start(unit)}; "
        "must be one of length like 'um', or none"
    )


def _column(table: TextTable) -> int:
    """Return the index of the column of diameters."""
    if not table.headings and table.width > 1:
        raise TableError(
            f"has {table.width} columns without headings; must have a heading like '{EXAMPLE}' "
            "above the diameters"
        )
    found = [i for i, heading in enumerate(table.headings) if is_diameter(heading.title.lower())]
    if len(found) > 1:
        names = ", ".join(quoted_start(table.headings[i].title) for i in found[:3])
        raise TableError(f"has {len(found)} columns of diameters, {names}; keep one of them")
    if table.headings and not found and table.width == 1:  # the only other title of `_is_size`
        title = quoted_start(table.headings[0].title)
        raise TableError(f"lists sieves, {title}; must have grains under '{EXAMPLE}'")
    return found[0] if found else 0


def _refuse_histogram(table: TextTable, column: int, numbers: Sequence[float]) -> None:
    """Raise a TableError if another column seems to say how many grains have each size.

    It has such a title, or the sizes of several columns are in order and all different, as classes
    are.
    """
    others = [heading for i, heading in enumerate(table.headings) if i != column]
    amounts = [
        heading.title
        for heading in others
        if heading.unit in ("%", "percent")
        or any({word, word.removesuffix("s")} & _AMOUNT for word in heading.title.lower().split())
    ]
    steps = {(b > a) - (b < a) for a, b in pairwise(numbers)}
    if amounts or (others and len(numbers) > 2 and steps in ({1}, {-1})):
        beside = quoted_start(amounts[0] if amounts else others[0].title)
        raise TableError(
            f"reads like a sieve curve or histogram, whose column {beside} seems to be an amount "
            "of each size; a file of sizes must have one grain per row. For a curve by mass give "
            "a law, such as {law: lognormal, median: d50, spread: (d84/d16)^0.5, basis: volume}"
        )


def _check(numbers: Sequence[float], place: Callable[[int], str]) -> None:
    """Raise a ValueError unless numbers can be diameters; `place` names the field of a row."""
    if not numbers:
        raise TableError("has no rows below its headings")
    if len(numbers) > MAX_ROWS:
        raise too_many_rows(len(numbers), MAX_ROWS)
    for row, number in enumerate(numbers):
        if not 0.0 < number < MAX_MAGNITUDE:
            raise TableError(f"{place(row)}; must be a number greater than 0")
    low, high = min(numbers), max(numbers)
    if high > MAX_RATIO * low:
        raise TableError(
            f"has diameters from {low:g} to {high:g}; the largest must be at most {MAX_RATIO:g} "
            "times the smallest"
        )
