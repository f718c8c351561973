"""What a farm works on: strings with samples, and a rule that says when each has enough."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.campaign import Campaign
from agglom_mpi.campaign.engines import Engine
from agglom_mpi.database.ranking import ranks_itself
from agglom_mpi.database.schema import INVERSION
from agglom_mpi.search import (
    Batch,
    Ensemble,
    EnsembleResult,
    Inversion,
    Observer,
    Target,
    make_objective,
    make_rule,
    make_search,
)
from agglom_mpi.search.inversion import TARGET_REACHED
from agglom_mpi.search.racing import Racing
from agglom_mpi.search.space import search_space

Restore = Callable[[Batch, int], Batch]
"""Replaces proposals by what an earlier leg has stored of them; see `Inversion`."""


class Setup(NamedTuple):
    """How the samples of a string are simulated.

    `engine` replaces the campaign's own; the string's sample 0 is the campaign's `first_sample`.
    """

    campaign: Campaign
    engine: Engine | None = None
    first_sample: int = 0


class Room(NamedTuple):
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


class Pictures(NamedTuple):
    """Samples to take pictures of, as (string, sample), and how many frames of each."""

    samples: tuple[tuple[int, int], ...] = ()
    frames: int = 0


class Finalists(NamedTuple):
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


class Work(ABC):
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
    def room(self) -> Room:
        """Room that the campaign file must have."""

    @abstractmethod
    def identity(self) -> dict[str, object]:
        """Everything that decides results, flat; a resume compares it."""

    @abstractmethod
    def sha256(self) -> str:
        """Digest of `identity`."""

    @abstractmethod
    def setup(self, string: int) -> Setup:
        """How the samples of a string are simulated."""

    @abstractmethod
    def kinds(self) -> Iterator[tuple[Setup, NDArray[np.float64]]]:
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

    def finalists(self, inversion: Inversion) -> Finalists:
        """Choose what to estimate again when all is decided."""
        return Finalists()

    def pictures(self, inversion: Inversion) -> Pictures:
        """Choose what to take pictures of when all is decided."""
        return Pictures()

    @property
    def largest(self) -> str:
        """How much there is to do at most, in words."""
        return f"at most {self.room.strings} strings"


class CampaignWork(Work):
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
    def room(self) -> Room:
        """Room for all generations that the campaign allows."""
        campaign, output, frames = self.campaign, self.campaign.output, self.campaign.output.frames
        strings, samples = campaign.most_framed
        return Room(
            campaign.most_strings,
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

    def setup(self, string: int) -> Setup:
        """Return the campaign's scene, the same for every string."""
        return Setup(self.campaign, first_sample=self.campaign.first_sample(string))

    def kinds(self) -> Iterator[tuple[Setup, NDArray[np.float64]]]:
        """One scene is all there is."""
        yield Setup(self.campaign), self.campaign.parameters()

    def inversion(
        self, restore: Restore, observer: Observer, background: bool = False
    ) -> Inversion:
        """Set up the search with its ensembles."""
        campaign = self.campaign
        ensemble, stopping = campaign.ensemble, campaign.stopping
        particles = campaign.scene.particles
        objective = make_objective(campaign.objective, particles)
        rule, target = make_rule(ensemble), stopping.target
        space, race = search_space(campaign.variables), ensemble.racing
        racing = None
        if race is not None:
            racing = Racing(campaign.search.kept, race.confidence, race.first)
        return Inversion(
            make_search(
                campaign.search,
                space,
                campaign.seed,
                self.given,
                magnitude=campaign.objective.law == "growth_target",
                background=background,
            ),
            lambda: Ensemble(
                rule, objective, particles, ensemble.min_samples, ensemble.max_samples
            ),
            stopping.generations,
            None if target is None else Target(target.top, target.objective),
            restore,
            observer,
            self._signed,
            racing,
            campaign.more_samples or 1,
        )

    def stage(self, inversion: Inversion) -> Stage:
        """Count the generations."""
        stopping = self.campaign.stopping
        sooner = stopping.target is not None
        return Stage(inversion.generation, stopping.generations, "generations", True, sooner)

    def _signed(self, result: EnsembleResult) -> float:
        """Signed mean whose magnitude is the objective of a string."""
        objective = self.campaign.objective
        if objective.law == "growth_target":
            return result.mean_radius_ratio / objective.ratio - 1.0
        return result.objective

    def finalists(self, inversion: Inversion) -> Finalists:
        """Choose the best strings; of those with the same parameters, hence samples, the first."""
        final = self.campaign.final
        if final is None:
            return Finalists()
        best: dict[bytes, int] = {}
        for string in self._best(inversion):
            if len(best) == final.strings:
                break
            best.setdefault(inversion.parameters(string).tobytes(), string)
        return Finalists(tuple(best.values()), final.samples)

    def pictures(self, inversion: Inversion) -> Pictures:
        """Choose the first samples of the best strings."""
        frames = self.campaign.output.frames
        if frames is None:
            return Pictures()
        strings, samples = self.campaign.most_framed
        best = self._best(inversion)[:strings]
        return Pictures(tuple((i, sample) for i in best for sample in range(samples)), frames.count)

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
