"""Searches before their first generation, by the numbers of their methods."""

from agglom_mpi.search.methods.baselines import RandomPoints, SobolPoints
from agglom_mpi.search.methods.cmaes_search import Cmaes
from agglom_mpi.search.methods.genetic import Genetic
from agglom_mpi.search.methods.method import SearchInputs
from agglom_mpi.search.methods.surrogate import Surrogate


def given_or_none(space, given):
    """Return given strings, or an array of none."""
    return space.no_strings if given is None else given


def genetic_search(
    space,
    seed,
    population=20,
    parents=6,
    blend=(0.0, 1.0),
    rescale=None,
    given=None,
    again=False,
):
    """Return a genetic search; `rescale` is (every, factor), `again` samples its parents again."""
    shrinks = None if rescale is None else {"every": rescale[0], "factor": rescale[1]}
    method = Genetic(
        population=population,
        parents=parents,
        blend=blend,
        rescale=shrinks,
        more_samples=1 if again else None,
    )
    return method.build(SearchInputs(space, seed, given_or_none(space, given)))


def surrogate_search(space, seed, initial, batch, given=None, **inputs):
    """Return a search by a Gaussian process, built from further `SearchInputs`."""
    method = Surrogate(initial=initial, batch=batch)
    return method.build(SearchInputs(space, seed, given_or_none(space, given), **inputs))


def cmaes_search(space, seed, population, sigma, given=None):
    """Return a search by CMA-ES."""
    return Cmaes(population=population, sigma=sigma).build(
        SearchInputs(space, seed, given_or_none(space, given))
    )


def random_search(space, seed, population, given=None):
    """Return a search of random points."""
    return RandomPoints(population=population).build(
        SearchInputs(space, seed, given_or_none(space, given))
    )


def sobol_search(space, seed, population, given=None):
    """Return a search of Sobol points."""
    return SobolPoints(population=population).build(
        SearchInputs(space, seed, given_or_none(space, given))
    )
