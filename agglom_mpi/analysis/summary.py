"""Summary of a campaign in numbers, and the selection bias of its best strings."""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.table import Table

from agglom_mpi.analysis.comparison import PairedSamples, significant_differences
from agglom_mpi.analysis.derived import derived_columns, values_of
from agglom_mpi.analysis.estimates import Estimate, objective_of
from agglom_mpi.analysis.ranking import listed_strings, rank_strings, ranks_itself
from agglom_mpi.analysis.tables import time_of_strings
from agglom_mpi.formatting import format_duration, value_with_error
from agglom_mpi.outcome import COMPLETED, summaries
from agglom_mpi.search.moment_targets import MomentTargets
from agglom_mpi.statistics import MeanEstimate
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import NAMES, VARIABLES


class SelectionBias(NamedTuple):
    """Selection bias of the search, and which of the best strings differ significantly.

    Attributes
    ----------
    first
        String with the lowest estimate.
    same
        Strings that do not differ from it at 95 %, in order of rank.
    pairs
        Number of comparisons that the test is corrected for.
    test
        The test: Welch's t, or the paired t on common configurations.
    optimism, standard_error
        Mean of estimate minus the search's own objective, positive if that is biased low, and its
        standard error by the fresh samples.
    """

    first: int
    same: list[int]
    pairs: int
    test: str
    optimism: float
    standard_error: float


def selection_bias(
    estimates: Sequence[Estimate], paired: PairedSamples | None = None
) -> SelectionBias | None:
    """Return the selection bias by estimates, in order of rank; None if none has an error.

    Parameters
    ----------
    estimates
        On fresh samples.
    paired
        Their samples, if strings share configurations.
    """
    known = [estimate for estimate in estimates if estimate.known]
    if not known:
        return None
    places = range(len(known))
    means = [MeanEstimate(e.objective, e.standard_error, e.samples - e.failed) for e in known]
    if paired is None:
        different, test = significant_differences(means), "Welch's t"
        error = float(np.linalg.norm([mean.error for mean in means])) / len(known)
    else:
        strings = [estimate.string for estimate in known]
        differences = {
            (i, j): paired.difference(strings[i], strings[j]) for i, j in combinations(places, 2)
        }
        different, test = (
            significant_differences(means, differences),
            "paired t on common configurations",
        )
        error = paired.average().error
    same = [known[place].string for place in places[1:] if (0, place) not in different]
    optimism = float(np.mean([e.objective - e.searched_objective for e in known]))
    count = len(known) * (len(known) - 1) // 2
    return SelectionBias(known[0].string, same, count, test, optimism, error)


def describe_bias(
    verdict: SelectionBias | None, shown: Sequence[int], estimated: int
) -> Iterator[str]:
    """Yield notes on the selection bias, as lines of text.

    Parameters
    ----------
    verdict
        None if there are no estimates.
    shown
        Strings of the columns of a table, #1 first.
    estimated
        Number of them that have estimates.
    """
    if verdict is None:
        yield "objectives are the search's own; the lucky survive, so they are biased low"
        return
    by = value_with_error(abs(verdict.optimism), verdict.standard_error)
    yield (
        "re-estimates are on fresh samples that no decision has seen; the search's own objectives "
        f"are too {'low' if verdict.optimism > 0 else 'high'}, by {by} on average"
    )
    if estimated < len(shown):
        yield "objectives of strings without re-estimate are the search's own, biased low"
    if verdict.pairs:
        yield _comparison(verdict, shown)


def _comparison(verdict: SelectionBias, shown: Sequence[int]) -> str:
    test = f"at 95 % ({verdict.test}, {verdict.pairs} pair{'s' * (verdict.pairs > 1)}, Holm)"
    places = {string: f"#{place}" for place, string in enumerate(shown, 1)}
    first = places.get(verdict.first, f"string {verdict.first}")
    if not verdict.same:
        return f"{first} is the best of those estimated again, {test}"
    names = [places[string] for string in verdict.same if string in places]
    others = [f"string {string}" for string in verdict.same if string not in places]
    names += others if len(others) < 2 else [f"{len(others)} strings that are not listed"]
    listed = names[-1] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    do = "does" if len(verdict.same) == 1 else "do"
    return f"{listed} {do} not differ significantly from {first} {test}"


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
    generations: int
    strings: int
    samples_used: int
    samples_simulated: int
    samples_fresh: int
    failed: int
    hit_maximum: int
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
        generations=len(generations),
        strings=len(results),
        samples_used=int(results["samples_used"].sum()),
        samples_simulated=len(samples) - fresh,
        samples_fresh=fresh,
        failed=int((samples["state"] == 2).sum()),
        hit_maximum=int(results["hit_maximum"].sum()),
        damaged=file.damaged,
        seconds=seconds,
        samples_per_second=len(samples) / seconds if seconds else 0.0,
        derived={column.name: column.unit for column in derived_columns(file)},
        best=[
            _entry(rows[string], parameters[string], again.get(string))
            | {"seconds": float(wall[string]), "processor_seconds": float(cpu[string])}
            | _moments(file, string)
            | {
                column.name: float(values_of(file, [string], column.name)[0])
                for column in derived_columns(file)
            }
            for string in order[:best]
        ],
        verdict=selection_bias(estimates, PairedSamples.behind(estimates, file)),
    )


def _entry(result: np.void, string: np.void, again: Estimate | None) -> dict[str, Any]:
    entry: dict[str, Any] = {"string": int(result["string"])}
    for name in NAMES:
        if not np.isnan(string[name]):
            entry[name] = float(string[name])
    for name in ("objective", "standard_error", "mean_radius_ratio", "growth_number"):
        entry[name] = float(result[name])
    entry["mean_grains"] = float(result["mean_grains"])
    entry["samples"] = int(result["samples_used"])
    entry["reestimate"] = again and {name: getattr(again, name) for name in REESTIMATED}
    return entry


def _moments(file: CampaignData, string: int) -> dict[str, Any]:
    """Return the `moments` that have a target of their own, of the fresh samples if there are any.

    Empty where the objective has none, so that other entries are as ever.
    """
    law = objective_of(file)
    if not isinstance(law, MomentTargets):
        return {}
    rows = file.all_sample_rows()
    rows = rows[(rows["string"] == string) & (rows["state"] == COMPLETED)]
    fresh = rows["sample"] >= file.fresh_from
    used = rows["sample"] < file.samples_used.get(string, 0)
    reached = law.reached(summaries(rows[fresh if fresh.any() else used]))
    return {"moments": {moment.name: moment.as_dict() for moment in reached}}


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
    table = FitWidth(lambda count: _table(summary, summary.best[:count]), max(1, len(summary.best)))
    note = [SEARCH_ESTIMATES] if ranks_itself(file.identity) and summary.best else []
    return Group(table, *_footer(summary, note))


def _table(summary: Summary, best: list[dict[str, Any]]) -> Table:
    table = Table(title=summary.title or None, title_justify="left", box=None, padding=(0, 1, 0, 0))
    table.add_column("", no_wrap=True)
    for rank in range(1, len(best) + 1):
        table.add_column(f"#{rank}", justify="right", no_wrap=True)
    _add_row(table, "string", best, "string", "d")
    for variable in VARIABLES:
        if best and variable.name in best[0]:
            unit = "" if variable.unit == "1" else f" {variable.unit}"
            _add_row(table, variable.name + unit, best, variable.name, ".4g")
    for name, unit in summary.derived.items():
        _add_row(table, name if unit == "1" else f"{name} {unit}", best, name, ".4g")
    table.add_section()
    again = [entry for entry in summary.best if entry["reestimate"]]
    for name, label, style in (
        ("objective", f"objective{', as searched' if again else ''}", ".4f"),
        ("standard_error", "± standard error", ".4f"),
    ):
        _add_row(table, label, best, name, style)
    if again:
        _add_estimates(table, best)
    _add_moments(table, best)
    for name, label, style in (
        ("mean_radius_ratio", f"mean b/b0{', as searched' if again else ''}", ".4g"),
        ("growth_number", "(mean b/b0)^3", ".4g"),
        ("mean_grains", "grains per particle", ".4g"),
        ("samples", "samples", "d"),
        _time_row(best),
    ):
        _add_row(table, label, best, name, style)
    return table


def _time_row(best: list[dict[str, Any]]) -> tuple[str, str, str]:
    """Return key, label and style of the time of strings: on a processor, if that was recorded."""
    if all(math.isfinite(entry["processor_seconds"]) for entry in best):
        return "processor_seconds", "processor s", ".3g"
    return "seconds", "wall-clock s", ".3g"


def _add_row(table: Table, label: str, best: list[dict[str, Any]], name: str, style: str) -> None:
    table.add_row(label, *(format(entry[name], style) for entry in best))


def _add_estimates(table: Table, best: list[dict[str, Any]]) -> None:
    for name, label, style in (
        ("objective", "re-estimate", ".4f"),
        ("lower", "95 % from", ".4f"),
        ("upper", "95 % to", ".4f"),
        ("mean_radius_ratio", "mean b/b0", ".4g"),
        ("samples", "fresh samples", "d"),
    ):
        values = [entry["reestimate"] and entry["reestimate"][name] for entry in best]
        table.add_row(label, *("" if value is None else format(value, style) for value in values))


def _add_moments(table: Table, best: list[dict[str, Any]]) -> None:
    """Add what was reached of each target of moments, and its share of the objective."""
    found = [entry.get("moments", {}) for entry in best]
    for name, first in (found[0] if found else {}).items():
        reached = [entry[name] for entry in found]
        table.add_row(f"{name}, wanted {first['target']:g}", *(_text(m["value"]) for m in reached))
        table.add_row("  adds to objective", *(_text(m["miss"]) for m in reached))


def _text(value: float | None) -> str:
    return "none" if value is None else f"{value:.4g}"


SEARCH_ESTIMATES: Final = (
    "objectives as searched are of each string's own samples; the progress of a run shows the "
    "search's estimates, which rest on more"
)
"""Said of a search that ranks strings by more than their own samples."""


def _footer(summary: Summary, notes: Sequence[str] = ()) -> list[str]:
    shown = [entry["string"] for entry in summary.best]
    estimated = sum(entry["reestimate"] is not None for entry in summary.best)
    fresh = f" and {summary.samples_fresh} fresh ones" if summary.samples_fresh else ""
    lines = [
        f"{summary.state}: {summary.reason}" if summary.reason else summary.state,
        f"{summary.generations} generations, {summary.strings} strings, {summary.samples_used} "
        f"samples used of {summary.samples_simulated} simulated{fresh}, "
        f"{format_duration(summary.seconds)}, {summary.samples_per_second:.0f} samples/s",
        *describe_bias(summary.verdict, shown, estimated),
        *notes,
    ]
    if summary.hit_maximum:
        lines.append(f"{summary.hit_maximum} strings ended at max_samples, not converged")
    if summary.failed:
        lines.append(f"{summary.failed} samples failed")
    return [*lines, summary.file]


def as_dict(summary: Summary, more: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a summary, and `more` entries, for JSON; nan and inf become None."""
    said = summary.verdict and summary.verdict._asdict()
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
