"""Forecasting the run time of a campaign: pilot samples, then the scheduler on simulated ranks."""

import logging
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console

from agglom_mpi.analysis.tables import time_on_free_core, wall_over_cpu
from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.searchable import check_search_library, log_narrow
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import FAILED
from agglom_mpi.planning.cluster_simulator import ClusterSimulator, TooManySamples
from agglom_mpi.planning.forecast import (
    FORECAST_SAMPLES,
    ForecastReport,
    PilotSummary,
)
from agglom_mpi.planning.workload import (
    EmpiricalWorkload,
    PilotSamples,
    Workload,
    read_recorded_samples,
)
from agglom_mpi.runtime.experiment import Experiment, InversionExperiment
from agglom_mpi.runtime.file_setup import as_recorded
from agglom_mpi.search.inversion import Inversion

LOG: Final = logging.getLogger(__name__)
"""Receives lines on what is compiled, where no terminal shows them."""


def plan(
    path: str,
    ranks: tuple[int, ...],
    seconds: float,
    source: str | None = None,
    generations: int | None = None,
    allow_code: bool = False,
) -> ForecastReport:
    """Return the forecasts for a campaign; a terminal shows the progress.

    Parameters
    ----------
    path
        Name of the campaign.
    ranks
        Numbers of ranks to forecast for.
    seconds
        Time to spend on pilot samples, s.
    source
        Campaign file with samples; None simulates pilot samples.
    generations
        Number of generations, if it is not that of the campaign.
    allow_code
        Whether code that the campaign names may run.

    Raises
    ------
    CampaignError, NotACampaign, OSError
        If the campaign or the file with samples cannot be used.
    """
    campaign = load_campaign(path, allow_code)
    campaign = as_recorded(campaign, Path(source or campaign.file_name))
    if generations is not None:
        campaign = campaign.with_generations(generations)
    log_narrow(campaign)
    check_search_library(campaign)
    experiment = InversionExperiment(campaign, warm_start(campaign, Path(campaign.file_name)))
    console = Console(stderr=True)
    with console.status("") as status:  # only a terminal shows it
        if source is not None:
            status.update("reading samples")
            samples = read_recorded_samples(source, campaign)
            return forecast_all(experiment, samples, path, ranks, status.update)
        # Imported here: it loads the kernels.
        from agglom_mpi.planning.pilot import advise_grains, run_pilot

        announce = status.update if console.is_terminal else LOG.info
        samples = run_pilot(campaign, seconds, status.update, announce)
        report = forecast_all(experiment, samples, path, ranks, status.update)
        grains = advise_grains(campaign, samples, seconds, status.update)
        return report._replace(grains=grains, without_grains=grains is None)


def forecast_all(
    experiment: Experiment,
    samples: PilotSamples,
    path: str,
    numbers: tuple[int, ...],
    show: Callable[[str], None],
) -> ForecastReport:
    """Return the forecasts for some numbers of ranks of a campaign, whose name is `path`."""
    from agglom_mpi.planning.message_costs import measured_costs  # loads the kernels

    campaign = experiment.campaign
    workload = EmpiricalWorkload(samples, campaign)
    costs = measured_costs(experiment, workload, show)
    report = ForecastReport(campaign, path, pilot_summary(samples), costs, [], [])
    part = FORECAST_SAMPLES / (1 + len(numbers))
    known = samples_needed(experiment, workload, part)
    most = part if known else math.inf
    for ranks in numbers:
        inversion, lag = experiment.inversion(restore=None), campaign.search.lag
        cluster = ClusterSimulator(inversion, workload, ranks, costs, lag, known)
        try:
            forecast = cluster.run(
                most if known else math.inf, partial(_show_progress, show, campaign, ranks)
            )
            if known:
                needed = sum(known) / len(known) * campaign.max_strings
                generations = campaign.stopping.generations / (inversion.generation + 1)
                share = min(1.0, cluster.samples_used / needed)
                forecast = forecast.extended(share, generations, cluster.first)
        except TooManySamples:
            report.not_forecast.append(ranks)
            continue
        again = reestimation_seconds(experiment, inversion, workload, ranks)
        report.forecasts.append(forecast._replace(again=again))
    return report


def _show_progress(
    show: Callable[[str], None], campaign: Campaign, ranks: int, generation: int, samples: int
) -> None:
    progress = f"generation {generation} of {campaign.stopping.generations}"
    show(f"forecasting {pluralise(ranks, 'rank')}: {samples} samples, {progress}")


def samples_needed(experiment: Experiment, workload: Workload, most: float) -> list[int]:
    """Return the samples that strings need of a campaign with more than `most`; else nothing.

    These are the strings that come first: one rank completes them in their order. Of many ranks
    those would be complete first that need few samples.
    """
    inversion = experiment.inversion(restore=None)
    cluster = ClusterSimulator(inversion, workload, ranks=1)
    try:
        cluster.run(most)
    except TooManySamples:  # as with any number of ranks
        return []
    return [] if inversion.finished else list(cluster.path.used.values())


def reestimation_seconds(
    experiment: Experiment, inversion: Inversion, workload: Workload, ranks: int
) -> float:
    """Return the time for the fresh samples of the best strings so far after the search, s.

    All of them are known then, so that their sum and the longest of them bound it. A sample of a
    larger control volume takes as many times as long.
    """
    strings, samples, volumes = experiment.reestimation_plan(inversion)
    first = experiment.table_sizes.max_samples
    seconds = [
        duration
        for string in strings
        for duration in workload.samples(inversion.parameters(string), first, samples)[1].tolist()
    ]
    return max(sum(seconds) * sum(volumes) / ranks, max(seconds, default=0.0) * max(volumes))


def pilot_summary(pilot: PilotSamples) -> PilotSummary:
    """Return number and times of pilot samples."""
    rows = pilot.rows
    seconds = time_on_free_core(rows)
    _, which, count = np.unique(rows["string"], return_inverse=True, return_counts=True)
    means = np.bincount(which, seconds) / count
    error = means.std(ddof=1) / math.sqrt(len(means)) if len(means) > 1 else math.nan
    return PilotSummary(
        pilot.source,
        len(rows),
        len(count),
        int((rows["state"] == FAILED).sum()),
        float(seconds.mean()),
        float(seconds.max()),
        wall_over_cpu(rows),
        pilot.differences,
        float(error / means.mean()),
    )
