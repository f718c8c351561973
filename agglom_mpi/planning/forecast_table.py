"""Forecasts as a table, or as JSON."""

import json
import math
from shlex import quote
from typing import Any, Final

from rich.console import Group, RenderableType

from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_duration, pluralise, without_nan
from agglom_mpi.planning.forecast import (
    MAX_SIMULATED,
    WELL_USED,
    Forecast,
    ForecastReport,
    PilotSummary,
)
from agglom_mpi.planning.workload import LEAST_SAMPLES
from agglom_mpi.stopwatch import BUSY_RATIO

EXPLANATION: Final = (
    "useful: share of the ranks' time spent on samples that decisions use\n"
    "rank 0: share of its time spent on messages; samples, used: their numbers\n"
    "ideal: time with an ideal order of work; limited by: work, evenly spread over\n"
    "the ranks; chain, generations that wait for their longest sample; rank 0"
)
"""Meaning of the columns."""

AGAIN: Final = "fresh: at the end, for fresh samples of the best strings"
"""Meaning of the last column, which only campaigns with fresh samples have."""


def to_json(report: ForecastReport) -> str:
    """Return forecasts as JSON; all times in s."""
    content: dict[str, Any] = {
        "campaign": report.campaign.name,
        "generations": report.campaign.stopping.generations,
        "most_strings": report.campaign.max_strings,
        "samples": without_nan(report.pilot._asdict()),
        "costs": report.costs._asdict(),
        "forecasts": _records(report),
        "not_forecast": report.not_forecast,
        "saturation": _named(report.saturation, "ranks", "samples_per_second"),
        "advice": _named(report.advice, "ranks", "walltime", "needed"),
        "finite_size": report.grains and report.grains.as_dict(),
    }
    return json.dumps(content, indent=2)


COLUMNS: Final = (
    Column("ranks", format="d"),
    Column("seconds", "time", format=format_duration),
    Column("core_hours", "core-hours", format=".3g"),
    Column("needed", "useful", format=".0%"),
    Column("master", "rank 0", format=".0%"),
    Column("simulated", "samples", format="d"),
    Column("used", format="d"),
    Column("bound", "ideal", format=format_duration),
    Column("limit", "limited by", text=True),
    Column("again", "+ fresh", format=lambda seconds: format_duration(seconds) if seconds else ""),
)


def forecast_table(report: ForecastReport) -> RenderableType:
    """Return a table of forecasts, with the samples they are made from and an explanation."""
    tables = [Table(COLUMNS, _records(report), gap=1)] if report.forecasts else []
    return Group(*_heading(report), *tables, *_footer(report))


def _records(report: ForecastReport) -> list[dict[str, Any]]:
    names = (*Forecast._fields, "core_hours", "bound", "reached", "needed", "wasted", "limit")
    return [{name: getattr(each, name) for name in names} for each in report.forecasts]


def _named(forecast: Forecast | None, *names: str) -> dict[str, float] | None:
    """Return numbers of a forecast by name; None where there is none."""
    return forecast and {name: getattr(forecast, name) for name in names}


def _heading(report: ForecastReport) -> list[str]:
    campaign, pilot, costs = report.campaign, report.pilot, report.costs
    where = "simulated here, one after the other" if pilot.source is None else f"in {pilot.source}"
    failed = f", {pilot.failed} failed" if pilot.failed else ""
    return [
        f"{campaign.title or campaign.name}: at most "
        f"{pluralise(campaign.stopping.generations, 'generation')}, "
        f"{pluralise(campaign.max_strings, 'string')}",
        f"{pluralise(pilot.samples, 'sample')} of {pluralise(pilot.strings, 'string')} {where}: "
        f"mean {format_duration(pilot.mean_seconds)}, "
        f"longest {format_duration(pilot.longest_seconds)} of {_clock(pilot)}{failed}",
        *_busy(pilot),
        *(f"made differently: {difference}" for difference in pilot.differences),
        f"a message arrives after {format_duration(costs.latency)}; "
        f"rank 0 takes {format_duration(costs.message)} per message,",
        f"{format_duration(costs.part)} per string in it and {format_duration(costs.sample)} "
        "per sample (measured here)",
    ]


def _clock(pilot: PilotSummary) -> str:
    return "processor time" if math.isfinite(pilot.wall_over_cpu) else "wall-clock time"


def _busy(pilot: PilotSummary) -> list[str]:
    if not pilot.wall_over_cpu > BUSY_RATIO:
        return []
    ratio = f"{pilot.wall_over_cpu:.2g}"
    return [f"busy machine: samples took {ratio} times their processor time, which forecasts use"]


def _footer(report: ForecastReport) -> list[str]:
    lines = []
    if report.forecasts and math.isfinite(report.pilot.relative_error):
        strings, error = pluralise(report.pilot.strings, "string"), report.pilot.relative_error
        lines.append(
            f"times rest on {pluralise(report.pilot.samples, 'sample')} of {strings}: "
            f"± {2.0 * error:.0%}, two standard errors,\nif the search's strings are like them"
        )
    if report.pilot.samples < LEAST_SAMPLES * report.pilot.strings:
        lines.append("rough: there are few samples of each string; simulate for more --seconds")
    if shares := [f.share for f in report.forecasts if f.share < 1.0]:
        lines.append(
            f"simulated: at least {min(shares):.1%} of the samples; the rest is extrapolated"
        )
    if report.not_forecast:
        ranks = ", ".join(map(str, report.not_forecast))
        lines.append(
            f"no forecast for {ranks} ranks: more than {MAX_SIMULATED} samples; "
            "fewer --generations take fewer"
        )
    if (full := report.saturation) is not None:
        lines.append(
            f"rank 0 is saturated with {full.ranks} ranks: it takes "
            f"{full.samples_per_second:.0f} samples/s, used or not"
        )
    again = any(f.again for f in report.forecasts)
    grains = [] if report.grains is None else [report.grains.text]
    if report.without_grains:
        grains.append(
            "finite size: not known, not even with twice the grains; more --seconds may show "
            "whether the grains are enough"
        )
    return [*lines, EXPLANATION, *([AGAIN] if again else []), *grains, *_advice(report)]


def _advice(report: ForecastReport) -> list[str]:
    """Return the command that submits the campaign to a batch system."""
    if not report.forecasts:
        return []
    if (advice := report.advice) is None:
        return [
            f"no number of ranks above spends {WELL_USED:.0%} of its time on needed samples; "
            "try fewer --ranks"
        ]
    minutes = round(advice.walltime / 60.0)
    options = f"--ntasks={advice.ranks} --time={minutes // 60:02d}:{minutes % 60:02d}:00"
    return [
        f"most ranks that spend at least {WELL_USED:.0%} of their time on needed samples "
        f"({advice.needed:.0%}):",
        f"  sbatch {options} slurm/campaign.sbatch {quote(report.path)}",
    ]
