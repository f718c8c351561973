"""What a run simulates: strings with samples, and a rule that says when each has enough."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.ranking import ranks_itself
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.inversion import Restore, inversion_of
from agglom_mpi.config.scene import Engine
from agglom_mpi.search.inversion import TARGET_REACHED, Inversion, Observer
from agglom_mpi.storage.schema import INVERSION


class SampleSetup(NamedTuple):
    """How the samples of a string are simulated.

    `engine` replaces the campaign's own; the string's sample 0 is the campaign's `first_sample`.
    """

    campaign: Campaign
    engine: Engine | None = None
    first_sample: int = 0


class TableSizes(NamedTuple):
    """Sizes of the tables of a campaign file.

    `fresh` samples of a string come after its `max_samples`; `frames` is a number of pictures in
    all.
    """

    strings: int
    max_samples: int
    generations: int
    population: int
    fresh: int = 0
    grains: int = 0
    final_particles: bool = False
    frames: int = 0


class FramePlan(NamedTuple):
    """Samples to take pictures of, as (string, sample), and how many frames of each."""

    samples: tuple[tuple[int, int], ...] = ()
    frames: int = 0


class ReestimationPlan(NamedTuple):
    """Strings to estimate again, the best first, on so many fresh samples each."""

    strings: tuple[int, ...] = ()
    samples: int = 0


class Stage(NamedTuple):
    """How far a phase of a run is.

    Attributes
    ----------
    done, total, unit
        `12` of `100` `generations`, say.
    in_turns
        Whether one is done after the other, and each is about as much work.
    may_end_sooner
        Whether it may end before all are done.
    """

    done: int
    total: int
    unit: str
    in_turns: bool = False
    may_end_sooner: bool = False


class Experiment(ABC):
    """Everything that a run needs to know of what it runs; it travels to all ranks.

    Attributes
    ----------
    campaign
        Gives the file its title, text, seed and search box.
    max_failures
        Samples that may raise or take too long before the run is given up.
    max_seconds
        Time that a sample may take, None for ever.
    top
        Strings in the mean of the best.
    purpose
        What the strings are for, in words.
    """

    campaign: Campaign
    max_failures: int
    max_seconds: float | None = None
    top: int
    purpose: str

    @property
    @abstractmethod
    def room(self) -> TableSizes:
        """Room that the campaign file must have."""

    @abstractmethod
    def identity(self) -> dict[str, object]:
        """Everything that decides results, flat; a resume compares it."""

    @abstractmethod
    def sha256(self) -> str:
        """Digest of `identity`."""

    @abstractmethod
    def setup(self, string: int) -> SampleSetup:
        """How the samples of a string are simulated."""

    @abstractmethod
    def kinds(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """Set-ups and parameter strings that between them need every kernel of the work."""

    @abstractmethod
    def inversion(
        self, restore: Restore, observer: Observer, background: bool = False
    ) -> Inversion:
        """Set up the decisions, at their very beginning; they may think in the background."""

    @abstractmethod
    def stage(self, inversion: Inversion) -> Stage:
        """How far the decisions are."""

    @abstractmethod
    def finished_because(self, inversion: Inversion) -> str:
        """Why there is nothing left to do, in words."""

    def finalists(self, inversion: Inversion) -> ReestimationPlan:
        """Choose what to estimate again when all is decided."""
        return ReestimationPlan()

    def pictures(self, inversion: Inversion) -> FramePlan:
        """Choose what to take pictures of when all is decided."""
        return FramePlan()

    @property
    def largest(self) -> str:
        """How much there is to do at most, in words."""
        return f"at most {self.room.strings} strings"


class InversionExperiment(Experiment):
    """The inversion that a campaign file describes.

    Parameters
    ----------
    campaign
        The campaign.
    given
        Strings to begin with, shape (n, 10), where they are the best of an earlier campaign.
    """

    purpose = INVERSION

    def __init__(self, campaign: Campaign, given: NDArray[np.float64] | None = None) -> None:
        target = campaign.stopping.target
        self.campaign = campaign
        self.given = campaign.given_strings() if given is None else given
        self.max_failures = campaign.stopping.max_failures
        self.max_seconds = campaign.stopping.max_seconds
        self.top = target.top if target else campaign.search.kept

    @property
    def room(self) -> TableSizes:
        """Room for all generations that the campaign allows."""
        campaign, output, frames = self.campaign, self.campaign.output, self.campaign.output.frames
        strings, samples = campaign.max_framed
        return TableSizes(
            campaign.max_strings,
            campaign.ensemble.max_samples,
            campaign.stopping.generations,
            campaign.search.population,
            campaign.final.samples if campaign.final else 0,
            campaign.scene.particles if output.final_particles or frames else 0,
            output.final_particles,
            strings * samples * frames.count if frames else 0,
        )

    def identity(self) -> dict[str, object]:
        """Return the campaign's own."""
        return self.campaign.identity()

    def sha256(self) -> str:
        """Return the campaign's own."""
        return self.campaign.sha256()

    def setup(self, string: int) -> SampleSetup:
        """Return the campaign's scene, the same for every string."""
        return SampleSetup(self.campaign, first_sample=self.campaign.first_sample(string))

    def kinds(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """One scene is all there is."""
        yield SampleSetup(self.campaign), self.campaign.parameters()

    def inversion(
        self, restore: Restore, observer: Observer, background: bool = False
    ) -> Inversion:
        """Set up the search with its ensembles."""
        return inversion_of(self.campaign, self.given, restore, observer, background)

    def stage(self, inversion: Inversion) -> Stage:
        """Count the generations."""
        stopping = self.campaign.stopping
        sooner = stopping.target is not None
        return Stage(inversion.generation, stopping.generations, "generations", True, sooner)

    def finalists(self, inversion: Inversion) -> ReestimationPlan:
        """Choose the best strings; of those with the same parameters, hence samples, the first."""
        final = self.campaign.final
        if final is None:
            return ReestimationPlan()
        best: dict[bytes, int] = {}
        for string in self._best(inversion):
            if len(best) == final.strings:
                break
            best.setdefault(inversion.parameters(string).tobytes(), string)
        return ReestimationPlan(tuple(best.values()), final.samples)

    def pictures(self, inversion: Inversion) -> FramePlan:
        """Choose the first samples of the best strings."""
        frames = self.campaign.output.frames
        if frames is None:
            return FramePlan()
        strings, samples = self.campaign.max_framed
        best = self._best(inversion)[:strings]
        return FramePlan(
            tuple((i, sample) for i in best for sample in range(samples)), frames.count
        )

    def finished_because(self, inversion: Inversion) -> str:
        """Say whether the target was reached."""
        stopping = self.campaign.stopping
        if inversion.stop_reason == TARGET_REACHED and stopping.target is not None:
            top, objective = stopping.target.top, stopping.target.objective
            return f"the mean objective of the best {top} is at most {objective:g}"
        return f"all {stopping.generations} generations are done"

    def _best(self, inversion: Inversion) -> list[int]:
        """Judged strings with a finite objective, the best first as the search has them."""
        results = inversion.results.items()
        finite = sorted((r.objective, i) for i, r in results if np.isfinite(r.objective))
        order = [string for _, string in finite]
        if not ranks_itself(self.campaign.identity()):
            return order
        judged = set(order)
        return [string for string in inversion.ranked() if string in judged]
