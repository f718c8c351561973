"""Pilot samples: random strings simulated here for a short time."""

import time
from collections.abc import Callable, Iterable, Iterator
from threading import Timer
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import pluralise
from agglom_mpi.planning.workload import PilotSamples
from agglom_mpi.random_streams import RANDOM_STRING, search_stream
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.messages import RankMessage, merged
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import new_tasks

STRINGS_PER_SAMPLE: Final = 4
"""Ratio of strings to samples per string: times differ more between strings than within one."""


def run_pilot(
    campaign: Campaign,
    seconds: float,
    show: Callable[[str], None],
    announce: Callable[[str], None] | None = None,
) -> PilotSamples:
    """Simulate samples of random strings for `seconds`, compilation not counted.

    The first strings are those of the campaign's first generation.

    Parameters
    ----------
    campaign
        Campaign to forecast.
    seconds
        Time limit, s.
    show
        Called with a line on the progress.
    announce
        Called with a line on what is compiled; by default `show`.

    Raises
    ------
    CampaignError
        If no sample is complete within the time.
    """
    runner = SampleRunner(InversionExperiment(campaign), 0)
    show("loading the simulation")
    runner.warm_up(announce or show)
    begin, rows = time.monotonic(), 0
    strings: list[NDArray[np.float64]] = []
    finished: list[RankMessage] = []

    def tasks() -> Iterator[np.void]:
        most = campaign.max_strings, campaign.ensemble.max_samples
        for string, first, count in pilot_tasks(*most):
            if string == len(strings):
                strings.append(_random_string(campaign, string))
            yield task_of(string, first, count, strings[string])

    for message in simulate_for(seconds, runner, tasks()):
        finished.append(message)
        rows += len(message.results)
        done = f"{pluralise(rows, 'sample')} of {pluralise(len(strings), 'string')}"
        show(f"simulating: {done}, {time.monotonic() - begin:.0f} s")
    if not rows:
        why = f"no sample is done within {seconds:g} s; allow more with --seconds"
        raise CampaignError(Problem(campaign.name, None, "", why))
    return PilotSamples(merged(0, finished).results, np.array(strings))


def pilot_tasks(most_strings: int, most_samples: int) -> Iterator[tuple[int, int, int]]:
    """Yield string, first sample and number of samples of tasks, in rounds that double in size."""
    before = 0
    while True:
        samples = min(max(1, 2 * before), most_samples)
        # Strings of earlier rounds have their first samples already.
        old = min(STRINGS_PER_SAMPLE * before, most_strings)
        new = min(STRINGS_PER_SAMPLE * samples, most_strings)
        for string in range(new):
            first = before if string < old else 0
            if first < samples:
                yield string, first, samples - first
        if samples == most_samples:
            break
        before = samples
    for string in range(new, most_strings):
        yield string, 0, most_samples


def _random_string(campaign: Campaign, number: int) -> NDArray[np.float64]:
    """Return random string `number` of the search box, shape (k,); the first are generation 0."""
    generation, slot = divmod(number, campaign.search.population)
    return campaign.space().sample(search_stream(campaign.seed, RANDOM_STRING, generation, slot))


def task_of(string: int, first: int, count: int, parameters: NDArray[np.float64]) -> np.void:
    """Return a task, a record of `task_type`, for samples of a string, (k,)."""
    task = new_tasks([parameters])
    task["string"], task["first"], task["count"] = string, first, count
    return task[0]


def simulate_for(
    seconds: float, runner: SampleRunner, tasks: Iterable[np.void]
) -> Iterator[RankMessage]:
    """Yield the results of tasks until the time is up; the last ones may then be incomplete."""
    # A timer thread, because a single sample may take longer than the time limit.
    alarm = Timer(seconds, runner.abort_flag.stop)
    alarm.start()
    try:
        for record in tasks:
            task = runner.begin(record)
            while task.simulate_next():
                pass
            yield task.collect()
            if runner.abort_flag.stopped:
                return
    finally:
        alarm.cancel()
