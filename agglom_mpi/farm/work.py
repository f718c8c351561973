"""What a farm works on: strings with samples, and a rule that says when each has enough."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.campaign import Campaign
from agglom_mpi.campaign.engines import Engine
from agglom_mpi.database.schema import INVERSION
from agglom_mpi.search import (
    Batch,
    Ensemble,
    GeneticSearch,
    Inversion,
    Observer,
    SearchSpace,
    Target,
    make_objective,
    make_rule,
)
from agglom_mpi.search.inversion import TARGET_REACHED

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
    """Sizes of the tables of a campaign file; `frames` is a number of pictures in all."""

    strings: int
    max_samples: int
    generations: int
    population: int
    grains: int = 0
    final_particles: bool = False
    frames: int = 0


class Pictures(NamedTuple):
    """Samples to take pictures of, as (string, sample), and how many frames of each."""

    samples: tuple[tuple[int, int], ...] = ()
    frames: int = 0


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
    def inversion(self, restore: Restore, observer: Observer) -> Inversion:
        """Set up the decisions, at their very beginning."""

    @abstractmethod
    def finished_because(self, inversion: Inversion) -> str:
        """Why there is nothing left to do, in words."""

    def pictures(self, inversion: Inversion) -> Pictures:
        """Choose what to take pictures of when all is decided."""
        return Pictures()

    @property
    def largest(self) -> str:
        """How much there is to do at most, in words."""
        return f"at most {self.room.strings} strings"


class CampaignWork(Work):
    """The inversion that a campaign file describes."""

    purpose = INVERSION

    def __init__(self, campaign: Campaign) -> None:
        target = campaign.stopping.target
        self.campaign = campaign
        self.max_failures = campaign.stopping.max_failures
        self.max_seconds = campaign.stopping.max_seconds
        self.top = target.top if target else campaign.search.parents

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
        return Setup(self.campaign)

    def kinds(self) -> Iterator[tuple[Setup, NDArray[np.float64]]]:
        """One scene is all there is."""
        yield Setup(self.campaign), self.campaign.parameters()

    def inversion(self, restore: Restore, observer: Observer) -> Inversion:
        """Set up the search with its ensembles."""
        campaign = self.campaign
        search, ensemble, stopping = campaign.search, campaign.ensemble, campaign.stopping
        particles = campaign.scene.particles
        objective = make_objective(campaign.objective, particles)
        rule, rescale, target = make_rule(ensemble), search.rescale, stopping.target
        return Inversion(
            GeneticSearch(
                SearchSpace(campaign.variables.lower, campaign.variables.upper),
                campaign.seed,
                population=search.population,
                parents=search.parents,
                blend=search.blend,
                rescale=None if rescale is None else (rescale.every, rescale.factor),
            ),
            lambda: Ensemble(
                rule, objective, particles, ensemble.min_samples, ensemble.max_samples
            ),
            stopping.generations,
            None if target is None else Target(target.top, target.objective),
            restore,
            observer,
        )

    def pictures(self, inversion: Inversion) -> Pictures:
        """Choose the first samples of the best strings."""
        frames = self.campaign.output.frames
        if frames is None:
            return Pictures()
        results = inversion.results.items()
        judged = [(r.objective, string) for string, r in results if np.isfinite(r.objective)]
        strings, samples = self.campaign.most_framed
        best = sorted(judged)[:strings]
        pairs = tuple((string, sample) for _, string in best for sample in range(samples))
        return Pictures(pairs, frames.count)

    def finished_because(self, inversion: Inversion) -> str:
        """Say whether the target was reached."""
        stopping = self.campaign.stopping
        if inversion.stop_reason == TARGET_REACHED and stopping.target is not None:
            top, objective = stopping.target.top, stopping.target.objective
            return f"the mean objective of the best {top} is at most {objective:g}"
        return f"all {stopping.generations} generations are done"
