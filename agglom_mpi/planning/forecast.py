"""Forecast of a campaign's run time: bounds, saturation, advice; as a table or as JSON."""

import json
import math
from shlex import quote
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rich.console import Group, RenderableType

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.display.fitted_table import FittedTable
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.planning.workload import LEAST_SAMPLES
from agglom_mpi.scheduling.estimators import BATCH_SECONDS
from agglom_mpi.scheduling.interface import MOST_SAMPLES
from agglom_mpi.stopwatch import BUSY_RATIO

if TYPE_CHECKING:
    from agglom_mpi.planning.cluster_simulator import MessageCosts

WELL_USED: Final = 0.5
"""A number of ranks is advised if this share of their time, at least, goes to needed samples."""

MARGIN: Final = 2.0
"""Ratio of the advised walltime to the forecast: pilot strings are faster or slower than others."""

START_SECONDS: Final = 300.0
"""Time to start, to compile kernels and to stop before the walltime, s."""

ROUND_SECONDS: Final = 300.0
"""Walltimes are multiples of this, s."""

MAX_SIMULATED: Final = 2_000_000
"""Number of samples after which a forecast is given up, some minutes."""

WORK: Final = "work"
CHAIN: Final = "chain"
MASTER: Final = "rank 0"
"""What limits the speed, as the table names it."""


class Forecast(NamedTuple):
    """Forecast of a run.

    Attributes
    ----------
    ranks : int
    seconds
        Time from the first sample to the last decision, s.
    busy
        Share of the ranks' time in which they simulate.
    simulated, used
        Samples completed by the last decision, and those of them that decisions use.
    work
        Sum of the time of the samples that are used, s.
    chain
        Length of the critical path, s: generations one after the other, each as long as the longest
        used sample of its strings that depend on earlier results.
    master
        Share of the time in which rank 0 handles messages.
    again
        Time for the fresh samples of the best strings after that, spread evenly, s.
    """

    ranks: int
    seconds: float
    busy: float
    simulated: int
    used: int
    work: float
    chain: float
    master: float
    again: float = 0.0

    @property
    def bound(self) -> float:
        """Lower bound for every scheduler, s: the work spread evenly, or the critical path."""
        return max(self.work / self.ranks, self.chain)

    @property
    def reached(self) -> float:
        """Share of the speed of that bound."""
        return self.bound / self.seconds

    @property
    def needed(self) -> float:
        """Share of the ranks' time that is spent on samples which decisions use."""
        return self.work / (self.seconds * self.ranks)

    @property
    def wasted(self) -> float:
        """Share of the samples that no decision uses."""
        return 1.0 - self.used / self.simulated

    @property
    def limit(self) -> str:
        """What alone would take longest: `WORK`, `CHAIN` or `MASTER`."""
        alone = {
            WORK: self.work / self.ranks,
            CHAIN: self.chain,
            MASTER: self.master * self.seconds,
        }
        return max(alone, key=lambda name: alone[name])


class PilotSummary(NamedTuple):
    """Number and times (s) of the samples that a forecast is made from.

    Attributes
    ----------
    source
        Campaign file of the samples; None if they were simulated for the forecast.
    samples, strings, failed
        Numbers of samples, of their strings, and of samples that failed.
    mean_seconds, longest_seconds
        Mean and longest time of a sample, s: processor time, where it was recorded.
    wall_over_cpu
        Ratio of wall-clock to processor time of all samples; nan if it was not recorded.
    differences
        Entries in which the file's campaign differs.
    """

    source: str | None
    samples: int
    strings: int
    failed: int
    mean_seconds: float
    longest_seconds: float
    wall_over_cpu: float
    differences: tuple[str, ...]


class Saturation(NamedTuple):
    """Ranks that rank 0 can just serve, its samples per s, and the mean time of a sample, s."""

    ranks: float
    samples_per_second: float
    mean_seconds: float


class Advice(NamedTuple):
    """What to ask a batch system for: number of ranks, and time in s."""

    ranks: int
    walltime: float


class ForecastReport(NamedTuple):
    """Forecasts of a campaign for several numbers of ranks.

    Attributes
    ----------
    campaign, path
        The campaign and its file.
    pilot
        The samples that the forecasts are made from.
    costs
        Costs of messages and decisions.
    forecasts
        One for each number of ranks.
    not_forecast
        Numbers of ranks whose forecast would take more than `MAX_SIMULATED` samples.
    """

    campaign: Campaign
    path: str
    pilot: PilotSummary
    costs: "MessageCosts"
    forecasts: list[Forecast]
    not_forecast: list[int]

    @property
    def saturation(self) -> Saturation | None:
        """Saturation of rank 0; None without a forecast."""
        if not self.forecasts:
            return None
        last = self.forecasts[-1]
        return saturation(last.work / last.used, self.costs)

    @property
    def advice(self) -> Advice | None:
        """The most ranks that are well used, or else the fewest; None without a forecast."""
        if not self.forecasts:
            return None
        fewest = min(self.forecasts, key=lambda f: f.ranks)
        used = [f for f in self.forecasts if f.needed >= WELL_USED]
        best = max(used, key=lambda f: f.ranks, default=fewest)
        seconds = MARGIN * (best.seconds + best.again) + START_SECONDS
        return Advice(best.ranks, ROUND_SECONDS * math.ceil(seconds / ROUND_SECONDS))


def saturation(mean_seconds: float, costs: "MessageCosts") -> Saturation:
    """Return how many ranks rank 0 can serve, with one message there and one back for a batch.

    Parameters
    ----------
    mean_seconds
        Mean time of a sample, s.
    costs
        Costs of messages and decisions.
    """
    batch = max(1.0, min(MOST_SAMPLES, BATCH_SECONDS / mean_seconds))
    rate = 1.0 / (costs.sample + 2.0 * costs.message / batch)
    return Saturation(mean_seconds * rate, rate, mean_seconds)


EXPLANATION = (
    "busy: share of the ranks' time in which they simulate; wasted: share of the\n"
    "samples that are simulated before it is known that they are not needed.\n"
    "at best: no order of work could beat it; reached: share of that speed.\n"
    "limit, what takes longest: work, all that is needed, evenly spread; chain,\n"
    "generations that each wait for their longest sample; rank 0, messages."
)

AGAIN = "again: at the end, to estimate the best strings on fresh samples."


def to_json(report: ForecastReport) -> str:
    """Return forecasts as JSON; all times in s."""
    properties = ("bound", "reached", "needed", "wasted", "limit")
    forecasts = [
        forecast._asdict() | {name: getattr(forecast, name) for name in properties}
        for forecast in report.forecasts
    ]
    content: dict[str, Any] = {
        "campaign": report.campaign.name,
        "generations": report.campaign.stopping.generations,
        "most_strings": report.campaign.max_strings,
        "samples": report.pilot._asdict() | {"wall_over_cpu": _finite(report.pilot.wall_over_cpu)},
        "costs": report.costs._asdict(),
        "forecasts": forecasts,
        "not_forecast": report.not_forecast,
        "saturation": report.saturation and report.saturation._asdict(),
        "advice": report.advice and report.advice._asdict(),
    }
    return json.dumps(content, indent=2)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def forecast_table(report: ForecastReport) -> RenderableType:
    """Return a table of forecasts, with the samples they are made from and an explanation."""
    headings = ("ranks", "time", "busy", "simulated", "used", "wasted", "at best", "reached")
    again = any(f.again for f in report.forecasts)
    more = ["+ again"] if again else []
    table = FittedTable(*headings, "limit", *more, left=(8,), gap=1)
    for f in report.forecasts:
        table.add_row(
            str(f.ranks),
            format_duration(f.seconds),
            f"{f.busy:.1%}",
            str(f.simulated),
            str(f.used),
            f"{f.wasted:.1%}",
            format_duration(f.bound),
            f"{f.reached:.1%}",
            f.limit,
            *([format_duration(f.again)] if again else []),
        )
    tables = [table] if report.forecasts else []
    return Group(*_heading(report), *tables, *_footer(report))


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
        f"rank 0 takes {format_duration(costs.message)} for each and "
        f"{format_duration(costs.sample)} for a sample",
    ]


def _clock(pilot: PilotSummary) -> str:
    return "processor time" if math.isfinite(pilot.wall_over_cpu) else "wall-clock time"


def _busy(pilot: PilotSummary) -> list[str]:
    """Return a line on a machine that was busy with something else, if it was."""
    if not pilot.wall_over_cpu > BUSY_RATIO:
        return []
    ratio = f"{pilot.wall_over_cpu:.2g}"
    return [f"busy machine: samples took {ratio} times their processor time, which forecasts use"]


def _footer(report: ForecastReport) -> list[str]:
    lines = []
    if report.pilot.samples < LEAST_SAMPLES * report.pilot.strings:
        lines.append("rough: there are few samples of each string; simulate for more --seconds")
    if report.not_forecast:
        ranks = ", ".join(map(str, report.not_forecast))
        lines.append(
            f"no forecast for {ranks} ranks: more than {MAX_SIMULATED} samples; "
            "fewer --generations take fewer"
        )
    if (full := report.saturation) is not None:
        lines.append(
            f"rank 0 is saturated near {max(1.0, full.ranks):.0f} ranks: it serves "
            f"{full.samples_per_second:.0f} samples/s of {format_duration(full.mean_seconds)}"
        )
    again = any(f.again for f in report.forecasts)
    return [*lines, EXPLANATION, *([AGAIN] if again else []), *_advice(report)]


def _advice(report: ForecastReport) -> list[str]:
    """Return the command that submits the campaign to a batch system."""
    if (advice := report.advice) is None:
        return []
    minutes = round(advice.walltime / 60.0)
    options = f"--ntasks={advice.ranks} --time={minutes // 60:02d}:{minutes % 60:02d}:00"
    return [
        f"for the most ranks that spend {WELL_USED:.0%} of their time or more on needed samples:",
        f"  sbatch {options} slurm/campaign.sbatch {quote(report.path)}",
    ]
