"""Tables of measured sizes: which columns are read, and the errors of their shares."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.bounded_reading import quoted_start
from agglom_mpi.config.size_curve import Numbers, ShareWeight
from agglom_mpi.config.size_headings import AMOUNTS, Role, SizeColumn
from agglom_mpi.config.size_rows import SizeRow
from agglom_mpi.config.table_layout import TableError
from agglom_mpi.config.text_table import TextTable, parse_heading
from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.units import quoted, to_si

CURVE_EXAMPLE: Final = "sieve size (mm)"
"""Heading that messages give as an example."""
HEADINGS_REMEDY: Final = "name it in the entry, like `headings: {finer: passing (%)}`"
PREFERRED_AMOUNTS: Final[tuple[tuple[Role, ...], ...]] = (
    ("passing", "cumulative"),
    ("cumulative retained",),
    ("retained", "amount"),
)
"""Roles of amounts, those first that are read where a file has several."""


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


class SizeTable(NamedTuple):
    """A table of measured sizes.

    Attributes
    ----------
    table
        The text fields.
    columns
        The columns whose roles their headings state.
    keys
        What the entry of `data` states of the file.
    """

    table: TextTable
    columns: list[SizeColumn]
    keys: CurveKeys

    def shown(self, row: int, column: SizeColumn) -> str:
        """Return the place of a field and its value, as a message begins."""
        return self.table.shown(row, column.position)

    def is_empty(self, row: int, column: SizeColumn) -> bool:
        """Return whether a field is empty."""
        return not self.table.cell(row, column.position)

    def numbers(self, rows: Sequence[SizeRow], column: SizeColumn) -> Numbers:
        """Return the numbers of a column in some rows, shape (n,)."""
        return np.array([self.table.number(row.position, column.position) for row in rows])

    def amount(self) -> SizeColumn | None:
        """Return the column of amounts to read; None of a list of single grains.

        A cumulative curve goes before the shares that it was made from, and what passes before what
        is retained.

        Raises
        ------
        FieldError
            If the entry must name one of several columns, or names none.
        """
        found = [c for c in self.columns if c.role in AMOUNTS and not self._numbers_rows(c)]
        if self.keys.column:
            named = [column for column in self.columns if self._is_named(column)]
            if not named:
                titles = _titles(self.columns[:6])
                message = f"is {quoted(self.keys.column)}; the file has {titles}"
                raise FieldError((("column",), message))
            found = [column for column in named if column.role in AMOUNTS]
        matching = [column for column in found if self.keys.weight in (None, column.weight)]
        for roles in PREFERRED_AMOUNTS:
            ranked = [column for column in matching or found if column.role in roles]
            if ranked:
                return self._only(ranked)
        return None

    def grains(self) -> SizeColumn:
        """Return the column of sizes of a list of single grains."""
        sizes = [column for column in self.columns if column.role in ("size", "projected area")]
        named = [column for column in sizes if self._is_named(column)]
        chosen = named or [column for column in sizes if column.is_length] or sizes
        if not chosen:
            raise TableError(f"has no column of amounts beside its classes; {HEADINGS_REMEDY}")
        return self._only(chosen)

    def _only(self, columns: list[SizeColumn]) -> SizeColumn:
        """Return a column; raise a FieldError if the entry must name one of several.

        Of columns that differ by their units alone, as masses and percentages, it is the first.
        """
        titles = {column.title.lower() for column in columns}
        if len({(column.title.lower(), column.unit) for column in columns}) < len(columns):
            raise TableError(f"has the heading {_titles(columns[:1])} several times; keep one")
        if len(titles) > 1:
            message = f"is missing; the file has {_titles(columns[:4])}, of which it must name one"
            raise FieldError((("column",), message))
        return columns[0]

    def _is_named(self, column: SizeColumn) -> bool:
        """Return whether the entry names a column."""
        title, unit = parse_heading(self.keys.column)
        is_unit = unit in (None, column.unit) or (column.is_percent and "%" in (unit or ""))
        return bool(title) and column.title.lower() == title.lower() and is_unit

    def _numbers_rows(self, column: SizeColumn) -> bool:
        """Return whether a column numbers its rows 1, 2, 3 and so on."""
        texts = [self.table.cell(row, column.position) for row in range(len(self.table.rows))]
        return len(texts) > 2 and texts == [str(number + 1) for number in range(len(texts))]

    def sizes(self, roles: Sequence[Role]) -> SizeColumn:
        """Return the one column of sizes with the first of some roles that there is.

        Raises
        ------
        TableError
            If there are several, or none.
        """
        for role in roles:
            found = [column for column in self.columns if column.role == role]
            chosen = [column for column in found if column.is_length] or found
            if len(chosen) > 1:
                titles = _titles(chosen[:4])
                raise TableError(f"has several columns of sizes, {titles}; keep one of them")
            if chosen:
                return chosen[0]
        raise TableError(f"has no column of sizes; must have a heading like '{CURVE_EXAMPLE}'")

    def unit(self, column: SizeColumn, kind: str = "m", example: str = "um") -> str:
        """Return the unit of a column of sizes, of the kind of an SI unit.

        Raises
        ------
        FieldError
            If both the entry and the heading give a unit, or that of the entry is of another kind.
        TableError
            If there is none, or that of the heading is of another kind.
        """
        own, title = self.keys.unit, quoted_start(column.title)
        if column.unit and own:
            message = f"is {quoted(own)}, but the file gives {quoted_start(column.unit)}"
            raise FieldError((("unit",), f"{message}; leave it out"))
        unit = column.unit or own
        if not unit:
            raise TableError(
                f"the sizes in column {title} have no unit; write it in the heading like "
                f"'{CURVE_EXAMPLE}', or add `unit: {example}` to the entry"
            )
        try:
            to_si(f"1 {unit}", kind)
        except ValueError:
            if own:
                raise FieldError(
                    (("unit",), f"is {quoted(own)}; must be like '{example}'")
                ) from None
            message = f"column {title} has the unit {quoted_start(unit)}; must be like '{example}'"
            raise TableError(message) from None
        return unit

    def errors(
        self,
        amount: SizeColumn,
        rows: Sequence[SizeRow],
        scale: float,
        needed: npt.NDArray[np.bool_],
    ) -> Numbers | None:
        """Return the standard errors of the shares in some rows, shape (n,); None if counted.

        Parameters
        ----------
        amount
            Column of the shares.
        rows
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
        found = [column for column in self.columns if column.role == "error"]
        if len(found) > 1:
            raise TableError(f"has {len(found)} columns of errors; keep one of them")
        given = [name for name in ("error", "counted") if getattr(self.keys, name) is not None]
        if len(given) + len(found) > 1:
            beside = f"column {_titles(found)} of the file" if found else given[0]
            raise FieldError(((given[-1],), f"is given beside {beside}; must be one of them"))
        if self.keys.error is not None:
            return np.full(len(rows), self.keys.error)
        return self._written_errors(found[0], amount, rows, scale, needed) if found else None

    def _written_errors(
        self,
        column: SizeColumn,
        amount: SizeColumn,
        rows: Sequence[SizeRow],
        scale: float,
        needed: npt.NDArray[np.bool_],
    ) -> Numbers:
        """Return the errors of a column, 0 where none is needed."""
        if column.unit not in ("", amount.unit):
            title, own, unit = map(quoted_start, (column.title, column.unit, amount.unit))
            raise TableError(f"column {title} has the unit {own}; must be {unit}")
        errors = np.zeros(len(rows))
        for i in np.flatnonzero(needed).tolist():
            position = rows[i].position
            errors[i] = self.table.number(position, column.position) * scale
            if not 0.0 < errors[i] < 1.0:
                shown = self.shown(position, column)
                raise TableError(f"{shown}; an error must be greater than 0 and less than 100 %")
        return errors

    def required_count(self) -> float:
        """Return the number of counted grains; raise a FieldError if nothing states the errors."""
        if self.keys.counted is None:
            message = (
                "is missing; give the error of each share like '2 percent', or `counted` with the "
                "number of grains, or a column 'error' in the file"
            )
            raise FieldError((("error",), message))
        return float(self.keys.counted)


def _titles(columns: Sequence[SizeColumn]) -> str:
    return ", ".join(quoted_start(column.title) for column in columns)
