"""Files of measured sizes: cumulative curves, histograms, and lists of single grains.

The headings state what a file holds (`size_headings`), and rows may be in either order with a pan
below the last sieve (`size_rows`). What allows two readings is refused, and the message names what
to write instead. A message names line, column and value, and quotes no more than the start of a
field (`text_table`).
"""

import math
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from agglom_mpi.config.bounded_reading import quoted_start
from agglom_mpi.config.size_choice import (
    CURVE_EXAMPLE,
    CurveKeys,
    amount_column,
    required_count,
    share_errors,
    size_column,
    unit_of_sizes,
)
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
        found = _curve(read_table(content, is_size_title, CURVE_EXAMPLE, MAX_ROWS), keys)
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
    amount = amount_column(table, columns, keys)
    if amount is None:
        return _listed(table, columns, keys)
    if keys.weight and amount.weight and keys.weight != amount.weight:
        column = quoted_start(amount.title)
        message = f"is '{keys.weight}', but the column {column} of the file is by {amount.weight}"
        raise FieldError((("weight",), message))
    reader = _cumulative if amount.role in CURVES else _histogram
    return reader(table, columns, amount, keys)


# Cumulative curves


def _cumulative(
    table: TextTable, columns: list[SizeColumn], amount: SizeColumn, keys: CurveKeys
) -> SizeCurve:
    order = ("size", "lower") if amount.role == "cumulative retained" else ("size", "upper")
    column = size_column(columns, (*order, "lower", "upper"), keys)
    rows = size_rows(table, [column.position], unit_of_sizes(column, keys))
    rows = [row for row in rows if row.upper > 0.0 or table.cell(row.position, amount.position)]
    values, scale = _cumulative_values(table, amount, rows)
    retained = amount.role == "cumulative retained"
    if retained or (amount.role == "cumulative" and values[-1] < values[0]):
        values, retained = 1.0 - values, True
    _check_ascent(table, amount, rows, values)
    sizes = np.array([row.lower if retained and row.is_class else row.upper for row in rows])
    inner = (values > 0.0) & (values < 1.0)
    errors = share_errors(table, columns, amount, rows, keys, scale, inner)
    if sizes[0] == 0.0:  # the pan, below which there is nothing
        if values[0] > MAX_SUM_DEVIATION:
            raise TableError(f"{_cell(table, rows[0], amount)}; must be 0 at size 0")
        values[0] = 0.0
    kept = slice(0, -1) if np.isinf(sizes[-1]) else slice(None)
    sizes, values = sizes[kept], values[kept]
    if not len(sizes):
        raise TableError("has no size but an open class; must have at least one sieve")
    weight = amount.weight or keys.weight or "mass"
    if errors is not None:
        return curve_of_passing(sizes, values, errors[kept], weight)
    zeros = np.zeros(len(values))
    curve = curve_of_passing(sizes, values, zeros, weight)
    return _counted(curve, required_count(keys))


def _cumulative_values(
    table: TextTable, amount: SizeColumn, rows: list[SizeRow]
) -> tuple[Numbers, float]:
    """Return cumulative shares from 0 to 1, shape (n,), and the factor of what is written."""
    numbers = np.array([table.number(row.position, amount.position) for row in rows])
    largest = float(numbers.max())
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
            raise TableError(f"{_cell(table, row, amount)}; must be from 0 to {1.0 / scale:g}")
    return np.minimum(values, 1.0), scale


def _check_ascent(
    table: TextTable, amount: SizeColumn, rows: list[SizeRow], values: Numbers
) -> None:
    """Raise a TableError unless what is smaller than a size grows with the size."""
    for (low, small), (high, large) in pairwise(zip(rows, values, strict=True)):
        if large < small:
            field, line = table.field(low.position, amount.position), table.lines[low.position]
            message = f"{_cell(table, high, amount)} contradicts {field} in line {line}"
            raise TableError(f"{message}; a cumulative curve must not turn back")


def _cell(table: TextTable, row: SizeRow, column: SizeColumn) -> str:
    """Return the place of a field with its value, as a message begins."""
    return table.shown(row.position, column.position)


# Histograms


def _histogram(
    table: TextTable, columns: list[SizeColumn], amount: SizeColumn, keys: CurveKeys
) -> SizeCurve:
    rows = _classes(table, columns, amount, keys)
    numbers = np.array([table.number(row.position, amount.position) for row in rows])
    for row, number in zip(rows, numbers, strict=True):
        if number < 0.0:
            raise TableError(f"{_cell(table, row, amount)}; must be at least 0")
    total, is_count = _total(amount, numbers)
    weight = amount.weight or keys.weight or "mass"
    edges = np.array([rows[0].lower, *(row.upper for row in rows)])
    errors = share_errors(table, columns, amount, rows, keys, 1.0 / total, np.ones(len(rows), bool))
    if errors is not None:
        return curve_of_amounts(edges, numbers / total, errors, weight)
    zeros = np.zeros(len(numbers))
    counted = float(keys.counted or numbers.sum()) if is_count else required_count(keys)
    return _counted(curve_of_amounts(edges, numbers / total, zeros, weight), counted)


def _classes(
    table: TextTable, columns: list[SizeColumn], amount: SizeColumn, keys: CurveKeys
) -> list[SizeRow]:
    """Return a row for each class, ascending, by what the columns of sizes state."""
    roles = {column.role for column in columns}
    if {"lower", "upper"} <= roles and "size" not in roles:
        pair = [size_column(columns, (role,), keys) for role in ("lower", "upper")]
        unit = unit_of_sizes(pair[0] if pair[0].unit else pair[1], keys)
        rows = size_rows(table, [column.position for column in pair], unit)
        return classes_between(table, pair[0].position, rows)
    column = size_column(columns, ("size", "lower", "upper", "middle"), keys)
    rows = size_rows(table, [column.position], unit_of_sizes(column, keys))
    if any(row.is_class for row in rows):
        return classes_between(table, column.position, rows)
    upper = [row.upper for row in rows]
    if column.role != "upper" and not table.cell(rows[-1].position, amount.position):
        return _between(rows[:-1], upper)
    if column.role == "upper" or not table.cell(rows[0].position, amount.position):
        is_edge = not table.cell(rows[0].position, amount.position)
        return _between(rows[1:], upper) if is_edge else _between(rows, [0.0, *upper])
    if amount.role == "retained" or column.role == "lower":
        if amount.role == "retained" and upper[0] > 0.0 and not amount.is_percent:
            raise TableError(
                "has no row of what passed the last sieve; must have a last row 'pan' (0 if none)"
            )
        return _between(rows, [*upper, math.inf])
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
    """Return a curve with the errors of so many counted grains."""
    if len(curve.shares) < 2:
        return curve
    return curve_of_counted(np.array(curve.edges), np.array(curve.shares), counted, curve.weight)


# Single grains


def _listed(table: TextTable, columns: list[SizeColumn], keys: CurveKeys) -> SizeCurve:
    """Return the curve of a file with one grain in each row."""
    for name in ("error", "counted"):
        if getattr(keys, name) is not None:
            message = f"is {getattr(keys, name):g}, but the file has a row for each grain"
            raise FieldError(((name,), f"{message}, which counts itself; leave it out"))
    sizes = [column for column in columns if column.role in ("size", "projected area")]
    wanted = parse_heading(keys.column).title.lower() if keys.column else ""
    named = [column for column in sizes if column.title.lower() == wanted]
    chosen = named or [column for column in sizes if column.is_length] or sizes
    if not chosen:
        raise TableError("has no column of amounts beside its classes, and none of diameters")
    if len(chosen) > 1:
        titles = ", ".join(quoted_start(column.title) for column in chosen[:4])
        message = f"is missing; the file has {titles}, of which it must name one"
        raise FieldError((("column",), message))
    (column,) = chosen
    numbers = table.numbers(column.position)
    for row, number in enumerate(numbers):
        if number <= 0.0:
            raise TableError(f"{table.shown(row, column.position)}; must be greater than 0")
    return curve_of_diameters(_diameters(numbers, column, keys), keys.weight or "mass")


def _diameters(numbers: list[float], column: SizeColumn, keys: CurveKeys) -> Numbers:
    """Return diameters in m; those of areas are of circles with these areas."""
    if column.role != "projected area":
        return np.array(in_metres(numbers, unit_of_sizes(column, keys)))
    unit = unit_of_sizes(column, keys, "um^2")
    try:
        factor = to_si(f"1 {unit}", "m^2")
    except ValueError:
        title = quoted_start(column.title)
        message = f"column {title} has the unit {quoted_start(unit)}; must be an area like 'um^2'"
        raise TableError(message) from None
    return np.sqrt(4.0 / math.pi * factor * np.array(numbers))
