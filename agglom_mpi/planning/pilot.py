"""Pilot samples, simulated here: of random strings, and of one in several control volumes.

The first show how long a campaign takes, the second how many grains it needs.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from threading import Timer
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.extrapolation import Extrapolation
from agglom_mpi.analysis.finite_size import (
    VolumeMeans,
    enough_grains,
    growth_of_many,
    means_of_rows,
    why_no_limit,
)
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.scene import MAX_PARTICLES
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.planning.workload import PilotSamples
from agglom_mpi.random_streams import RANDOM_STRING, search_stream
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.messages import RankMessage, merged
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import new_tasks, number_in_volume
from agglom_mpi.storage.table import concatenated

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


VOLUMES: Final = (1, 2, 4)
"""Control volumes of the pilot samples, relative to the campaign's box."""
FEWER: Final = (1, 2)
"""Those where the time, or the most grains, does not suffice for the largest."""
SHARE: Final = 0.25
"""Time of these samples relative to that of all other pilot samples."""
ROUND: Final = 10
"""Number of samples of each volume that are simulated in turn."""
MAX_ROUNDS: Final = 40
"""Maximum number of such rounds."""
DEFAULT_SAMPLES: Final = 100
"""Number of samples that the error of the answer is forecast for where nothing is estimated
again."""


class GrainAdvice(NamedTuple):
    """How the number of grains shifts the answer, by pilot samples."""

    grains: int
    """Number of grains of the campaign."""
    samples: int
    """Pilot samples in each volume."""
    fit: Extrapolation
    """Extrapolation of the mean of b/b⁰."""
    error: float
    """Standard error that the final estimate will have, by the spread of one sample."""
    answer_samples: int
    """Number of samples that the final estimate will have."""
    why_no_limit: str = ""
    """Why the pilot samples show no shift; empty if they do."""
    volumes: tuple[int, ...] = VOLUMES
    """Control volumes of the pilot samples."""

    @property
    def exceeds(self) -> bool:
        """Whether the shift is resolved and above the standard error of the answer."""
        return self.fit.shift.is_resolved and abs(self.fit.shift.value) > self.error

    @property
    def enough(self) -> int:
        """Number of grains whose shift is at most the standard error; else the campaign's own."""
        return enough_grains(self.grains, self.fit, self.error) if self.exceeds else self.grains

    @property
    def text(self) -> str:
        """Two lines for readers."""
        volumes = ", ".join(f"{volume * self.grains:,}" for volume in self.volumes)
        if self.volumes != VOLUMES:
            volumes += f" ({VOLUMES[-1] * self.grains:,} are too many for this time)"
        head = f"finite size, by {self.samples} samples each of one string with {volumes} grains: "
        if self.why_no_limit:
            return f"{head}no shift is known\n  {self.why_no_limit}"
        return (
            f"{head}mean b/b0 is shifted by {self.fit.shift.text}, the final estimate will have "
            f"the standard error {self.error:.2g}\n  {self._advice}"
        )

    @property
    def _advice(self) -> str:
        if not self.fit.shift.is_resolved:
            return f"no shift is resolved: {self.grains:,} grains are kept"
        if not self.exceeds:
            return f"the shift is within that error: {self.grains:,} grains are enough"
        # Of enough grains, whose mean has the same error: variances fall as 1/N.
        samples = max(2, math.ceil(self.answer_samples * self.grains / self.enough))
        return (
            f"take {self.enough:,} grains ({pluralise(samples, 'sample')} then have "
            f"the error of {self.answer_samples}), or final: {{volumes: {list(VOLUMES)}}}"
        )

    def as_dict(self) -> dict[str, float | int | bool | str]:
        """Return plain values for JSON."""
        return {
            "grains": self.grains,
            "samples": self.samples,
            "shift": self.fit.shift.value,
            "shift_standard_error": self.fit.shift.error,
            "limit": self.fit.limit.value,
            "limit_standard_error": self.fit.limit.error,
            "answer_standard_error": self.error,
            "exceeds": self.exceeds,
            "enough_grains": self.enough,
            "why_no_limit": self.why_no_limit,
            "largest_grains": self.volumes[-1] * self.grains,
        }


def advise_grains(
    campaign: Campaign, pilot: PilotSamples, seconds: float, show: Callable[[str], None]
) -> GrainAdvice | None:
    """Simulate the best pilot string in several volumes, and return how many grains are enough.

    Parameters
    ----------
    campaign
        The campaign.
    pilot
        Samples of random strings; the best of these is simulated.
    seconds
        Time limit of all other pilot samples, s.
    show
        Called with a line on the progress.

    Returns
    -------
    GrainAdvice or None
        None where the time allows for too few samples, or grains are too many, even without the
        largest volume.
    """
    for volumes in (VOLUMES, FEWER):
        if campaign.scene.particles * volumes[-1] <= MAX_PARTICLES:
            show("simulating one string in larger volumes")
            found = _by_volumes(campaign, pilot, seconds, volumes)
            if found is not None:
                return found
    return None


def _by_volumes(
    campaign: Campaign, pilot: PilotSamples, seconds: float, volumes: tuple[int, ...]
) -> GrainAdvice | None:
    """Return the advice by samples in some volumes; arguments as of `advise_grains`."""
    runner = SampleRunner(InversionExperiment(campaign), 0)
    string = _best(pilot)
    limit, begun = SHARE * seconds, time.monotonic()

    def tasks() -> Iterator[np.void]:
        for done in range(MAX_ROUNDS):
            spent = time.monotonic() - begun
            if done and spent * (done + 1) / done > limit:
                return
            for volume in volumes:
                number = number_in_volume(0, volume)
                yield task_of(number, done * ROUND, ROUND, pilot.parameters[string])

    parts = [message.results for message in simulate_for(limit, runner, tasks())]
    rounds = (len(parts) - runner.abort_flag.stopped) // len(volumes)  # the last one may be cut
    if not rounds:
        return None
    known: list[VolumeMeans] = []
    for place, volume in enumerate(volumes):
        rows = concatenated(parts[place :: len(volumes)][:rounds], parts[0].dtype)
        means = means_of_rows(rows, volume, volume * campaign.scene.particles)
        if means is None:
            return None
        known.append(means)
    # A line detects a shift with a seventh of the samples that a parabola takes.
    fit = growth_of_many(known, order=1)
    answer = DEFAULT_SAMPLES if campaign.final is None else campaign.final.samples
    error = known[0].spread / math.sqrt(answer)
    why = why_no_limit(known, fit)
    samples = rounds * ROUND
    return GrainAdvice(campaign.scene.particles, samples, fit, error, answer, why, volumes)


def _best(pilot: PilotSamples) -> int:
    """Return the pilot string with the lowest objective, the first where none has any."""
    done = pilot.rows[pilot.rows["state"] == COMPLETED]
    if not len(done):
        return 0
    strings = np.unique(done["string"])
    values = [float(done["objective"][done["string"] == string].mean()) for string in strings]
    return int(strings[int(np.nanargmin(values))]) if np.isfinite(values).any() else int(strings[0])
