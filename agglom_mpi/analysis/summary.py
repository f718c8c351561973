"""Summary of a campaign: the numbers of `agglom report`, and its table."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement

from agglom_mpi.analysis.comparison import PairedSamples
from agglom_mpi.analysis.derived import derived_columns, values_of
from agglom_mpi.analysis.drawn_sizes import drawn_fraction
from agglom_mpi.analysis.estimates import Estimate, objective_of, rounding_of, unconverged
from agglom_mpi.analysis.failed_samples import no_result, state_lines
from agglom_mpi.analysis.ranking import listed_strings, rank_strings, ranks_itself
from agglom_mpi.analysis.selection_bias import SelectionBias, describe_bias, selection_bias
from agglom_mpi.analysis.tables import time_of_strings
from agglom_mpi.display.fitted_table import FittedTable
from agglom_mpi.formatting import format_duration, number_or_none, pluralise
from agglom_mpi.outcome import COMPLETED, summaries
from agglom_mpi.search.moment_targets import MomentTargets, interval_notes
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import NAMES, VARIABLES

_WIDE: Final = 10_000

REESTIMATED: Final = (
    "objective",
    "standard_error",
    "lower",
    "upper",
    "samples",
    "failed",
    "mean_radius_ratio",
)
"""Attributes of an `Estimate` in a summary."""


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
    results, legs, status = file.result_rows(), file.legs(), file.status()
    samples = file.all_sample_rows()
    parameters = {int(row["string"]): row for row in file.string_rows()}
    rows, estimates, order = rank_strings(file)
    again = {estimate.string: estimate for estimate in estimates}
    fresh = int((samples["sample"] >= file.fresh_from).sum())
    room = max(parameters, default=-1) + 1
    wall, cpu = (time_of_strings(samples, room, name) for name in ("seconds", "cpu_seconds"))
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
        failed=int((samples["state"] == 2).sum()),
        hit_maximum=int(results["hit_maximum"].sum()),
        not_converged=unconverged(file),
        damaged=file.damaged,
        seconds=seconds,
        samples_per_second=len(samples) / seconds if seconds else 0.0,
        derived={column.name: column.unit for column in derived_columns(file)},
        best=[
            _entry(file, rows[string], parameters[string], again.get(string))
            | {"seconds": float(wall[string]), "processor_seconds": float(cpu[string])}
            | _filled(file, string)
            | {
                column.name: float(values_of(file, [string], column.name)[0])
                for column in derived_columns(file)
            }
            for string in order[:best]
        ],
        verdict=selection_bias(estimates, PairedSamples.behind(estimates, file), rounding_of(file)),
    )


def _entry(
    file: CampaignData, result: np.void, string: np.void, again: Estimate | None
) -> dict[str, Any]:
    """Return the numbers of a string: as searched, and under `reestimate` on fresh samples."""
    number = int(result["string"])
    entry: dict[str, Any] = {"string": number}
    for name in NAMES:
        if not np.isnan(string[name]):
            entry[name] = float(string[name])
    for name in ("objective", "standard_error", "mean_radius_ratio", "growth_number"):
        entry[name] = float(result[name])
    entry["mean_grains"] = float(result["mean_grains"])
    entry["samples"] = int(result["samples_used"])
    entry["reestimate"] = again and {name: getattr(again, name) for name in REESTIMATED}
    rows = file.all_sample_rows()
    rows = rows[(rows["string"] == number) & (rows["state"] == COMPLETED)]
    entry |= _moments(file, rows[rows["sample"] < file.samples_used.get(number, 0)])
    if again is not None:
        entry["reestimate"] |= _moments(file, rows[rows["sample"] >= file.fresh_from])
    return entry


def moment_notes(file: CampaignData) -> list[str]:
    """Return what is to be known of the errors of the moments that a campaign has targets for."""
    law = objective_of(file)
    return interval_notes(term.name for term in law.terms) if isinstance(law, MomentTargets) else []


def _moments(file: CampaignData, rows: np.ndarray) -> dict[str, Any]:
    """Return the `moments` that have a target of their own, of completed samples.

    Empty where the objective has none, so that other entries are as ever.
    """
    law = objective_of(file)
    if not isinstance(law, MomentTargets):
        return {}
    return {"moments": {moment.name: moment.as_dict() for moment in law.reached(summaries(rows))}}


def _filled(file: CampaignData, string: int) -> dict[str, Any]:
    """Return the volume fraction of the grains of a string's completed samples; empty if equal."""
    drawn = drawn_fraction(file, string)
    return {} if drawn is None else {"drawn_volume_fraction": drawn.as_dict()}


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
    note = [SEARCH_ESTIMATES] if ranks_itself(file.identity) and summary.best else []
    note += moment_notes(file)
    footer = _footer(summary, state_lines(file), note)
    if summary.no_result:
        return Group(*filter(None, [summary.title]), *footer)
    table = FitWidth(lambda count: _table(summary, summary.best[:count]), max(1, len(summary.best)))
    return Group(table, *footer)


def _table(summary: Summary, best: list[dict[str, Any]]) -> FittedTable:
    ranks = (f"#{rank}" for rank in range(1, len(best) + 1))
    table = FittedTable("", *ranks, gap=1, title=summary.title)
    _add_row(table, "string", best, "string", "d")
    for variable in VARIABLES:
        if best and variable.name in best[0]:
            unit = "" if variable.unit == "1" else f" {variable.unit}"
            _add_row(table, variable.name + unit, best, variable.name, ".4g")
    for name, unit in summary.derived.items():
        _add_row(table, name if unit == "1" else f"{name} {unit}", best, name, ".4g")
    for name, label, style in (
        ("objective", "objective, as searched", ".4f"),
        ("standard_error", "± standard error", ".4f"),
    ):
        _add_row(table, label, best, name, style)
    _add_moments(table, best, "as searched")
    again = [entry["reestimate"] for entry in best]
    if any(again):
        for name, label, style in (
            ("objective", "re-estimate", ".4f"),
            ("lower", "95 % from", ".4f"),
            ("upper", "95 % to", ".4f"),
            ("mean_radius_ratio", "mean b/b0, re-estimate", ".4g"),
            ("samples", "fresh samples", "d"),
        ):
            _add_row(table, label, again, name, style)
        _add_moments(table, again, "re-estimate")
    _add_filled(table, best)
    for name, label, style in (
        ("mean_radius_ratio", "mean b/b0, as searched", ".4g"),
        ("growth_number", "  (mean b/b0)^3", ".4g"),
        ("mean_grains", "  grains per particle", ".4g"),
        ("samples", "  samples", "d"),
        _time_row(best),
    ):
        _add_row(table, label, best, name, style)
    return table


def _time_row(best: list[dict[str, Any]]) -> tuple[str, str, str]:
    """Return key, label and style of the time of strings: on a processor, if that was recorded."""
    if all(math.isfinite(entry["processor_seconds"]) for entry in best):
        return "processor_seconds", "processor s", ".3g"
    return "seconds", "wall-clock s", ".3g"


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
"""Said of a search that ranks strings by more than their own samples."""


def _footer(summary: Summary, states: Sequence[str], notes: Sequence[str] = ()) -> list[str]:
    shown = [entry["string"] for entry in summary.best]
    estimated = sum(entry["reestimate"] is not None for entry in summary.best)
    fresh = ""
    if summary.samples_fresh:
        fresh = f" and {pluralise(summary.samples_fresh, 'fresh one')}"
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
    if summary.failed:
        lines.append(f"{pluralise(summary.failed, 'sample')} failed")
    return [*lines, summary.file]


def as_dict(summary: Summary, more: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a summary, and `more` entries, for JSON; nan and inf become None."""
    verdict = summary.verdict
    said = verdict and {**verdict._asdict(), "is_bias": verdict.is_bias}
    return dict(_without_nan(summary._asdict() | {"verdict": said} | dict(more or {})))


def to_json(summary: Summary, more: Mapping[str, Any] | None = None) -> str:
    """Return `as_dict` as JSON."""
    return json.dumps(as_dict(summary, more), indent=2)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
