"""The end of a run in one table, from the campaign file alone."""

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.table import Table

from agglom_mpi.database.dataframes import processor_seconds
from agglom_mpi.database.estimates import Estimate, estimates_in, own_order, ranking
from agglom_mpi.database.reader import CampaignFile
from agglom_mpi.report.finalists import Verdict, in_words, verdict
from agglom_mpi.report.numbers import duration
from agglom_mpi.report.pairing import Paired
from agglom_mpi.variables import NAMES, VARIABLES

_WIDE: Final = 10_000

REESTIMATED: Final = ("objective", "standard_error", "lower", "upper", "samples", "failed")
"""What is told of an `Estimate`."""


class Summary(NamedTuple):
    """What `agglom report` says; `json.dumps` takes `_asdict()` of it."""

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
    seconds: float
    samples_per_second: float
    best: list[dict[str, Any]]
    verdict: Verdict | None


def collect_summary(file: CampaignFile, best: int = 6) -> Summary:
    """Gather the figures of a campaign file, finished or not, believing only what is final.

    In each of the best `reestimate` is None, or what its fresh samples say; the `verdict` is what
    these say together.
    """
    results, legs, status = file.result_rows(), file.legs(), file.status()
    samples = file.all_sample_rows()
    parameters = {int(row["string"]): row for row in file.string_rows()}
    known = np.isin(results["string"], list(parameters))  # a damaged row is absent
    finite = results[known & np.isfinite(results["objective"])]
    rows = {int(row["string"]): row for row in finite}
    estimates = [estimate for estimate in estimates_in(file, samples) if estimate.string in rows]
    again = {estimate.string: estimate for estimate in estimates}
    order = ranking(own_order(file, finite), estimates)
    fresh = int((samples["sample"] >= file.fresh_from).sum())
    cost = processor_seconds(samples, max(parameters, default=-1) + 1)
    generations = file.generation_rows()
    whole = legs[np.isfinite(legs["stopped"])]
    seconds = float((whole["stopped"] - whole["started"]).sum())
    if len(whole) < len(legs) and len(generations):
        seconds = max(seconds, float(generations["seconds"].max()))
    return Summary(
        file=str(file.path),
        title=str(file.attributes["title"]),
        state=status.state,
        reason=status.reason,
        generations=len(generations),
        strings=len(results),
        samples_used=int(results["samples_used"].sum()),
        samples_simulated=len(samples) - fresh,
        samples_fresh=fresh,
        failed=int((samples["state"] == 2).sum()),
        hit_maximum=int(results["hit_maximum"].sum()),
        seconds=seconds,
        samples_per_second=len(samples) / seconds if seconds else 0.0,
        best=[
            _entry(rows[string], parameters[string], float(cost[string]), again.get(string))
            for string in order[:best]
        ],
        verdict=verdict(estimates, Paired.of_file(file, samples, estimates)),
    )


def _entry(
    result: np.void, string: np.void, seconds: float, again: Estimate | None
) -> dict[str, Any]:
    entry: dict[str, Any] = {"string": int(result["string"])}
    for name in NAMES:
        if not np.isnan(string[name]):
            entry[name] = float(string[name])
    for name in ("objective", "standard_error", "mean_radius_ratio", "growth_number"):
        entry[name] = float(result[name])
    entry["mean_grains"] = float(result["mean_grains"])
    entry["samples"] = int(result["samples_used"])
    entry["processor_seconds"] = seconds
    entry["reestimate"] = again and {name: getattr(again, name) for name in REESTIMATED}
    return entry


class Fitting:
    """What is made of as many of the best strings as there are columns for on a terminal."""

    def __init__(self, make: Callable[[int], RenderableType], most: int) -> None:
        self._make = make
        self._most = most

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for count in range(self._most, 0, -1):
            made = self._make(count)
            wanted = Measurement.get(console, options.update(width=_WIDE), made).maximum
            if wanted <= options.max_width:
                break
        yield made
        if count < self._most:
            yield f"{count} of {self._most} shown; a wider window shows more"


def summarise(file: CampaignFile) -> RenderableType:
    """Table of the best six strings in SI units, and what the campaign took.

    A narrow terminal shows fewer.
    """
    summary = collect_summary(file)
    table = Fitting(lambda count: _table(summary, summary.best[:count]), max(1, len(summary.best)))
    return Group(table, *_footer(summary))


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
    table.add_section()
    again = [entry for entry in summary.best if entry["reestimate"]]
    for name, label, style in (
        ("objective", f"objective{', as searched' if again else ''}", ".4f"),
        ("standard_error", "± standard error", ".4f"),
    ):
        _add_row(table, label, best, name, style)
    if again:
        _add_estimates(table, best)
    for name, label, style in (
        ("mean_radius_ratio", "mean b/b0", ".4g"),
        ("growth_number", "(mean b/b0)^3", ".4g"),
        ("mean_grains", "grains per particle", ".4g"),
        ("samples", "samples", "d"),
        ("processor_seconds", "processor s", ".3g"),
    ):
        _add_row(table, label, best, name, style)
    return table


def _add_row(table: Table, label: str, best: list[dict[str, Any]], name: str, style: str) -> None:
    table.add_row(label, *(format(entry[name], style) for entry in best))


def _add_estimates(table: Table, best: list[dict[str, Any]]) -> None:
    for name, label, style in (
        ("objective", "re-estimate", ".4f"),
        ("lower", "95 % from", ".4f"),
        ("upper", "95 % to", ".4f"),
        ("samples", "fresh samples", "d"),
    ):
        values = [entry["reestimate"] and entry["reestimate"][name] for entry in best]
        table.add_row(label, *("" if value is None else format(value, style) for value in values))


def _footer(summary: Summary) -> list[str]:
    shown = [entry["string"] for entry in summary.best]
    estimated = sum(entry["reestimate"] is not None for entry in summary.best)
    fresh = f" and {summary.samples_fresh} fresh ones" if summary.samples_fresh else ""
    lines = [
        f"{summary.state}: {summary.reason}" if summary.reason else summary.state,
        f"{summary.generations} generations, {summary.strings} strings, {summary.samples_used} "
        f"samples used of {summary.samples_simulated} simulated{fresh}, "
        f"{duration(summary.seconds)}, {summary.samples_per_second:.0f} samples/s",
        *in_words(summary.verdict, shown, estimated),
    ]
    if summary.hit_maximum:
        lines.append(f"{summary.hit_maximum} strings ended at max_samples, not converged")
    if summary.failed:
        lines.append(f"{summary.failed} samples failed")
    return [*lines, summary.file]


def as_dict(summary: Summary, more: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a summary, and more by name, for JSON; numbers that are none are None."""
    said = summary.verdict and summary.verdict._asdict()
    return dict(_without_nan(summary._asdict() | {"verdict": said} | dict(more or {})))


def as_text(summary: Summary, more: Mapping[str, Any] | None = None) -> str:
    """JSON of `as_dict`."""
    return json.dumps(as_dict(summary, more), indent=2)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
