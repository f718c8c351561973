"""Files of measured sizes: cumulative curves, histograms, and lists of single grains.

The headings state what a file holds (`size_columns`), and rows may be in either order with a pan
below the last sieve (`size_table`). What allows two readings is refused, and the message names
line, column and value, and what to write instead.
"""

import math
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.file_kinds import quoted_start
from agglom_mpi.formatting import format_percent
from agglom_mpi.measurements.files.size_columns import (
    CURVE_EXAMPLE,
    SIZE_HEADINGS,
    CurveKeys,
    Role,
    SizeColumn,
    amount_column,
    size_column,
    size_unit,
)
from agglom_mpi.measurements.files.size_curve import (
    Numbers,
    SizeCurve,
    curve_of_amounts,
    curve_of_counted,
    curve_of_diameters,
    curve_of_passing,
)
from agglom_mpi.measurements.files.size_table import (
    MAX_ROWS,
    SizeRow,
    SizeTable,
    check_range,
    grains_of,
    in_metres,
    read_content,
)
from agglom_mpi.measurements.files.text_table import TableError, parse_heading, read_table

HEADINGS_REMEDY: Final = "state what it is in the entry, like `headings: {finer: passing (%)}`"
MAX_CLASSES: Final = 300
"""Maximum number of classes of a file."""
MAX_SUM_DEVIATION: Final = 0.02
"""Maximum deviation from 100 % of the sum of all shares, as sieving loses and rounding leaves."""
_ROUNDING: Final = 1e-3
"""Maximum excess of a cumulative share over 100 %."""


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
    titles = {*SIZE_HEADINGS, *(parse_heading(own).title.lower() for own in keys.headings)}
    try:
        table = SizeTable(read_table(content, titles, CURVE_EXAMPLE, MAX_ROWS), keys)
        amount = amount_column(table.columns, keys)
        if amount is None:
            found = _listed(table)
        else:
            read = _histogram if amount.role in ("retained", "share") else _cumulative
            found = read(table, amount)
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


def read_curve_grains(folder: Path, name: str, keys: CurveKeys) -> dict[str, Any]:
    """Return the numbers that a law of sizes reads from the curve of a file, by field.

    Raises
    ------
    FieldError, ValueError
        As `read_size_curve`; or if the curve does not give the smallest and the largest diameter.
    """
    curve = read_size_curve(folder, name, keys)
    low, high = curve.edges[0], curve.edges[-1]
    try:
        places = ((low == 0.0, 0, "below"), (high == math.inf, -1, "above"))
        ends = [f"{format_percent(curve.shares[k])} {word}" for beyond, k, word in places if beyond]
        if ends:
            must = "must reach 0 % and 100 %; add a row with the size at which it does"
            raise TableError(f"has {' and '.join(ends)} all sizes; {must}")
        check_range(low, high)
        if curve.weight == "area":
            raise TableError("has shares of the area; must be of number or mass")
    except TableError as error:
        raise ValueError(f"is {quoted(name)}: {error}") from None
    return {
        "diameters": tuple(curve.grains().tolist()),
        "absolute": True,
        "basis": "volume" if curve.weight == "mass" else "number",
        "mean_errors": (curve.mean_error(0), curve.mean_error(3)),
    }


# Cumulative curves


def _cumulative(found: SizeTable, amount: SizeColumn) -> SizeCurve:
    is_oversize = amount.role == "cumulative retained"
    edges: list[Role] = ["lower", "upper"] if is_oversize else ["upper", "lower"]
    column = size_column(found.columns, "size", *edges)
    rows = found.rows(column)
    if found.is_empty(rows[0], amount) and not rows[0].upper:
        rows = rows[1:]  # a pan without an amount
    numbers = found.numbers(rows, amount)
    scale = _scale(amount, numbers)
    within = (numbers >= 0.0) & (numbers * scale <= 1.0 + _ROUNDING)
    found.check(rows, amount, within, f"be from 0 to {1.0 / scale:g}")
    values = np.minimum(numbers * scale, 1.0)
    if is_oversize:
        values = 1.0 - values
    ascends = np.diff(values, prepend=0.0) >= 0.0
    found.check(rows, amount, ascends, "not turn back: it contradicts the next smaller size")
    sizes = np.array([row.lower if is_oversize else row.upper for row in rows])
    errors = _errors(found, amount, rows, scale, (values > 0.0) & (values < 1.0))
    if len(sizes) and sizes[0] == 0.0:  # the pan, below which there is nothing
        found.check(rows[:1], amount, values[:1] <= MAX_SUM_DEVIATION, "be 0 % at size 0")
        values[0] = 0.0
    kept = slice(0, -1) if len(sizes) and np.isinf(sizes[-1]) else slice(None)
    rows, sizes, values = rows[kept], sizes[kept], values[kept]
    if len(sizes) < 2:
        raise TableError("has no two sizes with amounts; must have at least two")
    found.check(rows, column, np.diff(sizes, prepend=-1.0) > 0.0, "lie above the size below")
    weight = amount.weight or found.keys.weight or "mass"
    own = np.zeros(len(values)) if errors is None else errors[kept]
    curve = curve_of_passing(sizes, values, own, weight)
    return curve if errors is not None else _counted(curve, found.keys.counted)


def _scale(amount: SizeColumn, numbers: Numbers) -> float:
    """Return the factor from the numbers of a cumulative curve to shares."""
    largest = max(numbers.tolist(), default=0.0)
    if amount.unit == "%" or (not amount.unit and abs(largest - 100.0) <= 0.1):
        return 0.01
    if not amount.unit and largest <= 1.0 + _ROUNDING:
        return 1.0
    title, unit = quoted_start(amount.heading.title), quoted_start(amount.unit or "none")
    raise TableError(f"column {title} has the unit {unit}; a curve must be in % or fractions")


# Histograms


def _histogram(found: SizeTable, amount: SizeColumn) -> SizeCurve:
    rows, column = _classes(found, amount)
    numbers = found.numbers(rows, amount)
    found.check(rows, amount, numbers >= 0.0, "be at least 0")
    edges = np.array([*(row.lower for row in rows[:1]), *(row.upper for row in rows)])
    if len(edges) < 2:
        raise TableError("has no two sizes with amounts; must have at least two")
    found.check(rows, column, np.diff(edges) > 0.0, "have a width, so lie above the size below")
    total, is_count = _total(amount, numbers)
    weight = amount.weight or found.keys.weight or "mass"
    errors = _errors(found, amount, rows, 1.0 / total, np.ones(len(rows), bool))
    own = np.zeros(len(numbers)) if errors is None else errors
    curve = curve_of_amounts(edges, numbers / total, own, weight)
    if errors is not None:
        return curve
    return _counted(curve, found.keys.counted or (total if is_count else None))


def _classes(found: SizeTable, amount: SizeColumn) -> tuple[list[SizeRow], SizeColumn]:
    """Return a row for each class, ascending, and the column of sizes that states it.

    Of rows with one size each, a lower or an upper edge, one at an end without an amount gives the
    last edge. What is retained lies above its sieve.
    """
    roles = {column.role for column in found.columns}
    if {"lower", "upper"} <= roles and "size" not in roles:
        pair = [size_column(found.columns, "lower"), size_column(found.columns, "upper")]
        return found.classes(pair[0], found.rows(*pair)), pair[0]
    column = size_column(found.columns, "size", "lower", "upper")
    rows = found.rows(column)
    if any(row.lower < row.upper for row in rows):
        return found.classes(column, rows), column
    edges = [row.upper for row in rows]
    begins, ends = (found.is_empty(rows[i], amount) for i in (0, -1))
    if column.role != "upper" and ends:
        rows = rows[:-1]
    elif column.role != "lower" and begins:
        rows = rows[1:]
    elif column.role == "upper":
        edges = [0.0, *edges]
    elif amount.role == "retained" and edges[0] > 0.0 and amount.unit != "%":
        raise TableError(
            "has no row of what passed the last sieve; must have a last row 'pan' (0 if none)"
        )
    elif amount.role == "retained" or column.role == "lower":
        edges = [*edges, math.inf]
    else:
        raise TableError(
            f"column {quoted_start(column.heading.title)} can be the lower edges of the classes, "
            "the upper ones, or their middles; must be titled 'lower' or 'upper', or hold classes "
            "like 63-125"
        )
    classes = zip(rows, pairwise(edges), strict=True)
    return [SizeRow(row.position, *ends) for row, ends in classes], column


def _total(amount: SizeColumn, numbers: Numbers) -> tuple[float, bool]:
    """Return what the amounts sum to, and whether they are counts."""
    total, is_percent = float(numbers.sum()), amount.unit == "%"
    is_whole = bool(np.all(numbers == np.round(numbers)))
    if total > 0.0 and amount.unit and not is_percent:
        return total, False
    if total > 0.0 and not amount.unit and amount.weight == "number" and is_whole:
        return total, True
    wholes = (100.0,) if is_percent else (1.0, 100.0)
    if all(abs(total / whole - 1.0) > MAX_SUM_DEVIATION for whole in wholes):
        title = quoted_start(amount.heading.title)
        allowed = "100 %" if is_percent else "1, or have the unit % or g"
        raise TableError(f"column {title} sums to {total:.6g}; must sum to {allowed}")
    return total, False


# Errors


def _errors(
    found: SizeTable,
    amount: SizeColumn,
    rows: list[SizeRow],
    scale: float,
    needed: npt.NDArray[np.bool_],
) -> Numbers | None:
    """Return the standard errors of the shares in some rows, (n,); None if grains were counted.

    `scale` is the factor of what is written. Not all rows need an error, `needed`, (n,): 0 % and
    100 % of a cumulative curve have none.
    """
    columns = [column for column in found.columns if column.role == "error"]
    given = [name for name in ("error", "counted") if getattr(found.keys, name) is not None]
    if len(given) + len(columns) > 1:
        stated = ", ".join([*given, *("a column of the file" for _ in columns)])
        message = f"is given by {stated}; must be given once"
        raise FieldError((((given or ["error"])[-1],), message))
    if found.keys.error is not None:
        return np.full(len(rows), found.keys.error)
    if not columns:
        return None
    [column], errors = columns, np.zeros(len(rows))
    for i in np.flatnonzero(needed).tolist():
        errors[i] = found.table.number(rows[i].position, column.position) * scale
        if not 0.0 < errors[i] < 1.0 or column.unit not in ("", amount.unit):
            shown, unit = found.shown(rows[i], column), amount.unit or "1"
            raise TableError(f"{shown}; must be an error above 0 and below 100 %, in {unit!r}")
    return errors


def _counted(curve: SizeCurve, counted: float | None) -> SizeCurve:
    """Return a curve with the errors of a number of counted grains, which must be given."""
    if counted is None:
        message = (
            "is missing; give the error of each share like '2 percent', or `counted` with the "
            "number of grains, or a column 'error' in the file"
        )
        raise FieldError((("error",), message))
    return curve if len(curve.shares) < 2 else curve_of_counted(curve, float(counted))


# Single grains


def _listed(found: SizeTable) -> SizeCurve:
    """Return the curve of a file with one grain in each row."""
    column, numbers = grains_of(found, HEADINGS_REMEDY)
    for name in ("error", "counted"):
        given = getattr(found.keys, name)
        if given is not None:
            message = f"is {given:g}, but the file has a row for each grain, which counts itself"
            raise FieldError(((name,), f"{message}; leave it out"))
    if column.role == "area":  # the diameter of a circle with this area
        factor = to_si(f"1 {size_unit(column, found.keys, 'm^2', 'um^2')}", "m^2")
        diameters = np.sqrt(4.0 / math.pi * factor * np.array(numbers))
    else:
        diameters = np.array(in_metres(numbers, size_unit(column, found.keys)))
    return curve_of_diameters(diameters, found.keys.weight or "mass")
