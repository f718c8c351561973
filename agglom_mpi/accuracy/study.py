"""An accuracy study: set-ups, each a parameter string run in one way, in one generation.

`Study` is what all programs of `agglom accuracy` simulate, and `run_stages` runs one after another.
"""

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.report import ReportSection
from agglom_mpi.config.bounds import required_variables
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.identity import STUDY_SEPARATORS, digest
from agglom_mpi.config.identity import objective as objective_identity
from agglom_mpi.config.relations import NO_RELATIONS
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, parse
from agglom_mpi.display.run_display import StudyDisplay
from agglom_mpi.errors import FINISHED
from agglom_mpi.outcome import COMPLETED, SampleSummary
from agglom_mpi.runtime.experiment import GivenStrings, SampleSetup
from agglom_mpi.runtime.file_setup import check_writable
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.run import run_on_all_ranks
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.search.stopping import EnsembleState, StoppingRule
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.statistics import MeanEstimate, mean_of
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.schema import STUDY
from agglom_mpi.variables import TEN

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

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

    def sha256(self) -> str:
        """Return the digest of `identity`."""
        return digest(dict(self.identity()), STUDY_SEPARATORS)


class StudyPart(NamedTuple):
    """A part of a study: what it simulates, by name, and its section of the report."""

    setups: Mapping[str, Setup]
    section: Callable[[Mapping[str, Rows]], ReportSection]
    """Makes the section of the samples of all set-ups."""


def closed(campaign: Campaign, string: NDArray[np.float64]) -> tuple[Campaign, NDArray[np.float64]]:
    """Return a campaign whose scene has the numbers that a string, (k,), gives, and the other ten.

    A study compares set-ups of several campaigns in one file, whose strings are of the variables
    that all campaigns have.
    """
    campaign = without_data(campaign)
    if not campaign.variables.of_scene:
        return campaign, string
    alone = with_values(campaign, *campaign.at(string))
    return alone, alone.variables.lower


def with_values(campaign: Campaign, section: SceneSection, values: Mapping[str, float]) -> Campaign:
    """Return a campaign of one string of the ten variables, by name, in another scene.

    What the scene does not use is left out.
    """
    fixed = {
        name: TEN[name]._replace(lower=values[name], upper=values[name])
        for name in required_variables(section)
    }
    box = TEN.with_ranges(fixed, third_moment=section.third_moment)
    return replace(campaign, scene=section, variables=box, relations=NO_RELATIONS)


def without_data(campaign: Campaign) -> Campaign:
    """Return a campaign of measured data as one of growth, which single samples have; others as is.

    A study is one of a scene, to which what was measured does not belong.
    """
    if not campaign.objective.needs_data:
        return campaign
    return replace(campaign, objective=MaximumGrowth(), data=(), data_entries=())


def require_steps(campaign: Campaign) -> None:
    """Raise an error of a campaign of several scenes, or of one that no time steps can simulate."""
    campaign.require_one_scene("SOURCE")
    if campaign.scene.escape.is_sheared():
        message = (
            "is 'shear', which no time steps can simulate: there is nothing to compare; "
            "final: {volumes: [1, 2, 4]} measures the effect of the size of the box"
        )
        problem = parse(campaign.text, campaign.name).problem(("scene", "escape"), message)
        raise CampaignError(problem)


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
    does not depend on the machine, but not before `FEWEST_SAMPLES`; and, as every ensemble, when
    most of the samples fail.
    """

    def __init__(self, setup: Setup, budget: float) -> None:
        rule = _EverySample(max_samples=setup.samples)
        super().__init__(rule, setup.campaign.objective, setup.campaign.scene.particles)
        self._min_used = min(FEWEST_SAMPLES, setup.samples)
        self._budget_left = budget

    def add(self, outcome: SampleSummary) -> None:
        """Take the next sample."""
        super().add(outcome)
        self._budget_left -= outcome.particle_steps + MOVES_PER_STEP * outcome.steps
        if self.samples_used >= self._min_used and self._budget_left <= 0.0:
            self.finished = True


class Study(GivenStrings):
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
    purpose = STUDY
    unit, end = "set-ups", "all set-ups are measured"
    separators = STUDY_SEPARATORS

    def __init__(
        self,
        campaign: Campaign,
        setups: Mapping[str, Setup],
        budget: float,
    ) -> None:
        self.campaign = without_data(campaign)
        self.setups = dict(setups)
        self._by_string = list(self.setups.values())
        self.strings = np.array([setup.parameters for setup in self._by_string])
        self.budget = budget

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
        """Return the campaign's own, and digests of the set-ups."""
        entries = self.campaign.identity() | {"budget": self.budget, "fewest": FEWEST_SAMPLES}
        for number, (name, setup) in enumerate(self.setups.items()):
            text = f"number {number}, {setup.samples} samples, {setup.sha256()}"
            entries[f"trials.{name}"] = text
        return entries

    def setup(self, string: int) -> SampleSetup:
        """Return how the samples of a string are simulated."""
        setup = self._by_string[string]
        return SampleSetup(setup.campaign, setup.engine, setup.first_sample)

    def ensemble(self, string: int) -> Ensemble:
        """Return what takes the samples of a set-up."""
        return BudgetedEnsemble(self._by_string[string], self.budget)

    def collect(self, file: CampaignData) -> dict[str, Rows]:
        """Return the samples of each set-up by its name, completed and failed, in order."""
        file.all_sample_rows()  # read once: without, each set-up opens the file
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


Stages = Generator[tuple[str, Study], CampaignData, Path]
"""Yields file and study of each stage, is sent the finished file, and returns that of the report.

It runs on rank 0 alone.
"""


class StudyOptions(NamedTuple):
    """Options of `agglom accuracy`, as `cli/accuracy.py` declares them."""

    sources: tuple[str, ...]
    out: str
    settings: Mapping[str, float | str]
    samples: int | None = None
    quick: bool = False
    history: str | None = None
    max_walltime: float | None = None
    quiet: bool = False
    accept_code_change: bool = False
    database: str | None = None
    allow_code: bool = False
    map: str | None = None
    """Planes to map, separated by commas; None: no map."""
    answer: bool = False

    def words(self) -> list[str]:
        """Return the words of the command line that asks for these options."""
        words = ["agglom", "accuracy", *self.sources, "--out", self.out]
        for name, value in self.settings.items():
            words += ["--set", f"{name}={value}"]
        if self.samples is not None:
            words += ["--samples", str(self.samples)]
        if self.history is not None:
            words += ["--history", self.history]
        flags = {"--allow-code": self.allow_code, "--quick": self.quick, "--answer": self.answer}
        words += [flag for flag, given in flags.items() if given]
        return words if self.map is None else [*words, "--map", self.map]


def run_stages(
    options: StudyOptions,
    world: "Intracomm | None",
    program: Callable[[], Stages],
    count: int = 1,
) -> int:
    """Run the stages of a program on all ranks, each with its file; return the exit code.

    A run that was stopped goes on, as each stage follows from the files of those before.

    Parameters
    ----------
    options, world
    program
        Called on rank 0 alone; may raise the user's mistakes.
    count
        Number of its stages, as every rank knows from the options; without any, nothing is run.
    """
    display, found = StudyDisplay(options.quiet), list[CampaignData]()
    stages = program()

    def advance() -> tuple[str, Study]:
        return stages.send(found[-1]) if found else next(stages)

    def read() -> RunRequest:
        name, study = advance()
        path = Path(options.out) / name
        check_writable(path)
        then = read if len(found) + 1 < count else None
        return RunRequest(study, path, options.accept_code_change, options.database, then=then)

    def finish(request: RunRequest) -> None:
        found.append(read_campaign(request.path, options.allow_code))
        if len(found) == count:
            display.message("writing the report")
            write()

    def write() -> None:
        try:
            advance()
        except StopIteration as end:
            display.message(f"{end.value} with its figures and tables")

    if count:
        return run_on_all_ranks(read, display, finish, world, max_walltime=options.max_walltime)
    if world is None or world.rank == 0:
        write()
    return FINISHED
