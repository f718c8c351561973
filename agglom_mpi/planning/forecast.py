"""The run time of a campaign for numbers of ranks: forecast, saturation, advice."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from rich.console import Console

from agglom_mpi.analysis.warm_start import warm_start_strings
from agglom_mpi.config.campaign import Campaign, load_campaign
from agglom_mpi.config.libraries import check_libraries
from agglom_mpi.outcome import FAILED
from agglom_mpi.planning.cluster_simulator import (
    ClusterSimulator,
    MessageCosts,
    TooManySamples,
    Workload,
)
from agglom_mpi.planning.saturation import Forecast
from agglom_mpi.planning.workload import EmpiricalWorkload, PilotSamples, recorded_in
from agglom_mpi.runtime.experiment import Experiment, InversionExperiment
from agglom_mpi.scheduling.estimators import BATCH_SECONDS
from agglom_mpi.scheduling.interface import MOST_SAMPLES
from agglom_mpi.search.inversion import Inversion

WELL_USED: Final = 0.5
"""Share of the ranks' time that has to go into needed samples for so many ranks to be advised."""

MARGIN: Final = 2.0
"""Times that is asked for a forecast one: other strings than random ones take longer or shorter."""

START_SECONDS: Final = 300.0
"""Time to start, to compile kernels and to stop before the walltime, s."""

ROUND_SECONDS: Final = 300.0
"""Walltimes are multiples of this, s."""


class Options(NamedTuple):
    """What `agglom plan` was asked for; `source` is a campaign file with samples, or None."""

    campaign: str
    ranks: tuple[int, ...]
    source: str | None = None
    seconds: float = 20.0
    generations: int | None = None
    allow_code: bool = False


class Basis(NamedTuple):
    """The samples that forecasts rest on: how many, and how long they took, s."""

    source: str | None
    samples: int
    strings: int
    failed: int
    mean_seconds: float
    longest_seconds: float
    differences: tuple[str, ...]


class Saturation(NamedTuple):
    """Ranks that rank 0 can just serve, its samples per s, and the mean time of one, s."""

    ranks: float
    samples_per_second: float
    mean_seconds: float


class Advice(NamedTuple):
    """What to ask a batch system for: number of ranks, and time in s."""

    ranks: int
    walltime: float


class ForecastReport(NamedTuple):
    """Forecasts of a campaign; `refused` are numbers of ranks that would take too many samples."""

    campaign: Campaign
    path: str
    basis: Basis
    costs: MessageCosts
    forecasts: list[Forecast]
    refused: list[int]

    @property
    def saturation(self) -> Saturation | None:
        """Where rank 0 has no time left; None without a forecast."""
        if not self.forecasts:
            return None
        last = self.forecasts[-1]
        return saturation(last.work / last.used, self.costs)

    @property
    def advice(self) -> Advice | None:
        """The most ranks that are still well used, else the fewest; None without a forecast."""
        if not self.forecasts:
            return None
        fewest = min(self.forecasts, key=lambda f: f.ranks)
        used = [f for f in self.forecasts if f.needed >= WELL_USED]
        best = max(used, key=lambda f: f.ranks, default=fewest)
        seconds = MARGIN * (best.seconds + best.again) + START_SECONDS
        return Advice(best.ranks, ROUND_SECONDS * math.ceil(seconds / ROUND_SECONDS))


def saturation(mean_seconds: float, costs: MessageCosts) -> Saturation:
    """Return what rank 0 can serve if samples take so long: a message there and one back."""
    batch = max(1.0, min(MOST_SAMPLES, BATCH_SECONDS / mean_seconds))
    rate = 1.0 / (costs.sample + 2.0 * costs.message / batch)
    return Saturation(mean_seconds * rate, rate, mean_seconds)


def plan(options: Options) -> ForecastReport:
    """Measure and forecast, and show on a terminal how that goes.

    Raises
    ------
    CampaignError, NotACampaign, OSError
        If the campaign or the file with samples is not what it should be.
    """
    campaign = load_campaign(options.campaign, options.allow_code)
    if options.generations is not None:
        campaign = campaign.with_generations(options.generations)
    campaign.check_searchable()
    check_libraries(campaign)
    with Console(stderr=True).status("") as status:  # only a terminal shows it
        recorded = measure(campaign, options, status.update)
        return forecasts(campaign, recorded, options, status.update)


def measure(campaign: Campaign, options: Options, tell: Callable[[str], None]) -> PilotSamples:
    """Read samples from a file, or simulate some now."""
    if options.source is not None:
        tell("reading samples")
        return recorded_in(options.source, campaign)
    from agglom_mpi.planning.pilot import run_pilot  # the simulator, which takes time to load

    return run_pilot(campaign, options.seconds, tell)


def forecasts(
    campaign: Campaign, recorded: PilotSamples, options: Options, tell: Callable[[str], None]
) -> ForecastReport:
    """Let the campaign run on every number of ranks that was asked for."""
    experiment = InversionExperiment(campaign, warm_start_strings(campaign))
    rehearsal, costs = EmpiricalWorkload(recorded, campaign), MessageCosts()
    made = ForecastReport(
        campaign, options.campaign, basis(recorded, options.source), costs, [], []
    )
    for ranks in options.ranks:
        tell(f"forecasting {ranks} ranks")
        inversion = experiment.inversion(restore=None)
        cluster = ClusterSimulator(inversion, rehearsal, ranks, costs, campaign.search.lag)
        try:
            forecast = cluster.run()
            again = fresh_seconds(experiment, cluster.inversion, rehearsal, ranks)
            made.forecasts.append(forecast._replace(again=again))
        except TooManySamples:
            made.refused.append(ranks)
    return made


def fresh_seconds(
    experiment: Experiment, inversion: Inversion, workload: Workload, ranks: int
) -> float:
    """Time that the fresh samples of the best strings take when the search is over, s.

    They are all known then: nothing but their number and the longest of them limits it.
    """
    strings, samples = experiment.reestimation_plan(inversion)
    first = experiment.table_sizes.max_samples
    seconds = [
        workload.sample(string, inversion.parameters(string), sample)[1]
        for string in strings
        for sample in range(first, first + samples)
    ]
    return max(sum(seconds) / ranks, max(seconds, default=0.0))


def basis(recorded: PilotSamples, source: str | None) -> Basis:
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
