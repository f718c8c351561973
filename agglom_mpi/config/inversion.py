"""Building the inversion of a campaign: search method, ensembles and stopping."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.coordinates import coordinates_of
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.search.ensemble import Ensemble, EnsembleResult
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.methods.method import RunningSearch, SearchInputs
from agglom_mpi.search.proposals import Decision, Evaluations, Proposals, StringsProposed


class OwnInversion(Inversion):
    """An inversion that components of one's own decide in, which let out exceptions alone.

    Parameters
    ----------
    names
        Names of the components.
    arguments, named
        As for `Inversion`.
    """

    def __init__(self, names: Sequence[str], *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._names = ", ".join(names)

    def start(self) -> Iterator[Decision]:
        """Propose the first generation."""
        with users_code(self._names):
            return iter(list(super().start()))

    def propose_ahead(self, generations: int) -> StringsProposed | None:
        """Propose strings of a coming generation."""
        with users_code(self._names):
            return super().propose_ahead(generations)

    def complete_all(
        self, samples: NDArray[np.void], parts: Iterable[tuple[int, int, int, int]]
    ) -> Iterator[Decision]:
        """Take samples of several strings at once."""
        with users_code(self._names):
            return iter(list(super().complete_all(samples, parts)))

    def ranked(self) -> list[int]:
        """Return the strings that the search ranks, the best first."""
        with users_code(self._names):
            return super().ranked()


Restore = Callable[[Proposals, int], Proposals]
"""Function of proposals and the number of their first string that returns stored ones."""


def own_sections(campaign: Campaign) -> list[str]:
    """Return the names of the components of one's own that a search is decided by."""
    sections = (campaign.search, campaign.objective, campaign.ensemble)
    return [section.name for section in sections if section.own is not None]


def search_of(
    campaign: Campaign,
    given: NDArray[np.float64],
    background: bool = False,
    learned: Evaluations | None = None,
) -> RunningSearch:
    """Return the search of a campaign before its first generation; arguments of `inversion_of`."""
    coordinates = coordinates_of(campaign)
    inputs = SearchInputs(
        campaign.space(),
        campaign.seed,
        given,
        magnitude=campaign.objective.is_magnitude,
        background=background,
        coordinates=coordinates.of_strings,
        groups=len(coordinates.groups),
        learned=learned,
    )
    with users_code(campaign.search.name) if own_sections(campaign) else nullcontext():
        return campaign.search.build(inputs)


def inversion_of(
    campaign: Campaign,
    given: NDArray[np.float64],
    restore: Restore | None,
    background: bool = False,
    learned: Evaluations | None = None,
) -> Inversion:
    """Return the inversion of a campaign before its first generation.

    Parameters
    ----------
    campaign
        The campaign.
    given
        Strings to start with, in SI units, shape (n, k).
    restore
        Replaces proposals by those an earlier leg has stored; None keeps them.
    background
        Whether long computations of the search may run in a thread.
    learned
        Results of strings of another campaign, by the objective of this one; None: there are none.
    """
    ensemble = campaign.ensemble
    particles = campaign.scene.particles
    objective = campaign.objective

    def signed(result: EnsembleResult) -> float:
        """Return the signed mean whose magnitude is a string's objective."""
        return objective.signed(result.objective, result.mean_radius_ratio)

    own = own_sections(campaign)
    kind = partial(OwnInversion, own) if own else Inversion
    return kind(
        search_of(campaign, given, background, learned),
        lambda string: Ensemble(ensemble, campaign.objective_at(string), particles),
        campaign.stopping.ending,
        restore=restore,
        signed=signed,
        racing=ensemble.racing,
        more_samples=campaign.search.added_samples or 1,
        summarise=objective.summaries,
    )
