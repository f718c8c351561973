"""Forecasts, what follows from them, as bounds and advice, and how they are shown."""

import json
import math
from shlex import quote
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rich.console import Group, RenderableType

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_duration, pluralise, without_nan
from agglom_mpi.planning.workload import LEAST_SAMPLES
from agglom_mpi.stopwatch import BUSY_RATIO

if TYPE_CHECKING:
    from agglom_mpi.planning.pilot import GrainAdvice

WELL_USED: Final = 0.5
"""Minimum share of the ranks' time spent on needed samples for a number of ranks to be advised."""

SATURATED: Final = 0.9
"""Minimum share of its time that a saturated rank 0 spends on messages."""

WALLTIME_MARGIN: Final = 2.0
"""Ratio of the advised walltime to the forecast: pilot strings are faster or slower than others."""

START_SECONDS: Final = 300.0
"""Time to start, to compile kernels and to stop before the walltime, s."""

ROUND_SECONDS: Final = 300.0
"""Walltimes are multiples of this, s."""

MAX_SIMULATED: Final = 2_000_000
"""Number of samples after which a forecast without a complete string is given up."""

FORECAST_SAMPLES: Final = 300_000
"""Number of samples that all forecasts of a plan simulate together, about; they take some 10 s.
What is left is taken to be like it."""

WORK: Final = "work"
CHAIN: Final = "chain"
MASTER: Final = "rank 0"
"""Limits of the speed, by their names in the table."""


class MessageCosts(NamedTuple):
    """Costs of messages and decisions, s."""

    latency: float = 0.0
    """From sending a message to reading it."""
    message: float = 0.0
    """Of rank 0, to send or to receive a message."""
    sample: float = 0.0
    """Of rank 0, to evaluate and to store a sample."""
    part: float = 0.0
    """Of rank 0, for the samples of one string in a message, whatever their number."""
    task: float = 0.0
    """Of a rank, to begin and to end the samples of one string."""


FREE: Final = MessageCosts()
"""No costs of messages and decisions."""


class Forecast(NamedTuple):
    """Forecast of a run."""

    ranks: int
    seconds: float
    """Time from the first sample to the last decision, s."""
    busy: float
    """Share of the ranks' time in which they simulate."""
    simulated: int
    used: int
    """Samples completed by the last decision, and those of them that decisions use."""
    work: float
    """Sum of the time of the samples that are used, s."""
    chain: float
    """Length of the critical path, s: generations one after the other, each as long as the longest
    used sample of its strings that depend on earlier results."""
    master: float
    """Share of the time in which rank 0 handles messages."""
    again: float = 0.0
    """Time for the fresh samples of the best strings after that, spread evenly, s."""
    share: float = 1.0
    """Share of the samples that were simulated; the others are taken to be like them."""

    def extended(
        self, share: float, generations: float, first: "Forecast | None" = None
    ) -> "Forecast":
        """Return the forecast of the whole campaign, of which this one is a part.

        Parameters
        ----------
        share
            Share of the campaign's samples in it.
        generations
            Ratio of the campaign's generations to those in it.
        first
            The beginning of the part, up to the end of the first generation: nothing is known
            there, and all ranks begin at once, so that what follows is not like it.
        """
        begin = self._replace(seconds=0.0, simulated=0, used=0, work=0.0)
        if first is not None and first.used < self.used:
            begin = first
        begun = share * begin.used / self.used
        more = (1.0 - begun) / (share - begun)
        seconds, simulated, used, work = (
            getattr(begin, name) + more * (getattr(self, name) - getattr(begin, name))
            for name in ("seconds", "simulated", "used", "work")
        )
        return self._replace(
            seconds=seconds,
            simulated=round(simulated),
            used=round(used),
            work=work,
            chain=min(self.chain * generations, seconds),
            share=share,
        )

    @property
    def core_hours(self) -> float:
        """Time of all ranks together, fresh samples included, h."""
        return self.ranks * (self.seconds + self.again) / 3600.0

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
    def samples_per_second(self) -> float:
        """Samples that rank 0 takes per second, used or not."""
        return self.simulated / self.seconds

    @property
    def walltime(self) -> float:
        """Advised time of a request to a batch system, s."""
        seconds = WALLTIME_MARGIN * (self.seconds + self.again) + START_SECONDS
        return ROUND_SECONDS * math.ceil(seconds / ROUND_SECONDS)

    @property
    def limit(self) -> str:
        """The limit that alone takes longest: `WORK`, `CHAIN` or `MASTER`."""
        alone = {
            WORK: self.work / self.ranks,
            CHAIN: self.chain,
            MASTER: self.master * self.seconds,
        }
        return max(alone, key=lambda name: alone[name])


class PilotSummary(NamedTuple):
    """Number and times (s) of the samples that a forecast is made from."""

    source: str | None
    """Campaign file of the samples; None if they were simulated for the forecast."""
    samples: int
    strings: int
    failed: int
    """Numbers of samples, of their strings, and of samples that failed."""
    mean_seconds: float
    longest_seconds: float
    """Mean and longest time of a sample, s: processor time, where it was recorded."""
    wall_over_cpu: float
    """Ratio of wall-clock to processor time of all samples; nan if it was not recorded."""
    differences: tuple[str, ...]
    """Entries in which the file's campaign differs."""
    relative_error: float = math.nan
    """Standard error of the mean time relative to it, from the spread of the strings' means; nan of
    a single string."""


class ForecastReport(NamedTuple):
    """Forecasts of a campaign for several numbers of ranks."""

    campaign: Campaign
    path: str
    """The campaign and its file."""
    pilot: PilotSummary
    """The samples that the forecasts are made from."""
    costs: MessageCosts
    """Costs of messages and decisions."""
    forecasts: list[Forecast]
    """One for each number of ranks."""
    not_forecast: list[int]
    """Numbers of ranks whose forecast would take more than `MAX_SIMULATED` samples."""
    grains: "GrainAdvice | None" = None
    """How many grains are enough; None where that was not measured."""
    without_grains: bool = False
    """Whether it was to be measured, and the time or the most grains did not suffice."""

    @property
    def saturation(self) -> Forecast | None:
        """The forecast of the fewest ranks that fill rank 0's time; None if none do."""
        full = [f for f in self.forecasts if f.master >= SATURATED]
        return min(full, key=lambda f: f.ranks, default=None)

    @property
    def advice(self) -> Forecast | None:
        """The forecast of the most ranks that are well used; None if none are."""
        used = [f for f in self.forecasts if f.needed >= WELL_USED]
        return max(used, key=lambda f: f.ranks, default=None)


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
    """Return the forecasts as plain values."""
    names = (*Forecast._fields, "core_hours", "bound", "reached", "needed", "wasted", "limit")
    return [{name: getattr(each, name) for name in names} for each in report.forecasts]


def _named(forecast: Forecast | None, *names: str) -> dict[str, float] | None:
    """Return numbers of a forecast by name; None where there is none."""
    return forecast and {name: getattr(forecast, name) for name in names}


def _heading(report: ForecastReport) -> list[str]:
    campaign, pilot, costs = report.campaign, report.pilot, report.costs
    where = "simulated here, one after the other" if pilot.source is None else f"in {pilot.source}"
    failed = f", {pilot.failed} failed" if pilot.failed else ""
    clock = "processor time" if math.isfinite(pilot.wall_over_cpu) else "wall-clock time"
    busy, ratio = [], pilot.wall_over_cpu
    if ratio > BUSY_RATIO:
        took = f"samples took {ratio:.2g} times their processor time"
        busy = [f"busy machine: {took}, which forecasts use"]
    return [
        f"{campaign.title or campaign.name}: at most "
        f"{pluralise(campaign.stopping.generations, 'generation')}, "
        f"{pluralise(campaign.max_strings, 'string')}",
        f"{pluralise(pilot.samples, 'sample')} of {pluralise(pilot.strings, 'string')} {where}: "
        f"mean {format_duration(pilot.mean_seconds)}, "
        f"longest {format_duration(pilot.longest_seconds)} of {clock}{failed}",
        *busy,
        *(f"made differently: {difference}" for difference in pilot.differences),
        f"a message arrives after {format_duration(costs.latency)}; "
        f"rank 0 takes {format_duration(costs.message)} per message,",
        f"{format_duration(costs.part)} per string in it and {format_duration(costs.sample)} "
        "per sample (measured here)",
    ]


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
    if report.campaign.required_plan.certify is not None:
        plan = report.campaign.required_plan.certify
        most = plan.strings * plan.max_samples
        hours = most * report.pilot.mean_seconds / 3600.0
        lines.append(
            f"certificate, not in these times: at most {most:,} samples more, "
            f"{hours:.2g} core-hours"
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
