"""Tables of the page: best strings, starts of the program, worst samples, failures."""

from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.derived import derived_columns, values_of
from agglom_mpi.analysis.ranking import listed_strings, rank_strings
from agglom_mpi.analysis.tables import time_of_strings
from agglom_mpi.formatting import format_duration, number_or_none, value_with_error
from agglom_mpi.outcome import COLUMNS, COMPLETED, LEDGER, REASONS
from agglom_mpi.report.drawing import scaled_unit
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import VARIABLES

LAST: Final = 20
"""Starts of the program and texts of failures that are listed, the last ones."""
MOST_FAILING: Final = 6
"""Strings that are named for their failures."""


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
        Places of columns of text; the others, of numbers, are set to the right.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    classes: Sequence[str] = ()
    text_columns: Sequence[int] = ()


def best_strings(data: CampaignData) -> PageTable:
    """Return the best strings, one a column: variables, results and estimates."""
    shown = rank_strings(data).order[: listed_strings(data)]
    rows = [*_variable_rows(data, shown), *_result_rows(data, shown)]
    return PageTable(["", *(f"#{place}" for place in range(1, len(shown) + 1))], rows)


def _row(name: str, entries: Sequence[Any], text: Callable[[Any], str]) -> list[str]:
    """Return a row of the texts of entries, empty for None."""
    return [name, *("" if entry is None else text(entry) for entry in entries)]


def _variable_rows(data: CampaignData, shown: list[int]) -> Iterator[list[str]]:
    yield ["string", *map(str, shown)]
    for variable, row in zip(VARIABLES, data.variable_rows(), strict=True):
        if np.isnan(row["lower"]):  # the campaign does not use it
            continue
        factor, unit = scaled_unit(variable.unit, float(row["upper"]))
        values = data.values(shown, variable.name) / factor
        fixed = "" if row["searched"] else ", fixed"
        name = f"{variable.name.replace('_', ' ')} ({unit}{fixed})"
        yield [name, *(f"{value:.5g}" for value in values)]
    for column in derived_columns(data):
        values = values_of(data, shown, column.name)
        factor, unit = scaled_unit(column.unit, float(np.nanmax(np.abs(values), initial=0.0)))
        name = f"{column.name.replace('_', ' ')} ({unit})"
        yield [name, *(f"{value / factor:.5g}" for value in values)]


def _result_rows(data: CampaignData, shown: list[int]) -> Iterator[list[str]]:
    results = [rank_strings(data).results[string] for string in shown]
    yield _row(
        "objective, as searched",
        results,
        lambda r: value_with_error(float(r["objective"]), float(r["standard_error"])),
    )
    yield from _estimate_rows(data, shown)
    yield _row("mean b/b0, as searched (1)", results, lambda r: f"{r['mean_radius_ratio']:.4g}")
    yield _row("grains per particle, as searched (1)", results, lambda r: f"{r['mean_grains']:.4g}")
    yield _row("samples used", results, lambda r: str(r["samples_used"]))
    yield _time_row(data, shown)


def _time_row(data: CampaignData, shown: list[int]) -> list[str]:
    """Return the processor time of strings; the wall-clock time where that was not recorded."""
    rows, room = data.all_sample_rows(), max(shown) + 1
    label, cost = "processor time", time_of_strings(rows, room, "cpu_seconds")[shown]
    if not np.isfinite(cost).all():
        label, cost = "wall-clock time", time_of_strings(rows, room, "seconds")[shown]
    return [label, *(format_duration(seconds) for seconds in cost.tolist())]


def _estimate_rows(data: CampaignData, shown: list[int]) -> Iterator[list[str]]:
    """Yield rows of the estimates on fresh samples, if any of the strings has one."""
    estimate_of = {estimate.string: estimate for estimate in rank_strings(data).estimates}
    known = [estimate_of.get(string) for string in shown]
    if all(estimate is None for estimate in known):
        return
    yield _row(
        "objective, re-estimate", known, lambda e: value_with_error(e.objective, e.standard_error)
    )
    yield _row("95 % from", known, lambda e: number_or_none(e.lower, ".4f"))
    yield _row("95 % to", known, lambda e: number_or_none(e.upper, ".4f"))
    yield _row("mean b/b0, re-estimate (1)", known, lambda e: f"{e.mean_radius_ratio:.4g}")
    yield _row("fresh samples", known, lambda e: str(e.samples))


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
    return PageTable(headings, lines, "Starts of the program", text_columns=(1, 9, 11, 12))


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
    rows = data.all_sample_rows()[data.all_sample_rows()["state"] == COMPLETED]
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
    headings = ("", "worst", "samples with any", "string", "sample", "to simulate it again")
    return PageTable(headings, lines, text_columns=(5,))


def _replay(data: CampaignData, row: np.void) -> str:
    name = data.path.name
    return f"agglom simulate {name} --string {row['string']} --sample {row['sample']}"


class FailedSamples(NamedTuple):
    """The samples that failed: how many for each reason, of which strings, and their texts.

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
    """Return the failures of a campaign, of which `failed` are the rows of `/samples`."""
    counts = np.bincount(failed["reason"], minlength=len(REASONS)).tolist()
    strings, failures = np.unique(failed["string"], return_counts=True)
    most = np.argsort(-failures, kind="stable")[:MOST_FAILING]
    return FailedSamples(
        [(count, _reason(code)) for code, count in enumerate(counts) if count],
        [(int(strings[i]), int(failures[i])) for i in most],
        [_failure(row) for row in data.failures()[-LAST:]],
    )


def _reason(code: int) -> str:
    return REASONS[code] if 0 < code < len(REASONS) else f"unknown reason ({code})"


def _failure(row: np.void) -> str:
    place = f"string {row['string']} sample {row['sample']}, rank {row['rank']}"
    return f"{place} on {_text(row['host'])}:\n{_text(row['text'])}"
