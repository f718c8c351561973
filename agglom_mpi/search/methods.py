"""The search that a campaign asks for."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.genetic import GeneticSearch
from agglom_mpi.search.proposals import Search
from agglom_mpi.search.sampled import NO_STRINGS, RandomSearch, SobolSearch
from agglom_mpi.search.space import SearchSpace

if TYPE_CHECKING:
    from agglom_mpi.campaign.search import Search as SearchModel


def make_search(
    model: "SearchModel",
    space: SearchSpace,
    seed: int,
    given: NDArray[np.float64] = NO_STRINGS,
    magnitude: bool = False,
    background: bool = False,
) -> Search:
    """Return the search that a campaign's `search` asks for, with nothing told yet.

    Parameters
    ----------
    model
        The campaign's `search`.
    space
        The box to search.
    seed
        Seed of the campaign.
    given
        Strings to begin with, shape (n, 10).
    magnitude
        Whether the objective is the magnitude of a signed mean, which a model then is of.
    background
        Whether what takes time may be thought of in a thread.
    """
    if model.method == "genetic":
        rescale = None if model.rescale is None else (model.rescale.every, model.rescale.factor)
        return GeneticSearch(
            space,
            seed,
            model.population,
            model.parents,
            model.blend,
            rescale,
            given,
            again=model.more_samples is not None,
        )
    if model.method == "surrogate":
        from agglom_mpi.search.surrogate import SurrogateSearch

        return SurrogateSearch(
            space, seed, model.initial, model.batch, given, magnitude, background
        )
    if model.method == "cmaes":
        from agglom_mpi.search.evolution import EvolutionSearch

        return EvolutionSearch(space, seed, model.population, model.sigma, given)
    if model.method == "random":
        return RandomSearch(space, seed, model.population, given)
    if model.method == "sobol":
        return SobolSearch(space, seed, model.population, given)
    raise ValueError(f"unknown search {model.method!r}")
