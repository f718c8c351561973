"""Which columns of a table of measured sizes are read, and the errors of their shares."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.bounded_reading import quoted_start
from agglom_mpi.config.size_curve import Numbers, ShareWeight
from agglom_mpi.config.size_headings import AMOUNTS, SizeColumn
from agglom_mpi.config.size_rows import SizeRow
from agglom_mpi.config.table_layout import TableError
from agglom_mpi.config.text_table import TextTable, parse_heading
from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.units import quoted

CURVE_EXAMPLE: Final = "sieve size (mm)"
"""Heading that messages give as an example."""


class CurveKeys(NamedTuple):
    """What an entry of `data` states of its file; None and empty where it does not.

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
    """

    weight: ShareWeight | None = None
    column: str = ""
    unit: str = ""
    error: float | None = None
    counted: int | None = None


def amount_column(
    table: TextTable, columns: list[SizeColumn], keys: CurveKeys
) -> SizeColumn | None:
    """Return the column of amounts to read; None of a list of single grains.

    A cumulative curve goes before the shares that it was made from, and what passes before what is
    retained.
    """
    found = [each for each in columns if each.role in AMOUNTS and not _numbers_rows(table, each)]
    if keys.column:
        wanted = parse_heading(keys.column).title.lower()
        named = [each for each in columns if each.title.lower() == wanted]
        if not named:
            titles = ", ".join(quoted_start(each.title) for each in columns[:6])
            raise FieldError((("column",), f"is {quoted(keys.column)}; the file has {titles}"))
        found = [each for each in named if each.role in AMOUNTS]
    matching = [each for each in found if keys.weight in (None, each.weight)]
    for roles in (("passing", "cumulative"), ("cumulative retained",), ("retained", "amount")):
        ranked = [each for each in matching or found if each.role in roles]
        if len(ranked) > 1:
            titles = ", ".join(quoted_start(each.title) for each in ranked[:4])
            message = f"is missing; the file has {titles}, of which it must name one"
            raise FieldError((("column",), message))
        if ranked:
            return ranked[0]
    return None


def _numbers_rows(table: TextTable, column: SizeColumn) -> bool:
    """Return whether a column numbers its rows 1, 2, 3 and so on."""
    texts = [table.cell(row, column.position) for row in range(len(table.rows))]
    return len(texts) > 2 and texts == [str(number + 1) for number in range(len(texts))]


def size_column(columns: list[SizeColumn], roles: tuple[str, ...], keys: CurveKeys) -> SizeColumn:
    """Return the one column of sizes with the first of some roles that there is.

    Raises
    ------
    TableError
        If there are several, or none.
    """
    for role in roles:
        found = [column for column in columns if column.role == role]
        with_unit = [column for column in found if column.is_length]
        named = parse_heading(keys.column).title.lower() if keys.column else None
        chosen = [each for each in found if each.title.lower() == named] or with_unit or found
        if len(chosen) > 1:
            titles = ", ".join(quoted_start(column.title) for column in chosen[:4])
            raise TableError(f"has several columns of sizes, {titles}; keep one of them")
        if chosen:
            return chosen[0]
    raise TableError(f"has no column of sizes; must have a heading like '{CURVE_EXAMPLE}'")


def unit_of_sizes(column: SizeColumn, keys: CurveKeys, example: str = "um") -> str:
    """Return the unit of the sizes; raise an error if there is none, or there are two."""
    if column.unit and keys.unit:
        message = f"is {quoted(keys.unit)}, but the file gives {quoted_start(column.unit)}"
        raise FieldError((("unit",), f"{message}; leave it out"))
    if not (column.unit or keys.unit):
        title = quoted_start(column.title)
        raise TableError(
            f"the sizes in column {title} have no unit; write it in the heading like "
            f"'{CURVE_EXAMPLE}', or add `unit: {example}` to the entry"
        )
    return column.unit or keys.unit


def share_errors(
    table: TextTable,
    columns: list[SizeColumn],
    amount: SizeColumn,
    rows: list[SizeRow],
    keys: CurveKeys,
    scale: float,
    needed: npt.NDArray[np.bool_],
) -> Numbers | None:
    """Return the standard errors of the shares in some rows, shape (n,); None if grains counted.

    Parameters
    ----------
    table, columns, amount, rows, keys
    scale
        Factor of what is written.
    needed
        Whether a row needs an error, shape (n,): 0 % and 100 % of a cumulative curve have none.

    Raises
    ------
    FieldError
        If errors are given twice.
    TableError
        If an error is not greater than 0.
    """
    found = [column for column in columns if column.role == "error"]
    if len(found) > 1:
        raise TableError(f"has {len(found)} columns of errors; keep one of them")
    given = [name for name in ("error", "counted") if getattr(keys, name) is not None]
    if len(given) + len(found) > 1:
        beside = f"column {quoted_start(found[0].title)} of the file" if found else given[0]
        raise FieldError(((given[-1],), f"is given beside {beside}; must be one of them"))
    if keys.error is not None:
        return np.full(len(rows), keys.error)
    if not found:
        return None
    (column,) = found
    if column.unit not in ("", amount.unit):
        title, units = quoted_start(column.title), quoted_start(amount.unit)
        raise TableError(
            f"column {title} has the unit {quoted_start(column.unit)}; must be {units}"
        )
    errors = np.zeros(len(rows))
    for i, row in enumerate(rows):
        if needed[i]:
            errors[i] = table.number(row.position, column.position) * scale
            if not errors[i] > 0.0:
                shown = table.shown(row.position, column.position)
                raise TableError(f"{shown}; an error must be greater than 0")
    return errors


def required_count(keys: CurveKeys) -> float:
    """Return the number of counted grains; raise a FieldError if nothing states the errors."""
    if keys.counted is None:
        message = (
            "is missing; give the error of each share like '2 percent', or `counted` with the "
            "number of grains, or a column 'error' in the file"
        )
        raise FieldError((("error",), message))
    return float(keys.counted)
