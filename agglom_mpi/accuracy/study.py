"""An accuracy study as work for the farm: every trial is a string, all in one generation."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.trials import Quota, Trial
from agglom_mpi.campaign import Campaign
from agglom_mpi.database.reader import CampaignFile
from agglom_mpi.database.schema import STUDY
from agglom_mpi.farm.work import Restore, Room, Setup, Work
from agglom_mpi.search import Batch, Inversion, Observer
from agglom_mpi.search.proposals import NO_PARENT, RANDOM

FEWEST: Final = 4
"""Samples of a trial, however long they take."""


class Listed:
    """A search that proposes given strings at once and learns nothing."""

    parents = 1

    def __init__(self, parameters: NDArray[np.float64]) -> None:
        self._parameters = parameters
        self.population_ids = np.zeros(0, np.int64)
        self._objectives = np.zeros(0)

    def ask(self) -> Batch:
        """Propose all strings."""
        count = len(self._parameters)
        return Batch(
            generation=0,
            slot=np.arange(count),
            origin=np.full(count, RANDOM, np.int8),
            parents=np.full((count, 2), NO_PARENT),
            parameters=self._parameters,
        )

    def random_proposals(self, generation: int) -> None:
        """There is one generation only."""

    def tell(
        self,
        ids: NDArray[np.int64],
        parameters: NDArray[np.float64],
        objectives: NDArray[np.float64],
    ) -> None:
        """Take note of the objectives."""
        self.population_ids = ids
        self._objectives = objectives

    def best(self, k: int) -> list[tuple[int, float]]:
        """Return the strings with the lowest objectives."""
        order = np.argsort(self._objectives, kind="stable")[:k]
        return [(int(self.population_ids[i]), float(self._objectives[i])) for i in order]

    def mean_of_top(self, k: int) -> float:
        """Return the mean of the lowest objectives."""
        return float(np.mean([objective for _, objective in self.best(k)]))


class Study(Work):
    """Trials by name, each with a budget of particle-steps.

    Parameters
    ----------
    campaign
        What the study is of; gives its file the title, text and search box.
    trials
        What to simulate; the order decides the numbers of the strings.
    budget
        Particle-steps after which a trial needs no more than its fewest samples.
    """

    max_failures = 100
    top = 1
    purpose = STUDY

    def __init__(self, campaign: Campaign, trials: Mapping[str, Trial], budget: float) -> None:
        self.campaign = campaign
        self.trials = dict(trials)
        self._listed = list(self.trials.values())
        self._budget = budget

    @property
    def room(self) -> Room:
        """Room for one generation of all trials."""
        count = len(self._listed)
        return Room(count, max(trial.samples for trial in self._listed), 1, count)

    @property
    def largest(self) -> str:
        """How much there is to do."""
        return f"accuracy study of {len(self._listed)} set-ups"

    def identity(self) -> dict[str, object]:
        """Return the campaign's own, and a digest of each trial."""
        entries = self.campaign.identity() | {"budget": self._budget, "fewest": FEWEST}
        for number, (name, trial) in enumerate(self.trials.items()):
            text = f"number {number}, {trial.samples} samples, {_digest(dict(trial.identity()))}"
            entries[f"trials.{name}"] = text
        return entries

    def sha256(self) -> str:
        """Digest of `identity`."""
        return _digest(self.identity())

    def setup(self, string: int) -> Setup:
        """How the samples of a trial are simulated."""
        trial = self._listed[string]
        return Setup(trial.campaign, trial.engine, trial.first_sample)

    def kinds(self) -> Iterator[tuple[Setup, NDArray[np.float64]]]:
        """All trials; those of one kind cost nothing after the first."""
        for string, trial in enumerate(self._listed):
            yield self.setup(string), trial.parameters

    def inversion(self, restore: Restore, observer: Observer) -> Inversion:
        """Set up the trials as strings of one generation."""
        quotas = (Quota(trial, min(FEWEST, trial.samples), self._budget) for trial in self._listed)
        parameters = np.array([trial.parameters for trial in self._listed])
        return Inversion(Listed(parameters), quotas.__next__, 1, None, restore, observer)

    def finished_because(self, inversion: Inversion) -> str:
        """Nothing ends a study but its end."""
        return "all set-ups are measured"

    def collect(self, file: CampaignFile) -> dict[str, NDArray[np.void]]:
        """Return the samples of each trial, completed and failed, in order."""
        used = {int(row["string"]): int(row["samples_used"]) for row in file.result_rows()}
        return {
            name: file.sample_rows(string)[: used.get(string, 0)]
            for string, name in enumerate(self.trials)
        }


def _digest(entries: Mapping[str, object]) -> str:
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()
