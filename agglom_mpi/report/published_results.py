"""A paper's tables of best strings, from a file, with those of a campaign beside them."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.derived import values_of
from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.analysis.ranking import listed_strings, rank_strings
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import number_or_none, value_with_error
from agglom_mpi.report.page_tables import PageTable
from agglom_mpi.storage.reader import CampaignData


class PublishedColumn(NamedTuple):
    """A column of a paper's table.

    Attributes
    ----------
    heading
    name
        A variable, `objective`, `mean_radius_ratio` or `growth_number`.
    unit
        SI value that the paper prints as 1.
    digits
        Format of a number.
    """

    heading: str
    name: str
    unit: float
    digits: str


class PublishedTable(NamedTuple):
    """A table of a paper, the best string first, in the units of its columns.

    Its CSV is `name`.csv.
    """

    name: str
    caption: str
    columns: tuple[PublishedColumn, ...]
    rows: tuple[tuple[float, ...], ...]


class Published(NamedTuple):
    """The tables of a paper, its name, and a note on them."""

    paper: str
    note: str
    tables: tuple[PublishedTable, ...]

    def strings(self) -> Iterator[dict[str, float]]:
        """Yield the variables of each row of all tables in SI units, by name."""
        for rows in zip(*(table.rows for table in self.tables), strict=True):
            yield {
                column.name: value * column.unit
                for table, values in zip(self.tables, rows, strict=True)
                for column, value in zip(table.columns, values, strict=True)
                if column.name not in RESULTS
            }


RESULTS: Final = ("objective", "mean_radius_ratio", "growth_number")
"""Columns that are of samples."""
RE_ESTIMATE: Final = "re-estimate"
KINDS: Final = ("as searched", RE_ESTIMATE)
"""Marks of columns: of the samples that strings were chosen by, and of fresh samples."""


def read_published(path: Path) -> Published:
    """Read a file of published tables, such as those in `jobs/published`.

    Raises
    ------
    CampaignError
        If it is none.
    OSError
        If it cannot be read.
    """
    try:
        entries = json.loads(path.read_text())
        tables = []
        for table in entries["tables"]:
            columns = tuple(PublishedColumn(**column) for column in table["columns"])
            rows = tuple(tuple(map(float, row)) for row in table["rows"])
            if {len(row) for row in rows} != {len(columns)}:
                raise ValueError(f"{table['name']} has rows without a number for each column")
            tables.append(PublishedTable(table["name"], table["caption"], columns, rows))
        return Published(entries["paper"], entries["note"], tuple(tables))
    except (ValueError, KeyError, TypeError) as error:
        message = f"is no file of published tables ({error}); must be like jobs/published/*.json"
        raise CampaignError(Problem(str(path), None, "tables", message)) from None


def comparison_tables(data: CampaignData, published: Published) -> list[PageTable]:
    """Return the tables of a paper with a campaign's best strings between their rows."""
    best = rank_strings(data).order[: listed_strings(data)]
    return [_beside(table, data, best) for table in published.tables]


MarkedColumn = tuple[PublishedColumn, str]
"""A column, and whether it is `as searched` or a `re-estimate`; empty for a variable."""


def _by_kind(data: CampaignData, columns: Sequence[PublishedColumn]) -> list[MarkedColumn]:
    """Return columns with one of each kind in place of a result; of one kind if there is one."""
    kinds = KINDS if rank_strings(data).estimates else KINDS[:1]
    return [
        (column, kind)
        for column in columns
        for kind in (kinds if column.name in RESULTS else ("",))
    ]


def _beside(published: PublishedTable, data: CampaignData, best: Sequence[int]) -> PageTable:
    columns = _by_kind(data, published.columns)
    rows: list[list[str]] = []
    classes: list[str] = []
    for place, printed in enumerate(published.rows):
        value = dict(zip(published.columns, printed, strict=True))
        cells = [
            "" if kind == RE_ESTIMATE else format(value[column], column.digits)
            for column, kind in columns
        ]
        rows.append([str(place + 1), "published", *cells])
        classes.append("published first")
        if place < len(best):
            rows.append([str(place + 1), "here", *_cells(data, best[place], columns)])
            classes.append("here")
    marked = (f"{column.heading}, {kind}" if kind else column.heading for column, kind in columns)
    headings = ["rank", "from", *marked]
    return PageTable(headings, rows, published.caption, classes, (1,), published.name)


def _cells(data: CampaignData, string: int, columns: Sequence[MarkedColumn]) -> list[str]:
    """Return a row of a campaign's string; re-estimates are empty where it has none."""
    result = rank_strings(data).results[string]
    again = {estimate.string: estimate for estimate in rank_strings(data).estimates}.get(string)
    cells = []
    for column, kind in columns:
        source = again if kind == RE_ESTIMATE else result
        if not kind:
            value = float(values_of(data, [string], column.name)[0])
            cells.append(format(value / column.unit, column.digits))
        elif source is None:
            cells.append("")
        else:
            cells.append(_result(column, source))
    return cells


def _result(column: PublishedColumn, source: Estimate | np.void) -> str:
    """Return a result of a string by its re-estimate, or by its row of `/results`."""
    numbers = source._asdict() if isinstance(source, Estimate) else source
    if column.name == "objective":
        return value_with_error(float(numbers["objective"]), float(numbers["standard_error"]))
    ratio = float(numbers["mean_radius_ratio"])
    value = ratio if column.name == "mean_radius_ratio" else ratio**3
    return number_or_none(value / column.unit, column.digits)
