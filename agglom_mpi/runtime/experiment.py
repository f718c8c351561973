"""The work of a run: its strings and their samples, and the sizes of its file."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.warm_start import Learned, WarmStart, evaluated
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.identity import SEPARATORS, digest
from agglom_mpi.config.inversion import Restore, inversion_of
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.scheduling.interface import volume_string
from agglom_mpi.search.ending import Generations
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import FixedProposals
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.storage.room import TableSizes, table_sizes
from agglom_mpi.storage.schema import INVERSION
from agglom_mpi.variables import VariableTable


class SampleSetup(NamedTuple):
    """How the samples of a string are simulated.

    The string's sample 0 is the campaign's sample `first_sample`.
    """

    campaign: Campaign
    engine: Engine | None = None
    """Replaces that of the campaign."""
    first_sample: int = 0


class FramePlan(NamedTuple):
    """Samples, as (string, sample), whose frames are stored, and the number of frames of each."""

    samples: tuple[tuple[int, int], ...] = ()
    frames: int = 0


class ReestimationPlan(NamedTuple):
    """Strings to estimate again, the best first, and the number of fresh samples of each.

    `volumes` are the control volumes in which each gets that many, relative to the campaign's box.
    """

    strings: tuple[int, ...] = ()
    samples: int = 0
    volumes: tuple[int, ...] = (1,)


class StageProgress(NamedTuple):
    """Progress of a phase of a run."""

    done: int
    total: int
    unit: str
    """For example `12` of `100` `generations`."""
    in_turns: bool = False
    """Whether they are done one after the other, each about as much work."""
    may_end_sooner: bool = False
    """Whether it may end before all are done."""


class Experiment(ABC):
    """The work of a run; it is broadcast to all ranks.

    Attributes
    ----------
    campaign
        Gives the file its title, text, seed and search box.
    max_failures
        Number of samples that raise or take too long at which the run ends.
    max_seconds
        Longest time of a sample in s; None without a limit.
    top
        Number of strings in the mean of the best.
    purpose
        What the strings are for, as text.
    noted_beside
        The campaign file beside which ranks note what runs code of the user's; None: nowhere.
    learned
        Samples of another campaign that the search learns from; None: there are none.
    """

    campaign: Campaign
    max_failures: int
    max_seconds: float | None = None
    top: int
    purpose: str
    noted_beside: Path | None = None
    learned: Learned | None = None

    @property
    def variables(self) -> VariableTable:
        """Variables of its strings."""
        return self.campaign.variables

    @property
    @abstractmethod
    def table_sizes(self) -> TableSizes:
        """Sizes that the campaign file must have."""

    @abstractmethod
    def identity(self) -> dict[str, object]:
        """Return everything that decides results, flat; a resume compares it."""

    @abstractmethod
    def sha256(self) -> str:
        """Return the digest of `identity`."""

    @abstractmethod
    def setup(self, string: int) -> SampleSetup:
        """Return how the samples of a string are simulated."""

    @abstractmethod
    def kernel_cases(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """Yield set-ups and strings, (k,), that together need every kernel of the experiment."""

    @abstractmethod
    def inversion(self, restore: Restore | None, background: bool = False) -> Inversion:
        """Return the decisions at their start, with long computations in a thread if asked for."""

    @abstractmethod
    def stage(self, inversion: Inversion) -> StageProgress:
        """Return how many of the decisions are made."""

    @abstractmethod
    def end_reason(self, inversion: Inversion) -> str:
        """Return the reason why there is nothing left to do, as text."""

    def continuing(self, generations: int) -> Self:
        """Return the experiment that goes on from this number of generations: it has no fewer."""
        return self

    def in_vain(self, inversion: Inversion) -> bool:
        """Return whether all is decided and nothing was found, so that the run has failed."""
        return False

    def reestimation_plan(self, inversion: Inversion) -> ReestimationPlan:
        """Return what to estimate again after the last decision."""
        return ReestimationPlan()

    def frame_plan(self, inversion: Inversion) -> FramePlan:
        """Return of what to store frames after the last decision."""
        return FramePlan()

    @property
    def largest(self) -> str:
        """The largest amount of work, as text."""
        return f"at most {pluralise(self.table_sizes.strings, 'string')}"


class GivenStrings(Experiment):
    """Given strings in one generation, all simulated at the same time.

    Attributes
    ----------
    strings
        The strings, shape (n, k).
    unit
        What they are, in the plural.
    end
        Reason for the end, as text.
    separators
        Of the text that `sha256` is the digest of.
    """

    strings: NDArray[np.float64]
    top = 1
    unit = "strings"
    end: str
    separators = SEPARATORS

    @abstractmethod
    def ensemble(self, string: int) -> Ensemble:
        """Return what takes the samples of a string."""

    def kernel_cases(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """Yield all strings; those of one kind of scene cost little after the first."""
        for string, parameters in enumerate(self.strings):
            yield self.setup(string), parameters

    def summaries(self, rows: NDArray[np.void]) -> list[SampleSummary]:
        """Return summaries of samples, rows of `/samples`."""
        return self.campaign.objective.summaries(rows)

    def sha256(self) -> str:
        """Return the digest of `identity`."""
        return digest(self.identity(), self.separators)

    def inversion(self, restore: Restore | None, background: bool = False) -> Inversion:
        """Return an inversion of one generation."""
        ensembles = map(self.ensemble, range(len(self.strings)))
        return Inversion(
            FixedProposals(self.strings),
            lambda parameters: next(ensembles),
            Generations(generations=1),
            restore=restore,
            summarise=self.summaries,
        )

    def stage(self, inversion: Inversion) -> StageProgress:
        """Return how many strings are done."""
        return StageProgress(len(inversion.results), len(self.strings), self.unit)

    def end_reason(self, inversion: Inversion) -> str:
        """Return `end`."""
        return self.end


class InversionExperiment(Experiment):
    """The inversion that a campaign file describes.

    Parameters
    ----------
    campaign
        The campaign.
    start
        What to begin with; by default the strings that the campaign gives.
    """

    purpose = INVERSION

    def __init__(self, campaign: Campaign, start: WarmStart | None = None) -> None:
        self.campaign = campaign
        self._start = WarmStart(campaign.given_strings()) if start is None else start
        self.learned = self._start.learned
        self.max_failures = campaign.stopping.max_failures
        self.max_seconds = campaign.stopping.max_seconds
        self.top = campaign.stopping.ending.best_strings or campaign.search.kept
        self._volumes = {1: campaign}

    @property
    def table_sizes(self) -> TableSizes:
        """Sizes for all generations that the campaign allows."""
        learned = 0 if self.learned is None else len(self.learned.rows)
        return table_sizes(self.campaign)._replace(learned=learned)

    def continuing(self, generations: int) -> Self:
        """Return the experiment with at least the generations that are there."""
        if generations <= self.campaign.stopping.generations:
            return self
        return type(self)(self.campaign.with_generations(generations), self._start)

    def identity(self) -> dict[str, object]:
        """Return the campaign's own."""
        return self.campaign.identity()

    def sha256(self) -> str:
        """Return the campaign's own."""
        return self.campaign.sha256()

    def setup(self, string: int) -> SampleSetup:
        """Return the campaign's scene, the same for every string of a control volume."""
        volume, own = volume_string(string)
        first = self.campaign.first_sample(own)
        return SampleSetup(self._in_volume(volume), first_sample=first)

    def kernel_cases(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """Yield the scene in each control volume, or that of each experiment."""
        for each in self.campaign.experiments:
            yield SampleSetup(each.campaign), each.campaign.parameters()
        if self.campaign.experiments:
            return
        final = self.campaign.final
        for volume in final.volumes if final else (1,):
            yield SampleSetup(self._in_volume(volume)), self.campaign.parameters()

    def inversion(self, restore: Restore | None, background: bool = False) -> Inversion:
        """Return the search with its ensembles."""
        learned = None if self.learned is None else evaluated(self.campaign, self.learned.rows)
        return inversion_of(self.campaign, self._start.strings, restore, background, learned)

    def stage(self, inversion: Inversion) -> StageProgress:
        """Count the generations."""
        stopping = self.campaign.stopping
        sooner = bool(stopping.criteria)
        return StageProgress(
            inversion.generation, stopping.generations, "generations", True, sooner
        )

    def in_vain(self, inversion: Inversion) -> bool:
        """Return whether the search is over and no string has a finite objective."""
        return inversion.finished and not self._best(inversion)

    def reestimation_plan(self, inversion: Inversion) -> ReestimationPlan:
        """Return the best strings; of those with the same parameters, hence samples, the first."""
        final = self.campaign.final
        if final is None:
            return ReestimationPlan()
        best: dict[bytes, int] = {}
        for string in self._best(inversion):
            if len(best) == final.strings:
                break
            best.setdefault(inversion.parameters(string).tobytes(), string)
        return ReestimationPlan(tuple(best.values()), final.samples, final.volumes)

    def frame_plan(self, inversion: Inversion) -> FramePlan:
        """Return the first samples of the best strings."""
        frames = self.campaign.output.frames
        if frames is None:
            return FramePlan()
        strings, samples = self.campaign.max_framed
        best = self._best(inversion)[:strings]
        return FramePlan(
            tuple((i, sample) for i in best for sample in range(samples)), frames.count
        )

    def end_reason(self, inversion: Inversion) -> str:
        """Return a sentence on the criterion that ended the search."""
        last = Generations(generations=self.campaign.stopping.generations)
        return (inversion.ended_by or last).reached

    def _in_volume(self, volume: int) -> Campaign:
        """Return the campaign in a control volume; one object of each, which keeps scenes."""
        return self._volumes.setdefault(volume, self.campaign.in_volume(volume))

    def _best(self, inversion: Inversion) -> list[int]:
        """Return evaluated strings with a finite objective, as the search ranks them."""
        results = inversion.results.items()
        finite = sorted((r.objective, i) for i, r in results if np.isfinite(r.objective))
        order = [string for _, string in finite]
        if not self.campaign.search.ranks_itself:
            return order
        usable = set(order)
        return [string for string in inversion.ranked() if string in usable]
