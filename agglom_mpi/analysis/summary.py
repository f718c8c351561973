"""Summary of a campaign: the numbers of `agglom report`, and its table."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement

from agglom_mpi.analysis.best_strings import (
    FRESH_ROWS,
    GROWTH_ROWS,
    LIMIT_ROWS,
    OBJECTIVE_ROWS,
    collect_best,
    time_row,
)
from agglom_mpi.analysis.comparison import PairedSamples
from agglom_mpi.analysis.data_fit import describe_fit
from agglom_mpi.analysis.derived import derived_columns
from agglom_mpi.analysis.estimates import objective_of, rounding_of, unconverged
from agglom_mpi.analysis.failed_samples import failure_lines, no_result, state_lines
from agglom_mpi.analysis.finite_size import describe_finite_size
from agglom_mpi.analysis.quantity_means import quantity_rows
from agglom_mpi.analysis.ranking import listed_strings, rank_strings, ranks_itself
from agglom_mpi.analysis.selection_bias import SelectionBias, describe_bias, selection_bias
from agglom_mpi.display.fitted_table import FittedTable
from agglom_mpi.formatting import format_duration, in_unit, number_or_none, pluralise, without_nan
from agglom_mpi.outcome import FAILED
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import PAPER_VARIABLES

_WIDE: Final = 10_000


class Summary(NamedTuple):
    """The numbers of `agglom report`, whose names are the keys of its JSON."""

    file: str
    title: str
    state: str
    reason: str
    no_result: str
    """Why no string has a result; empty where one has."""
    generations: int
    strings: int
    samples_used: int
    samples_simulated: int
    samples_fresh: int
    samples_in_larger_volumes: int
    failed: int
    hit_maximum: int
    not_converged: int
    """Strings of `hit_maximum` whose samples differ by more than rounding."""
    damaged: int
    seconds: float
    samples_per_second: float
    derived: dict[str, str]
    """SI units of the derived columns in `best`, by name."""
    best: list[dict[str, Any]]
    verdict: SelectionBias | None
    further: dict[str, str]
    """SI units of the variables beside those of the papers, by name."""


def collect_summary(file: CampaignData, best: int = 6) -> Summary:
    """Return the summary of a campaign file, finished or not.

    Parameters
    ----------
    file
        The campaign.
    best
        Number of the best strings to include. Each has a `reestimate` on its fresh samples, None if
        it has none.
    """
    results, legs, status = file.result_rows(), file.legs(), live_status(file)
    samples = file.all_sample_rows()
    estimates = rank_strings(file).estimates
    fresh = int((samples["sample"] >= file.fresh_from).sum())
    generations = file.generation_rows()
    whole = legs[np.isfinite(legs["stopped"])]
    seconds = float((whole["stopped"] - whole["started"]).sum())
    if len(whole) < len(legs) and len(generations):
        seconds = max(seconds, float(generations["seconds"].max()))
    return Summary(
        file=str(file.path),
        title=file.title,
        state=status.state,
        reason=status.reason,
        no_result=no_result(file),
        generations=len(generations),
        strings=len(results),
        samples_used=int(results["samples_used"].sum()),
        samples_simulated=len(samples) - fresh,
        samples_fresh=fresh,
        samples_in_larger_volumes=file.volume_count,
        failed=int((file.counted_samples["state"] == FAILED).sum()),
        hit_maximum=int(results["hit_maximum"].sum()),
        not_converged=unconverged(file),
        damaged=file.damaged,
        seconds=seconds,
        samples_per_second=(len(samples) + file.volume_count) / seconds if seconds else 0.0,
        derived={column.name: column.unit for column in derived_columns(file)},
        best=collect_best(file, best),
        verdict=selection_bias(estimates, PairedSamples.behind(estimates, file), rounding_of(file)),
        further={variable.name: variable.unit for variable in file.variables.further},
    )


def moment_notes(file: CampaignData) -> list[str]:
    """Return what is to be known of the errors of the moments that a campaign has targets for."""
    return objective_of(file).notes


class FitWidth:
    """A renderable with as many of its columns as fit the width of the terminal."""

    def __init__(self, make: Callable[[int], RenderableType], most: int) -> None:
        self._make = make
        self._most = most

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement.get(console, options.update(width=_WIDE), self._make(self._most))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for count in range(self._most, 0, -1):
            made = self._make(count)
            wanted = Measurement.get(console, options.update(width=_WIDE), made).maximum
            if wanted <= options.max_width:
                break
        yield made
        if count < self._most:
            yield f"{count} of {self._most} shown; a wider window shows more"


def summary_table(file: CampaignData, best: int | None = None) -> RenderableType:
    """Return a table of the best strings in SI units, and the cost of the campaign.

    A narrow terminal shows fewer strings. There are `best` at most, or `listed_strings`.
    """
    summary = collect_summary(file, listed_strings(file) if best is None else best)
    note = [SEARCH_ESTIMATES] if ranks_itself(file) and summary.best else []
    note += moment_notes(file)
    note += [line for entry in summary.best[:1] for line in describe_fit(file, entry["string"])]
    note += describe_finite_size(file, [entry["string"] for entry in summary.best])
    if not summary.no_result:
        note += failure_lines(file)
    footer = _footer(summary, state_lines(file), note)
    if summary.no_result:
        return Group(*filter(None, [summary.title]), *footer)
    more = quantity_rows(file, [entry["string"] for entry in summary.best])
    table = FitWidth(
        lambda count: _table(summary, summary.best[:count], more), max(1, len(summary.best))
    )
    return Group(table, *footer)


def _table(
    summary: Summary, best: list[dict[str, Any]], more: Sequence[list[str]] = ()
) -> FittedTable:
    """Return the table of some strings; `more` rows, label and cells, follow their objectives."""
    ranks = (f"#{rank}" for rank in range(1, len(best) + 1))
    table = FittedTable("", *ranks, gap=1, title=summary.title)
    _add_row(table, "string", best, "string", "d")
    units = {variable.name: variable.unit for variable in PAPER_VARIABLES} | summary.further
    for name, unit in units.items():
        if best and name in best[0]:
            _add_row(table, in_unit(name, unit), best, name, ".4g")
    for name, unit in summary.derived.items():
        _add_row(table, in_unit(name, unit), best, name, ".4g")
    for row in OBJECTIVE_ROWS:
        _add_row(table, row.on_terminal, best, row.key, row.style)
    _add_moments(table, best, "as searched")
    again = [entry["reestimate"] for entry in best]
    if any(again):
        for row in FRESH_ROWS:
            _add_row(table, row.on_terminal, again, row.key, row.style)
        _add_moments(table, again, "re-estimate")
    limits = [entry.get("finite_size") for entry in best]
    if any(limits):
        for row in LIMIT_ROWS:
            _add_row(table, row.on_terminal, limits, row.key, row.style)
    for cells in more:
        table.add_row(*cells[: 1 + len(best)])
    _add_filled(table, best)
    for row in (*GROWTH_ROWS, time_row(best)):
        _add_row(table, row.on_terminal, best, row.key, row.style)
    return table


def _add_row(
    table: FittedTable, label: str, entries: Sequence[dict[str, Any] | None], name: str, style: str
) -> None:
    """Add a number of each entry; its cell is empty where there is no entry."""
    cells = ("" if entry is None else number_or_none(entry[name], style) for entry in entries)
    table.add_row(label, *cells)


def _add_moments(table: FittedTable, entries: Sequence[dict[str, Any] | None], kind: str) -> None:
    """Add what was reached of each target of moments, and its share of the objective."""
    found = [entry and entry.get("moments", {}) for entry in entries]
    for name, first in (next((each for each in found if each), None) or {}).items():
        reached = [each and each.get(name) for each in found]
        for label, key in (
            (f"{name}, wanted {first['target']:g}, {kind}", "value"),
            ("  adds to objective", "miss"),
        ):
            _add_row(table, label, reached, key, ".4g")


def _add_filled(table: FittedTable, best: list[dict[str, Any]]) -> None:
    """Add what the drawn grains of completed samples fill of the box, where grains differ."""
    found = [entry.get("drawn_volume_fraction") for entry in best]
    if any(found):
        _add_row(table, "volume fraction drawn", found, "mean", ".4f")
        _add_row(table, "± standard error", found, "standard_error", ".4f")


SEARCH_ESTIMATES: Final = (
    "objectives as searched are of each string's own samples; the progress of a run shows the "
    "search's estimates, which rest on more"
)
"""Note on a search that ranks strings by more than their own samples."""


def _footer(summary: Summary, states: Sequence[str], notes: Sequence[str] = ()) -> list[str]:
    """Return the lines below the table."""
    shown = [entry["string"] for entry in summary.best]
    estimated = sum(entry["reestimate"] is not None for entry in summary.best)
    fresh = ""
    if summary.samples_fresh:
        fresh = f" and {pluralise(summary.samples_fresh, 'fresh one')}"
    if summary.samples_in_larger_volumes:
        fresh += f", {summary.samples_in_larger_volumes} in larger volumes"
    lines = [
        *states,
        f"{pluralise(summary.generations, 'generation')}, {pluralise(summary.strings, 'string')}, "
        f"{pluralise(summary.samples_used, 'sample')} used of {summary.samples_simulated} "
        f"simulated{fresh}, "
        f"{format_duration(summary.seconds)}, {summary.samples_per_second:.0f} samples/s",
        *(() if summary.no_result else describe_bias(summary.verdict, shown, estimated)),
        *notes,
    ]
    if summary.not_converged:
        strings = pluralise(summary.not_converged, "string")
        lines.append(f"{strings} ended at max_samples, not converged")
    return [*lines, summary.file]


def as_dict(summary: Summary, more: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a summary, and `more` entries, for JSON; nan and inf become None."""
    verdict = summary.verdict
    said = verdict and {**verdict._asdict(), "is_bias": verdict.is_bias}
    entries = summary._asdict() | {"verdict": said} | dict(more or {})
    if not summary.further:
        del entries["further"]
    if not summary.samples_in_larger_volumes:
        del entries["samples_in_larger_volumes"]
    return dict(without_nan(entries))


def to_json(summary: Summary, more: Mapping[str, Any] | None = None) -> str:
    """Return `as_dict` as JSON."""
    return json.dumps(as_dict(summary, more), indent=2)
