"""An accuracy study as an experiment: every trial is a string, all in one generation."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.trials import Quota, Trial
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.runtime.experiment import Experiment, Restore, SampleSetup, Stage, TableSizes
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import RANDOM, EvaluatedStrings, Proposals, as_proposals
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import STUDY

FEWEST: Final = 4
"""Samples of a trial, however long they take."""


class Listed(EvaluatedStrings):
    """A search that proposes given strings at once and learns nothing."""

    parents = 1

    def __init__(self, parameters: NDArray[np.float64]) -> None:
        super().__init__(len(parameters))
        self._given = parameters

    def ask(self) -> Proposals:
        """Propose all strings."""
        return as_proposals(0, self._given, RANDOM)

    def known_proposals(self, generation: int) -> None:
        """There is one generation only."""


class Study(Experiment):
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
    def table_sizes(self) -> TableSizes:
        """Room for one generation of all trials."""
        count = len(self._listed)
        return TableSizes(count, max(trial.samples for trial in self._listed), 1, count)

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

    def setup(self, string: int) -> SampleSetup:
        """How the samples of a trial are simulated."""
        trial = self._listed[string]
        return SampleSetup(trial.campaign, trial.engine, trial.first_sample)

    def kernel_cases(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """All trials; those of one kind cost nothing after the first."""
        for string, trial in enumerate(self._listed):
            yield self.setup(string), trial.parameters

    def inversion(self, restore: Restore | None, background: bool = False) -> Inversion:
        """Set up the trials as strings of one generation."""
        quotas = (Quota(trial, min(FEWEST, trial.samples), self._budget) for trial in self._listed)
        parameters = np.array([trial.parameters for trial in self._listed])
        return Inversion(Listed(parameters), quotas.__next__, 1, restore=restore)

    def stage(self, inversion: Inversion) -> Stage:
        """Count the set-ups, which are all measured at the same time."""
        return Stage(len(inversion.results), self.table_sizes.strings, "set-ups")

    def end_reason(self, inversion: Inversion) -> str:
        """Nothing ends a study but its end."""
        return "all set-ups are measured"

    def collect(self, file: CampaignData) -> dict[str, NDArray[np.void]]:
        """Return the samples of each trial, completed and failed, in order."""
        used = {int(row["string"]): int(row["samples_used"]) for row in file.result_rows()}
        return {
            name: file.sample_rows(string)[: used.get(string, 0)]
            for string, name in enumerate(self.trials)
        }


def _digest(entries: Mapping[str, object]) -> str:
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()
