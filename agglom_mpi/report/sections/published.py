"""A paper's tables of best strings, from a file, with those of a campaign beside them."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from agglom_mpi.analysis.best_strings import collect_best
from agglom_mpi.analysis.ranking import listed_strings, rank_strings
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.display.table import Column, Table
from agglom_mpi.report.sections.section import Block, Page, note, section
from agglom_mpi.storage.reader import CampaignData

RESULTS: Final = ("objective", "mean_radius_ratio", "growth_number")
"""Columns that are of samples."""
RE_ESTIMATE: Final = "re-estimate"
EXPLANATION: Final = (
    "Published rows are one run each, by the samples that the strings were chosen by and with time "
    "steps that are not exact; they are what the paper prints, not a reference."
)
SEARCHED: Final = (
    'Columns marked "as searched" are of the samples that strings were chosen by: lucky strings '
    "survive."
)
ESTIMATED: Final = (
    'Columns marked "re-estimate" are of fresh samples that no decision has seen; they are empty '
    "where a string was not estimated again."
)


class Published(NamedTuple):
    """The tables of a paper, its name, and a note on them.

    Rows are in SI units, the best string first, by the names of variables and of `RESULTS`.
    """

    paper: str
    note: str
    tables: tuple[Table, ...]

    def strings(self) -> Iterator[dict[str, float]]:
        """Yield the variables of each row of all tables in SI units, by name."""
        for rows in zip(*(table.rows for table in self.tables), strict=True):
            yield {key: row[key] for row in rows for key in row if key not in RESULTS}


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
            columns = [
                Column(each["name"], each["heading"], format=each["digits"], size=each["unit"])
                for each in table["columns"]
            ]
            rows = [
                {c.key: float(value) * c.size for c, value in zip(columns, row, strict=True)}
                for row in table["rows"]
            ]
            tables.append(Table(columns, rows, table["caption"], table["name"]))
        return Published(entries["paper"], entries["note"], tuple(tables))
    except (ValueError, KeyError, TypeError) as error:
        message = f"is no file of published tables ({error}); must be like jobs/published/*.json"
        raise CampaignError(Problem(str(path), None, "tables", message)) from None


@section(10, "Beside the published tables")
def tables(page: Page) -> Iterator[Block | Table]:
    """Yield the tables of a paper with the campaign's best strings, if they are given."""
    if (published := page.published) is None:
        return
    again = [ESTIMATED] if rank_strings(page.data).estimates else []
    yield note(" ".join([f"{published.paper}.", EXPLANATION, published.note, SEARCHED, *again]))
    for table in published.tables:
        yield beside(table, page.data)


def beside(published: Table, data: CampaignData) -> Table:
    """Return a table of a paper with a campaign's best strings between its rows.

    Results have a column each for samples as searched, and for fresh ones.
    """
    columns = [Column("rank"), Column("from", text=True)]
    for column in published.columns:
        if column.key in RESULTS:
            columns.append(column._replace(label=f"{column.label}, as searched"))
            key = f"{column.key} {RE_ESTIMATE}"
            columns.append(column._replace(key=key, label=f"{column.label}, {RE_ESTIMATE}"))
        else:
            columns.append(column)
    names = [each.key for each in published.columns if each.key not in RESULTS]
    best = collect_best(data, listed_strings(data))
    rows: list[dict[str, Any]] = []
    for place, printed in enumerate(published.rows):
        rank = {"rank": str(place + 1)}
        rows.append({**rank, "from": "published", "mark": "published first", **printed})
        if place >= len(best):
            continue
        own = {name: best[place].get(name, math.nan) for name in names}
        for source, mark in (best[place], ""), (best[place]["reestimate"], f" {RE_ESTIMATE}"):
            if source is not None:
                growth = source["mean_radius_ratio"]
                own[f"objective{mark}"] = source["objective"], source["standard_error"]
                own |= {f"mean_radius_ratio{mark}": growth, f"growth_number{mark}": growth**3}
        rows.append({**rank, "from": "here", "mark": "here", **own})
    return Table(columns, rows, published.title, published.name, mark="mark")
