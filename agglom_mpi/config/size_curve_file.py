"""Files of measured sizes: cumulative curves, histograms, and lists of single grains.

The headings state what a file holds (`size_headings`), and rows may be in either order with a pan
below the last sieve (`size_rows`). What allows two readings is refused, and the message names what
to write instead. A message names line, column and value, and quotes no more than the start of a
field (`text_table`).
"""

import math
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from agglom_mpi.config.bounded_reading import quoted_start
from agglom_mpi.config.size_choice import CURVE_EXAMPLE, HEADINGS_REMEDY, CurveKeys, SizeTable
from agglom_mpi.config.size_curve import (
    Numbers,
    SizeCurve,
    curve_of_amounts,
    curve_of_counted,
    curve_of_diameters,
    curve_of_passing,
)
from agglom_mpi.config.size_file import MAX_ROWS, in_metres, read_content
from agglom_mpi.config.size_headings import (
    CURVES,
    SIZES,
    SizeColumn,
    is_size_title,
    names_other_amounts,
    size_columns,
)
from agglom_mpi.config.size_rows import SizeRow, classes_between, size_rows
from agglom_mpi.config.table_layout import TableError
from agglom_mpi.config.text_table import TextTable, parse_heading, read_table
from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.units import quoted, to_si

MAX_CLASSES: Final = 300
"""Maximum number of classes of a file."""
MAX_SUM_DEVIATION: Final = 0.02
"""Maximum deviation from 100 % of the sum of all shares, as sieving loses and rounding leaves."""
_ROUNDING: Final = 1e-3
"""Maximum by which a cumulative share may exceed 100 %."""


def read_size_curve(folder: Path, name: str, keys: CurveKeys) -> SizeCurve:
    """Return the curve of a file.

    Raises
    ------
    FieldError
        If the keys of the entry do not fit the file.
    ValueError
        If the file cannot be read, or allows two readings.
    """
    content = read_content(folder, name)
    try:
        named = {parse_heading(own): parse_heading(text) for own, text in keys.headings.items()}
        titles = {heading.title.lower() for heading in named}
        table = read_table(
            content, lambda title: title in titles or is_size_title(title), CURVE_EXAMPLE, MAX_ROWS
        )
        if not set(named) <= set(table.headings) or len(size_columns([*named.values()])) < len(
            named
        ):
            message = "must give headings of the file known ones, like `finer: passing (%)`"
            raise FieldError((("headings",), message))
        headings = tuple(named.get(heading, heading) for heading in table.headings)
        found = _curve(table._replace(headings=headings), keys)
        if len(found.shares) < 2:
            raise TableError(
                "has fewer than two classes with grains, or with enough counted ones; must have two"
            )
        if len(found.shares) > MAX_CLASSES:
            raise TableError(f"has {len(found.shares)} classes; must have at most {MAX_CLASSES}")
    except FieldError:
        raise
    except ValueError as error:
        raise ValueError(f"is {quoted(name)}: {error}") from None
    return found


def _curve(table: TextTable, keys: CurveKeys) -> SizeCurve:
    columns = size_columns(table.headings)
    if not table.headings and table.width == 1:
        columns = [SizeColumn(0, "size", None, "", "")]
    if not any(column.role in SIZES for column in columns):
        raise TableError(f"has no column of sizes; must have a heading like '{CURVE_EXAMPLE}'")
    found = SizeTable(table, columns, keys)
    amount = found.amount()
    if amount is None:
        return _listed(found)
    if keys.weight and amount.weight and keys.weight != amount.weight:
        column = quoted_start(amount.title)
        message = f"is '{keys.weight}', but the column {column} of the file is by {amount.weight}"
        raise FieldError((("weight",), message))
    return _cumulative(found, amount) if amount.role in CURVES else _histogram(found, amount)


def _check_sizes(found: SizeTable, rows: list[SizeRow], sizes: Numbers, column: SizeColumn) -> None:
    """Raise a TableError unless sizes ascend; the last are those of the rows."""
    if len(sizes) < 2:
        raise TableError("has no two sizes with amounts; must have at least two")
    for row, low, high in zip(rows[::-1], sizes[-2::-1], sizes[:0:-1], strict=False):
        if not low < high:
            shown = found.shown(row.position, column)
            raise TableError(f"{shown} makes a class without width; must lie above the one below")


# Cumulative curves


def _cumulative(found: SizeTable, amount: SizeColumn) -> SizeCurve:
    is_oversize = amount.role == "cumulative retained"
    column = found.sizes(("size", *(("lower", "upper") if is_oversize else ("upper", "lower"))))
    rows = size_rows(found.table, [column.position], found.unit(column))
    rows = [row for row in rows if row.upper > 0.0 or not found.is_empty(row.position, amount)]
    values, scale = _cumulative_values(found, amount, rows)
    if is_oversize or (amount.role == "cumulative" and values[-1] < values[0]):
        values, is_oversize = 1.0 - values, True
    _check_ascent(found, amount, rows, values)
    if not found.keys.column:
        _refuse_contradiction(found, amount, rows, values)
    sizes = np.array([row.lower if is_oversize else row.upper for row in rows])
    errors = found.errors(amount, rows, scale, (values > 0.0) & (values < 1.0))
    if sizes[0] == 0.0:  # the pan, below which there is nothing
        if values[0] > MAX_SUM_DEVIATION:
            raise TableError(f"{found.shown(rows[0].position, amount)}; must be 0 % at size 0")
        values[0] = 0.0
    kept = slice(0, -1) if np.isinf(sizes[-1]) else slice(None)
    rows, sizes, values = rows[kept], sizes[kept], values[kept]
    _check_sizes(found, rows, np.array([-1.0, *sizes]), column)
    weight = amount.weight or found.keys.weight or "mass"
    if errors is not None:
        return curve_of_passing(sizes, values, errors[kept], weight)
    curve = curve_of_passing(sizes, values, np.zeros(len(values)), weight)
    return _counted(curve, found.required_count())


def _cumulative_values(
    found: SizeTable, amount: SizeColumn, rows: list[SizeRow]
) -> tuple[Numbers, float]:
    """Return cumulative shares from 0 to 1, shape (n,), and the factor of what is written."""
    numbers = found.numbers(rows, amount)
    largest = max(numbers.tolist(), default=0.0)
    if amount.is_percent or (not amount.unit and abs(largest - 100.0) <= 0.1):
        scale = 0.01
    elif not amount.unit and largest <= 1.0 + _ROUNDING:
        scale = 1.0
    else:
        title = quoted_start(amount.title)
        unit = f"the unit {quoted_start(amount.unit)}" if amount.unit else "no unit"
        raise TableError(f"column {title} has {unit}; a cumulative curve must be in % or fractions")
    values = numbers * scale
    for row, value in zip(rows, values, strict=True):
        if not 0.0 <= value <= 1.0 + _ROUNDING:
            shown = found.shown(row.position, amount)
            raise TableError(f"{shown}; must be from 0 to {1.0 / scale:g}")
    return np.minimum(values, 1.0), scale


def _check_ascent(
    found: SizeTable, amount: SizeColumn, rows: list[SizeRow], values: Numbers
) -> None:
    """Raise a TableError unless there are values, which grow with the size."""
    if not rows:
        raise TableError("has no row with a size above 0")
    for (low, small), (high, large) in pairwise(zip(rows, values, strict=True)):
        if large < small:
            line = found.table.lines[low.position]
            other = found.table.field(low.position, amount.position)
            message = f"{found.shown(high.position, amount)} contradicts {other} in line {line}"
            raise TableError(f"{message}; a cumulative curve must not turn back")


def _refuse_contradiction(
    found: SizeTable, amount: SizeColumn, rows: list[SizeRow], passing: Numbers
) -> None:
    """Raise a TableError if a column of retained shares differs from a curve, both (n,), by 2 %."""
    for column in found.columns:
        if column.role not in ("retained", "cumulative retained") or column is amount:
            continue
        with suppress(TableError):
            numbers, expected = found.numbers(rows, column), 1.0 - passing
            if column.role == "retained":
                expected = np.diff(passing, append=1.0)
            scale = 1.0 if not column.unit and numbers.max() <= 1.0 else 0.01
            if column.unit not in ("", "%") and numbers.any():  # masses
                scale = expected.sum() / numbers.sum()
            if np.abs(numbers * scale - expected).max() > MAX_SUM_DEVIATION:
                first, other = quoted_start(amount.title), quoted_start(column.title)
                message = f"column {other} of the file contradicts {first}; name the one to read"
                raise FieldError((("column",), message))


# Histograms


def _histogram(found: SizeTable, amount: SizeColumn) -> SizeCurve:
    rows, column = _classes(found, amount)
    numbers = found.numbers(rows, amount)
    for row, number in zip(rows, numbers, strict=True):
        if number < 0.0:
            raise TableError(f"{found.shown(row.position, amount)}; must be at least 0")
    edges = np.array([*(row.lower for row in rows[:1]), *(row.upper for row in rows)])
    _check_sizes(found, rows, edges, column)
    total, is_count = _total(amount, numbers)
    weight = amount.weight or found.keys.weight or "mass"
    errors = found.errors(amount, rows, 1.0 / total, np.ones(len(rows), bool))
    if errors is not None:
        return curve_of_amounts(edges, numbers / total, errors, weight)
    curve = curve_of_amounts(edges, numbers / total, np.zeros(len(numbers)), weight)
    if is_count:
        return _counted(curve, float(found.keys.counted or total))
    return _counted(curve, found.required_count())


def _classes(found: SizeTable, amount: SizeColumn) -> tuple[list[SizeRow], SizeColumn]:
    """Return a row for each class, ascending, and the column of sizes that states it."""
    roles = {column.role for column in found.columns}
    if {"lower", "upper"} <= roles and "size" not in roles:
        pair = [found.sizes([role]) for role in ("lower", "upper")]
        unit = found.unit(pair[0] if pair[0].unit else pair[1])
        rows = size_rows(found.table, [column.position for column in pair], unit)
        return classes_between(found.table, pair[0].position, rows), pair[0]
    column = found.sizes(("size", "lower", "upper", "middle"))
    rows = size_rows(found.table, [column.position], found.unit(column))
    if any(row.is_class for row in rows):
        return classes_between(found.table, column.position, rows), column
    return _classes_of_edges(found, amount, column, rows), column


def _classes_of_edges(
    found: SizeTable, amount: SizeColumn, column: SizeColumn, rows: list[SizeRow]
) -> list[SizeRow]:
    """Return the classes of rows with one size each, a lower or an upper edge.

    A row without an amount at one end gives the last edge. What is retained lies above its sieve.
    """
    edges = [row.upper for row in rows]
    begins, ends = (found.is_empty(rows[i].position, amount) for i in (0, -1))
    if column.role != "upper" and ends:
        return _between(rows[:-1], edges)
    if column.role != "lower" and begins:
        return _between(rows[1:], edges)
    if column.role == "upper":
        return _between(rows, [0.0, *edges])
    if amount.role == "retained" and edges[0] > 0.0 and not amount.is_percent:
        raise TableError(
            "has no row of what passed the last sieve; must have a last row 'pan' (0 if none)"
        )
    if amount.role == "retained" or column.role == "lower":
        return _between(rows, [*edges, math.inf])
    raise TableError(
        f"column {quoted_start(column.title)} can be the lower edges of the classes, the upper "
        "ones, or their middles; must be titled 'lower' or 'upper', or hold classes like 63-125"
    )


def _between(rows: list[SizeRow], edges: list[float]) -> list[SizeRow]:
    """Return a row for each pair of neighbouring edges."""
    return [
        row._replace(lower=lower, upper=upper)
        for row, (lower, upper) in zip(rows, pairwise(edges), strict=True)
    ]


def _total(amount: SizeColumn, numbers: Numbers) -> tuple[float, bool]:
    """Return what the amounts sum to, and whether they are counts."""
    total, title = float(numbers.sum()), quoted_start(amount.title)
    if total <= 0.0:
        raise TableError(f"column {title} sums to 0; must have grains in some class")
    is_whole = bool(np.all(numbers == np.round(numbers)))
    if amount.unit and not amount.is_percent:
        return total, False
    if not amount.unit and amount.weight == "number" and is_whole:
        return total, True
    wholes = (100.0,) if amount.is_percent else (1.0, 100.0)
    if all(abs(total / whole - 1.0) > MAX_SUM_DEVIATION for whole in wholes):
        allowed = "100 %" if amount.is_percent else "1, or have the unit % or g"
        raise TableError(f"column {title} sums to {total:.6g}; must sum to {allowed}")
    return total, False


def _counted(curve: SizeCurve, counted: float) -> SizeCurve:
    """Return a curve with the errors of a number of counted grains."""
    if len(curve.shares) < 2:
        return curve
    return curve_of_counted(np.array(curve.edges), np.array(curve.shares), counted, curve.weight)


# Single grains


def _listed(found: SizeTable) -> SizeCurve:
    """Return the curve of a file with one grain in each row."""
    column = found.grains()
    numbers = found.table.numbers(column.position)
    _refuse_amounts(found.table, numbers, bool(found.keys.column))
    for name in ("error", "counted"):
        given = getattr(found.keys, name)
        if given is not None:
            message = f"is {given:g}, but the file has a row for each grain, which counts itself"
            raise FieldError(((name,), f"{message}; leave it out"))
    for row, number in enumerate(numbers):
        if number <= 0.0:
            raise TableError(f"{found.shown(row, column)}; must be greater than 0")
    if column.role == "projected area":  # the diameter of a circle with this area
        factor = to_si(f"1 {found.unit(column, 'm^2', 'um^2')}", "m^2")
        diameters = np.sqrt(4.0 / math.pi * factor * np.array(numbers))
    else:
        diameters = np.array(in_metres(numbers, found.unit(column)))
    return curve_of_diameters(diameters, found.keys.weight or "mass")


def _refuse_amounts(table: TextTable, diameters: list[float], is_named: bool) -> None:
    """Raise a TableError if a column seems to be the amount of each size, by none of the weights.

    Sizes beside others that are in order and all different are classes, unless their column is
    named as that of single grains.
    """
    others = [heading.title for heading in table.headings if names_other_amounts(heading)]
    steps = {(b > a) - (b < a) for a, b in pairwise(diameters)}
    if not others and not is_named and len(diameters) > 2 and steps in ({1}, {-1}):
        others = [
            heading.title for heading in table.headings if not is_size_title(heading.title.lower())
        ]
    if others:
        raise TableError(
            f"has column {quoted_start(others[0])} beside the sizes, which is no known amount by "
            f"number, area or mass; {HEADINGS_REMEDY}"
        )
