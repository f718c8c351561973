"""How long a campaign would take on so many ranks: what `agglom plan` says."""

import json
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table

from agglom_mpi.campaign import Campaign, load_campaign
from agglom_mpi.exit_codes import FAILURE, FINISHED
from agglom_mpi.farm.forecast import Forecast
from agglom_mpi.farm.messages import MOST_SAMPLES
from agglom_mpi.farm.rehearsal import LEAST_SAMPLES, Recorded, Rehearsal, recorded_in
from agglom_mpi.farm.scheduler import BATCH_SECONDS
from agglom_mpi.farm.virtual import MOST_SIMULATED, Costs, TooManySamples, VirtualCluster
from agglom_mpi.farm.work import CampaignWork
from agglom_mpi.report.numbers import forecast_time
from agglom_mpi.search import Batch
from agglom_mpi.simulation.outcome import FAILED

MEANINGS = (
    "busy: share of the ranks' time in which they simulate; wasted: share of the samples that are\n"
    "simulated before it is known that they are not needed. best possible: no order of work could\n"
    "beat it; reached: share of that speed. limit, what takes longest: work, all that is needed,\n"
    "evenly spread; chain, generations that each wait for their longest sample; rank 0, messages."
)


class Options(NamedTuple):
    """What `agglom plan` was asked for; `source` is a campaign file with samples, or None."""

    campaign: str
    ranks: tuple[int, ...]
    source: str | None = None
    seconds: float = 20.0
    generations: int | None = None
    as_json: bool = False


class Basis(NamedTuple):
    """The samples that forecasts rest on: how many, and how long they took, s."""

    source: str | None
    samples: int
    strings: int
    failed: int
    mean_seconds: float
    longest_seconds: float
    differences: tuple[str, ...]


class Plan(NamedTuple):
    """Forecasts of a campaign; `refused` are numbers of ranks that would take too many samples."""

    campaign: Campaign
    basis: Basis
    costs: Costs
    forecasts: list[Forecast]
    refused: list[int]

    @property
    def saturation(self) -> float:
        """Ranks that rank 0 can just serve; nan without a forecast."""
        if not self.forecasts:
            return float("nan")
        last = self.forecasts[-1]
        mean = last.work / last.used
        return mean * serves(mean, self.costs)


def serves(mean_seconds: float, costs: Costs) -> float:
    """Return the samples per s that rank 0 can serve if each takes so long, in batches."""
    batch = max(1.0, min(MOST_SAMPLES, BATCH_SECONDS / mean_seconds))
    seconds = costs.sample + 2.0 * costs.message / batch
    return 1.0 / seconds if seconds else float("inf")


def plan(options: Options) -> tuple[RenderableType, int]:
    """Measure and forecast; what to print, and the exit code: 1 if a forecast is missing.

    Raises
    ------
    CampaignError, NotACampaign, OSError
        If the campaign or the file with samples is not what it should be.
    """
    campaign = load_campaign(options.campaign)
    if options.generations is not None:
        campaign = campaign.with_generations(options.generations)
    campaign.check_searchable()
    with Console(stderr=True).status("") as status:  # only a terminal shows it
        recorded = measure(campaign, options, status.update)
        made = forecasts(campaign, recorded, options, status.update)
    shown = as_text(made) if options.as_json else in_words(made)
    return shown, FAILURE if made.refused else FINISHED


def measure(campaign: Campaign, options: Options, tell: Callable[[str], None]) -> Recorded:
    """Read samples from a file, or simulate some now."""
    if options.source is not None:
        tell("reading samples")
        return recorded_in(options.source, campaign)
    from agglom_mpi.farm.trial import simulate_some  # the simulator, which takes time to load

    return simulate_some(campaign, options.seconds, tell)


def forecasts(
    campaign: Campaign, recorded: Recorded, options: Options, tell: Callable[[str], None]
) -> Plan:
    """Let the campaign run on every number of ranks that was asked for."""
    work, rehearsal, costs = CampaignWork(campaign), Rehearsal(recorded, campaign), Costs()
    made = Plan(campaign, basis(recorded, options.source), costs, [], [])
    for ranks in options.ranks:
        tell(f"forecasting {ranks} ranks")
        cluster = VirtualCluster(
            lambda observer: work.inversion(_as_proposed, observer), rehearsal, ranks, costs
        )
        try:
            made.forecasts.append(cluster.run())
        except TooManySamples:
            made.refused.append(ranks)
    return made


def _as_proposed(batch: Batch, first: int) -> Batch:
    """Take strings as they are: there is no earlier leg."""
    return batch


def basis(recorded: Recorded, source: str | None) -> Basis:
    """Describe the samples that there are."""
    rows = recorded.rows
    seconds = rows["seconds"]
    return Basis(
        source,
        len(rows),
        len(np.unique(rows["string"])),
        int((rows["state"] == FAILED).sum()),
        float(seconds.mean()),
        float(seconds.max()),
        recorded.differences,
    )


def as_text(plan: Plan) -> str:
    """JSON of a plan; all times in s."""
    properties = ("bound", "reached", "wasted", "limit")
    made = [
        forecast._asdict() | {name: getattr(forecast, name) for name in properties}
        for forecast in plan.forecasts
    ]
    said: dict[str, Any] = {
        "campaign": plan.campaign.name,
        "generations": plan.campaign.stopping.generations,
        "most_strings": plan.campaign.most_strings,
        "samples": plan.basis._asdict(),
        "costs": plan.costs._asdict(),
        "forecasts": made,
        "not_forecast": plan.refused,
        "rank_0_saturates_at": plan.saturation if made else None,
    }
    return json.dumps(said, indent=2)


def in_words(plan: Plan) -> RenderableType:
    """Table of the forecasts, with what they rest on and what they mean."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for name in ("ranks", "time", "busy", "simulated", "used", "wasted", "best possible"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("reached", justify="right", no_wrap=True)
    table.add_column("limit", no_wrap=True)
    for f in plan.forecasts:
        table.add_row(
            str(f.ranks),
            forecast_time(f.seconds),
            f"{f.busy:.1%}",
            str(f.simulated),
            str(f.used),
            f"{f.wasted:.1%}",
            forecast_time(f.bound),
            f"{f.reached:.1%}",
            f.limit,
        )
    tables = [table] if plan.forecasts else []
    return Group(*_heading(plan), *tables, *_footer(plan))


def _heading(plan: Plan) -> list[str]:
    campaign, basis, costs = plan.campaign, plan.basis, plan.costs
    where = "simulated here, one after the other" if basis.source is None else f"in {basis.source}"
    failed = f", {basis.failed} failed" if basis.failed else ""
    return [
        f"{campaign.title or campaign.name}: at most {campaign.stopping.generations} generations, "
        f"{campaign.most_strings} strings",
        f"{basis.samples} samples of {basis.strings} strings {where}: mean "
        f"{forecast_time(basis.mean_seconds)}, longest {forecast_time(basis.longest_seconds)}"
        f"{failed}",
        *(f"made differently: {difference}" for difference in basis.differences),
        f"a message arrives after {forecast_time(costs.latency)}; rank 0 takes "
        f"{forecast_time(costs.message)} for each and {forecast_time(costs.sample)} for a sample",
    ]


def _footer(plan: Plan) -> list[str]:
    lines = []
    if plan.basis.samples < LEAST_SAMPLES * plan.basis.strings:
        lines.append("rough: there are few samples of each string; simulate for more --seconds")
    if plan.refused:
        ranks = ", ".join(map(str, plan.refused))
        lines.append(
            f"no forecast for {ranks} ranks: more than {MOST_SIMULATED} samples; "
            "fewer --generations take fewer"
        )
    if plan.forecasts:
        used = plan.forecasts[-1]
        mean = used.work / used.used
        lines.append(
            f"rank 0 is saturated near {plan.saturation:.3g} ranks: it serves "
            f"{serves(mean, plan.costs):.3g} samples/s, and one takes {forecast_time(mean)} "
            "on average"
        )
    return [*lines, MEANINGS]
