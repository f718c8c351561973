"""Tables of the page: best strings, starts of the program, worst samples, failures."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple
from urllib.parse import quote

import numpy as np

from agglom_mpi.analysis.best_strings import (
    FRESH_ROWS,
    GROWTH_ROWS,
    LIMIT_ROWS,
    OBJECTIVE_ROWS,
    StringRow,
    collect_best,
    time_row,
)
from agglom_mpi.analysis.derived import derived_columns, values_of
from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.analysis.quantity_means import quantity_rows
from agglom_mpi.analysis.ranking import listed_strings, rank_strings
from agglom_mpi.analysis.tables import searched_variables
from agglom_mpi.formatting import (
    csv_cell,
    format_duration,
    label_of,
    number_or_none,
    value_with_error,
)
from agglom_mpi.outcome import COLUMNS, COMPLETED, LEDGER, REASONS
from agglom_mpi.report.drawing import axis_label
from agglom_mpi.report.shown_units import shown_unit
from agglom_mpi.storage.reader import CampaignData

LAST: Final = 20
"""Maximum number of starts of the program, and of texts of failures, that are listed."""
MAX_ROWS: Final = 2000
"""Maximum number of judged strings that are listed."""
MOST_FAILING: Final = 6
"""Maximum number of strings that are named for their failures."""


class PageTable(NamedTuple):
    """A table of texts for the page.

    Attributes
    ----------
    headings
    rows
    caption
    classes
        CSS class of each row, if they have any.
    text_columns
        Indices of columns of text; columns of numbers are aligned to the right.
    name
        File stem of the table as CSV.
    strings
        Number of the string of each row, to which figures link, if the rows are strings.
    upright
        Whether a wide page shows each row as a column.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    classes: Sequence[str] = ()
    text_columns: Sequence[int] = ()
    name: str = "table"
    strings: Sequence[int] = ()
    upright: bool = False

    @property
    def csv(self) -> str:
        """The table as a `data:` URI of a CSV file, which needs no server and no script."""
        text = io.StringIO()
        rows = [self.headings, *self.rows]
        csv.writer(text).writerows([csv_cell(cell) for cell in row] for row in rows)
        return f"data:text/csv;charset=utf-8,{quote(text.getvalue())}"


def best_strings(data: CampaignData) -> PageTable:
    """Return the best strings, one a row: variables, results and estimates."""
    best = collect_best(data, listed_strings(data))
    quantities = quantity_rows(data, [entry["string"] for entry in best])
    rows = [*_variable_rows(data, best), *_result_rows(best, quantities)]
    ranks = ["rank", *(f"#{place}" for place in range(1, len(best) + 1))]
    headings, *entries = zip(ranks, *rows, strict=True)
    return PageTable(headings, entries, name="best_strings", upright=True)


def ranges(data: CampaignData) -> PageTable:
    """Return the variables with the ends of their ranges, the searched ones first."""
    searched = searched_variables(data)
    lines = []
    for variable, lower, upper, logarithmic in searched:
        factor, unit = shown_unit(data, variable.name, variable.unit, upper)
        ends = (f"{lower / factor:.6g}", f"{upper / factor:.6g}")
        scale = "by its logarithm" if logarithmic else "evenly"
        lines.append([label_of(variable.name), *ends, _unit_or_empty(unit), scale])
    for variable, row in zip(data.variables.variables, data.variable_rows(), strict=True):
        if row["searched"] != 1 and not np.isnan(row["lower"]):
            fixed = float(row["upper"])
            factor, unit = shown_unit(data, variable.name, variable.unit, fixed)
            value = f"{fixed / factor:.6g}"
            lines.append([label_of(variable.name), value, value, _unit_or_empty(unit), "fixed"])
    headings = ("variable", "from", "to", "unit", "searched")
    return PageTable(headings, lines, "Ranges", text_columns=(3, 4), name="ranges")


def _unit_or_empty(unit: str) -> str:
    return "" if unit == "1" else unit


def all_strings(data: CampaignData) -> PageTable:
    """Return the judged strings in order of rank, one a row; of many, the best `MAX_ROWS`."""
    order = rank_strings(data).order[:MAX_ROWS]
    again = {estimate.string: estimate for estimate in rank_strings(data).estimates}
    generation = {int(row["string"]): int(row["generation"]) + 1 for row in data.string_rows()}
    columns: list[tuple[str, list[str]]] = [
        ("rank", [str(place) for place in range(1, len(order) + 1)]),
        ("string", [str(string) for string in order]),
        ("generation", [str(generation.get(string, "")) for string in order]),
    ]
    for variable, _, upper, _ in searched_variables(data):
        factor, unit = shown_unit(data, variable.name, variable.unit, upper)
        values = values_of(data, order, variable.name) / factor
        columns.append((axis_label(variable.name, unit), [f"{value:.5g}" for value in values]))
    results = [rank_strings(data).results[string] for string in order]
    columns += [
        (
            "objective, as searched",
            [value_with_error(float(r["objective"]), float(r["standard_error"])) for r in results],
        ),
        ("mean b/b⁰, as searched", [f"{row['mean_radius_ratio']:.4g}" for row in results]),
        ("samples used", [str(row["samples_used"]) for row in results]),
    ]
    if again:
        columns.insert(-2, ("objective, re-estimate", [_again(again.get(i)) for i in order]))
    more = len(rank_strings(data).order) - len(order)
    caption = f"The best {len(order)} strings; {more} more have a result" if more else ""
    rows = list(zip(*(values for _, values in columns), strict=True))
    headings = [heading for heading, _ in columns]
    return PageTable(headings, rows, caption, name="strings", strings=order)


def _again(estimate: Estimate | None) -> str:
    """Return the objective of a string on fresh samples; empty if it has none."""
    if estimate is None:
        return ""
    return value_with_error(float(estimate.objective), float(estimate.standard_error))


def _variable_rows(data: CampaignData, best: list[dict[str, Any]]) -> Iterator[list[str]]:
    yield ["string", *(str(entry["string"]) for entry in best)]
    for variable, row in zip(data.variables.variables, data.variable_rows(), strict=True):
        if np.isnan(row["lower"]):  # the campaign does not use it
            continue
        fixed = "" if row["searched"] else "fixed"
        shown = shown_unit(data, variable.name, variable.unit, float(row["upper"]))
        yield _scaled_row(variable.name, shown, best, fixed)
    for column in derived_columns(data):
        largest = np.nanmax([abs(entry[column.name]) for entry in best], initial=0.0)
        shown = shown_unit(data, column.name, column.unit, float(largest))
        yield _scaled_row(column.name, shown, best)


def _scaled_row(
    name: str, shown: tuple[float, str], best: list[dict[str, Any]], note: str = ""
) -> list[str]:
    """Return a row of values in the unit that is `shown`: its factor and its label."""
    factor, scaled = shown
    notes = [part for part in (_unit_or_empty(scaled), note) if part]
    label = f"{label_of(name)} ({', '.join(notes)})" if notes else label_of(name)
    return [label, *(f"{entry[name] / factor:.5g}" for entry in best)]


def _result_rows(best: list[dict[str, Any]], quantities: list[list[str]]) -> Iterator[list[str]]:
    yield from _rows_on_page(OBJECTIVE_ROWS, best)
    again = [entry["reestimate"] for entry in best]
    if any(again):
        yield from _rows_on_page(FRESH_ROWS, again)
    limits = [entry.get("finite_size") for entry in best]
    if any(limits):
        yield from _rows_on_page(LIMIT_ROWS, limits)
    yield from quantities
    yield from _rows_on_page(GROWTH_ROWS, best)
    time = time_row(best)
    yield [time.on_page, *(format_duration(entry[time.key]) for entry in best)]


def _rows_on_page(
    rows: Iterable[StringRow], entries: Sequence[dict[str, Any] | None]
) -> Iterator[list[str]]:
    """Yield rows with a cell for each entry, empty for None; objectives with their errors."""
    for row in rows:
        if row.on_page:
            yield [row.on_page, *("" if entry is None else _cell(row, entry) for entry in entries)]


def _cell(row: StringRow, entry: dict[str, Any]) -> str:
    if row.key == "objective":
        return value_with_error(entry["objective"], entry["standard_error"])
    return number_or_none(entry[row.key], row.style)


def legs(data: CampaignData) -> PageTable:
    """Return the last starts of the program, one a row."""
    rows = data.legs()[-LAST:]
    first = len(data.legs()) - len(rows)
    headings = (
        "leg",
        "started (UTC)",
        "lasted",
        "ranks",
        "machines",
        "samples",
        "busy",
        "on a core",
        "writing",
        "written by",
        "exit code",
        "on",
        "agglom_mpi",
    )
    lines = [[str(first + i), *_leg(row)] for i, row in enumerate(rows, 1)]
    return PageTable(
        headings, lines, "Starts of the program", text_columns=(1, 9, 11, 12), name="starts"
    )


def _leg(row: np.void) -> Iterator[str]:
    lasted = float(row["stopped"] - row["started"])
    ended = np.isfinite(lasted)
    available = lasted * row["ranks"] if ended and lasted > 0.0 else np.nan
    yield _date(float(row["started"]))
    yield format_duration(lasted) if ended else "no end"
    yield str(row["ranks"])
    yield str(row["nodes"])
    yield str(row["samples"]) if ended else ""
    yield f"{row['busy_seconds'] / available:.1%}" if ended else ""
    yield _share(row["cpu_seconds"], row["busy_seconds"]) if ended else ""
    yield f"{row['database_seconds'] / available:.2%}" if ended else ""
    yield _text(row["database"])
    yield str(row["exit_code"]) if ended else ""
    yield f"{_text(row['host'])}, {_text(row['processor'])}"
    yield f"{_text(row['code_version'])} {_text(row['git_revision'])[:10]}".strip()


def _share(part: float, whole: float) -> str:
    """Return a part of a whole as a percentage; empty where either is unknown."""
    return f"{part / whole:.1%}" if whole > 0.0 and np.isfinite(part) else ""


def _date(seconds: float) -> str:
    """Return a Unix time as date and time."""
    try:
        return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (OSError, OverflowError, ValueError):
        return "no date"


def _text(value: bytes) -> str:
    return value.decode(errors="replace")


def ledger(data: CampaignData) -> PageTable:
    """Return the worst completed sample of each column of the ledger, and how to simulate it."""
    rows = data.counted_samples[data.counted_samples["state"] == COMPLETED]
    meanings = {column.name: column.meaning for column in COLUMNS}
    lines = []
    for name in LEDGER:
        size = np.abs(np.nan_to_num(rows[name].astype(float)))
        worst = rows[int(np.argmax(size))]
        is_count = rows[name].dtype.kind == "i"
        affected = str(np.count_nonzero(size)) if is_count else ""
        where = ["", "", ""]
        if size.max() > 0.0:
            where = [str(worst["string"]), str(worst["sample"]), _replay(data, worst)]
        value = str(worst[name]) if is_count else f"{worst[name]:.3g}"
        lines.append([meanings[name], value, affected, *where])
    headings = ("entry", "worst", "samples with any", "string", "sample", "to simulate it again")
    return PageTable(headings, lines, text_columns=(5,), name="worst_samples")


def _replay(data: CampaignData, row: np.void) -> str:
    name = data.path.name
    return f"agglom simulate {name} --string {row['string']} --sample {row['sample']}"


class FailedSamples(NamedTuple):
    """The samples that failed: their reasons, strings and texts.

    Attributes
    ----------
    reasons
        Number of samples, and the reason.
    strings
        Strings with the most failures, and their numbers.
    texts
        The last recorded texts, each with its place.
    """

    reasons: list[tuple[int, str]]
    strings: list[tuple[int, int]]
    texts: list[str]


def failed_samples(data: CampaignData, failed: np.ndarray) -> FailedSamples:
    """Return the failures of a campaign; `failed` are their rows of `/samples`."""
    counts = np.bincount(failed["reason"], minlength=len(REASONS)).tolist()
    strings, failures = np.unique(failed["string"], return_counts=True)
    most = np.argsort(-failures, kind="stable")[:MOST_FAILING]
    return FailedSamples(
        [
            (count, REASONS[code] if 0 < code < len(REASONS) else f"unknown reason ({code})")
            for code, count in enumerate(counts)
            if count
        ],
        [(int(strings[i]), int(failures[i])) for i in most],
        [_failure(row) for row in data.failures()[-LAST:]],
    )


def _failure(row: np.void) -> str:
    place = f"string {row['string']} sample {row['sample']}, rank {row['rank']}"
    return f"{place} on {_text(row['host'])}:\n{_text(row['text'])}"
