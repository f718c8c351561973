"""An accuracy study: set-ups, each a parameter string run in one way, in one generation."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.identity import STUDY_SEPARATORS, digest
from agglom_mpi.config.identity import objective as objective_identity
from agglom_mpi.config.relations import NO_RELATIONS
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.display.run_display import Display
from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.runtime.experiment import Experiment, Restore, SampleSetup, StageProgress
from agglom_mpi.search.ending import Generations
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.search.proposals import RANDOM, EvaluatedStrings, Proposals, as_proposals
from agglom_mpi.search.stopping import EnsembleState, StoppingRule
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.statistics import MeanEstimate, mean_of
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.schema import STUDY
from agglom_mpi.variables import TEN

if TYPE_CHECKING:
    from agglom_mpi.search.decisions import GenerationSummary

Rows = NDArray[np.void]
"""Samples with the columns of `OUTCOME` and of `/samples`, shape (n,)."""

FEWEST_SAMPLES: Final = 4
"""Samples of a set-up, however long they take."""

MOVES_PER_STEP: Final = 25
"""What a time step or an event costs, in moves of one particle by one time step."""


class Setup(NamedTuple):
    """One parameter string, simulated a number of times in one way.

    Attributes
    ----------
    campaign : Campaign
        Its scene, seed and objective; what else it says is not used. All numbers of the scene are
        in the scene; see `closed`.
    parameters : array, shape (10,), SI units
    samples : int
        Samples to simulate.
    engine : Engine or None
        Instead of the scene's own.
    first_sample : int
        Number of the first sample.
    """

    campaign: Campaign
    parameters: NDArray[np.float64]
    samples: int
    engine: Engine | None = None
    first_sample: int = 0

    def identity(self) -> Iterator[tuple[str, object]]:
        """Yield all that decides the samples of the set-up, flat."""
        scene = {f"scene.{key}": value for key, value in self.campaign.scene.entries().items()}
        yield from scene.items()
        yield "seed", self.campaign.seed
        yield "objective", objective_identity(self.campaign)
        yield "engine", self.engine.entries() if self.engine else None
        yield "samples", self.samples
        yield "first_sample", self.first_sample
        for name, value in TEN.values_by_name(self.parameters).items():
            if name in self.campaign.variables.used:
                yield f"parameters.{name}", value


def closed(campaign: Campaign, string: NDArray[np.float64]) -> tuple[Campaign, NDArray[np.float64]]:
    """Return a campaign whose scene has the numbers that a string, (k,), gives, and the other ten.

    A study compares set-ups of several campaigns in one file, whose strings are of the variables
    that all campaigns have.
    """
    campaign = without_data(campaign)
    if not campaign.variables.of_scene:
        return campaign, string
    section, values = campaign.at(string)
    rest = np.array([values[name] for name in TEN.names])
    fixed = {v.name: v._replace(lower=values[v.name], upper=values[v.name]) for v in TEN.variables}
    box = TEN.with_ranges(fixed, third_moment=section.third_moment)
    return replace(campaign, scene=section, variables=box, relations=NO_RELATIONS), rest


def without_data(campaign: Campaign) -> Campaign:
    """Return a campaign of measured data as one of growth, which single samples have; others as is.

    A study is one of a scene, to which what was measured does not belong.
    """
    if not campaign.objective.needs_data:
        return campaign
    return replace(campaign, objective=MaximumGrowth(), data=(), data_entries=())


def scene_error(setup: Setup) -> str:
    """Return why the scene of a set-up cannot be simulated; empty if it can."""
    try:
        setup.campaign.at(setup.parameters).build(setup.engine)
    except ValueError as error:
        return str(error)
    return ""


def with_scene(campaign: Campaign, **changes: object) -> Campaign:
    """Return the campaign with some entries of its scene replaced; `text` stays as it is."""
    scene: SceneSection = campaign.scene.model_copy(update=changes)
    return replace(campaign, scene=scene)


class _EverySample(StoppingRule):
    """The rule of a set-up: nothing but its number of samples, or its budget, ends it."""

    max_samples: int
    min_samples: int = 1

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        return False


class BudgetedEnsemble(Ensemble):
    """The samples of a set-up, or fewer if they are long.

    It ends early when the samples have cost `budget`, counted in particle-steps so that the end
    does not depend on the machine, but not before `min_samples` of them; and, as every ensemble,
    when most of them fail.
    """

    def __init__(self, setup: Setup, min_samples: int, budget: float) -> None:
        particles = setup.campaign.scene.particles
        objective = setup.campaign.objective
        super().__init__(_EverySample(max_samples=setup.samples), objective, particles)
        self._min_used = min_samples
        self._budget_left = budget

    def add(self, outcome: SampleSummary) -> None:
        """Take the next sample."""
        super().add(outcome)
        self._budget_left -= outcome.particle_steps + MOVES_PER_STEP * outcome.steps
        if self.samples_used >= self._min_used and self._budget_left <= 0.0:
            self.finished = True


class FixedProposals(EvaluatedStrings):
    """A search method that proposes given strings at once and learns nothing.

    Parameters
    ----------
    parameters
        Shape (strings, 10), SI units.
    """

    parents = 1

    def __init__(self, parameters: NDArray[np.float64]) -> None:
        super().__init__(len(parameters))
        self._given = parameters

    def ask(self) -> Proposals:
        """Propose all strings."""
        return as_proposals(0, self._given, RANDOM)

    def known_proposals(self, generation: int) -> None:
        """Return None: there is one generation only."""


class Study(Experiment):
    """Set-ups by name, each with a budget of particle-steps.

    Parameters
    ----------
    campaign
        What the study is of; gives its file the title, text and search box.
    setups
        What to simulate; the order decides the numbers of the strings.
    budget
        Particle-steps after which a set-up needs no more than `FEWEST_SAMPLES`.
    """

    max_failures = 100
    top = 1
    purpose = STUDY

    def __init__(self, campaign: Campaign, setups: Mapping[str, Setup], budget: float) -> None:
        self.campaign = without_data(campaign)
        self.setups = dict(setups)
        self._by_string = list(self.setups.values())
        self._budget = budget

    @property
    def table_sizes(self) -> TableSizes:
        """Sizes of the tables: one generation of all set-ups."""
        count = len(self._by_string)
        samples = max(setup.samples for setup in self._by_string)
        quantities = self.campaign.objective.quantity_units
        return TableSizes(count, samples, 1, count, quantities=quantities)

    @property
    def largest(self) -> str:
        """The extent of the study, as text."""
        return f"accuracy study of {len(self._by_string)} set-ups"

    def identity(self) -> dict[str, object]:
        """Return the campaign's own, and a digest of each set-up."""
        entries = self.campaign.identity() | {"budget": self._budget, "fewest": FEWEST_SAMPLES}
        for number, (name, setup) in enumerate(self.setups.items()):
            decides = digest(dict(setup.identity()), STUDY_SEPARATORS)
            entries[f"trials.{name}"] = f"number {number}, {setup.samples} samples, {decides}"
        return entries

    def sha256(self) -> str:
        """Return the digest of `identity`."""
        return digest(self.identity(), STUDY_SEPARATORS)

    def setup(self, string: int) -> SampleSetup:
        """Return how the samples of a string are simulated."""
        setup = self._by_string[string]
        return SampleSetup(setup.campaign, setup.engine, setup.first_sample)

    def kernel_cases(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """Yield all set-ups; those of one kind cost nothing after the first."""
        for string, setup in enumerate(self._by_string):
            yield self.setup(string), setup.parameters

    def inversion(self, restore: Restore | None, background: bool = False) -> Inversion:
        """Return an inversion of one generation whose strings are the set-ups."""
        ensembles = (
            BudgetedEnsemble(setup, min(FEWEST_SAMPLES, setup.samples), self._budget)
            for setup in self._by_string
        )
        parameters = np.array([setup.parameters for setup in self._by_string])
        return Inversion(
            FixedProposals(parameters),
            lambda string: next(ensembles),
            Generations(generations=1),
            restore=restore,
            summarise=self.campaign.objective.summaries,
        )

    def stage(self, inversion: Inversion) -> StageProgress:
        """Return how many set-ups are done; all are measured at the same time."""
        return StageProgress(len(inversion.results), self.table_sizes.strings, "set-ups")

    def end_reason(self, inversion: Inversion) -> str:
        """Return why the study is over."""
        return "all set-ups are measured"

    def collect(self, file: CampaignData) -> dict[str, Rows]:
        """Return the samples of each set-up by its name, completed and failed, in order."""
        used = file.samples_used
        return {
            name: file.sample_rows(string)[: used.get(string, 0)]
            for string, name in enumerate(self.setups)
        }


def completed(rows: Rows) -> Rows:
    """Return the rows of samples that did not fail."""
    return rows[rows["state"] == COMPLETED]


def paired_difference(rows: Rows, reference: Rows, name: str) -> MeanEstimate:
    """Return the mean of a column less that of the reference, over samples completed in both.

    Samples of one number have the same random start, so what they share cancels.
    """
    ours, theirs = completed(rows), completed(reference)
    _, first, second = np.intersect1d(ours["sample"], theirs["sample"], return_indices=True)
    return mean_of(ours[name][first] - theirs[name][second])


class StudyDisplay(Display):
    """Progress in set-ups; nothing is shown at the end of the one generation."""

    def generation(
        self, summary: "GenerationSummary", total: int, samples: int, rate: float
    ) -> None:
        """Show nothing."""
