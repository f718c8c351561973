"""What `agglom plan` says: forecasts as a table or as JSON."""

import json
from shlex import quote
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

from agglom_mpi.formatting import forecast_time
from agglom_mpi.planning.cluster_simulator import MOST_SIMULATED
from agglom_mpi.planning.forecast import WELL_USED, ForecastReport
from agglom_mpi.planning.workload import LEAST_SAMPLES

MEANINGS = (
    "busy: share of the ranks' time in which they simulate; wasted: share of the\n"
    "samples that are simulated before it is known that they are not needed.\n"
    "at best: no order of work could beat it; reached: share of that speed.\n"
    "limit, what takes longest: work, all that is needed, evenly spread; chain,\n"
    "generations that each wait for their longest sample; rank 0, messages."
)

AGAIN = "again: at the end, to estimate the best strings on fresh samples."


def as_text(plan: ForecastReport) -> str:
    """JSON of a plan; all times in s."""
    properties = ("bound", "reached", "needed", "wasted", "limit")
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
        "saturation": plan.saturation and plan.saturation._asdict(),
        "advice": plan.advice and plan.advice._asdict(),
    }
    return json.dumps(said, indent=2)


def in_words(plan: ForecastReport) -> RenderableType:
    """Table of the forecasts, with what they rest on and what they mean."""
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for name in ("ranks", "time", "busy", "simulated", "used", "wasted", "at best"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("reached", justify="right", no_wrap=True)
    table.add_column("limit", no_wrap=True)
    again = any(f.again for f in plan.forecasts)
    if again:
        table.add_column("+ again", justify="right", no_wrap=True)
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
            *([forecast_time(f.again)] if again else []),
        )
    tables = [table] if plan.forecasts else []
    return Group(*_heading(plan), *tables, *_footer(plan))


def _heading(plan: ForecastReport) -> list[str]:
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


def _footer(plan: ForecastReport) -> list[str]:
    lines = []
    if plan.basis.samples < LEAST_SAMPLES * plan.basis.strings:
        lines.append("rough: there are few samples of each string; simulate for more --seconds")
    if plan.refused:
        ranks = ", ".join(map(str, plan.refused))
        lines.append(
            f"no forecast for {ranks} ranks: more than {MOST_SIMULATED} samples; "
            "fewer --generations take fewer"
        )
    if (full := plan.saturation) is not None:
        lines.append(
            f"rank 0 is saturated near {max(1.0, full.ranks):.0f} ranks: it serves "
            f"{full.samples_per_second:.0f} samples/s of {forecast_time(full.mean_seconds)}"
        )
    again = any(f.again for f in plan.forecasts)
    return [*lines, MEANINGS, *([AGAIN] if again else []), *_advice(plan)]


def _advice(plan: ForecastReport) -> list[str]:
    """How to submit it to a batch system."""
    if (advice := plan.advice) is None:
        return []
    minutes = round(advice.walltime / 60.0)
    wall = f"{minutes // 60:02d}:{minutes % 60:02d}:00"
    return [
        f"for the most ranks that spend {WELL_USED:.0%} of their time or more on needed samples:",
        f"  sbatch --ntasks={advice.ranks} --time={wall} slurm/campaign.sbatch {quote(plan.path)}",
    ]
