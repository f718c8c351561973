"""Search methods that learn nothing, as baselines: random points and Sobol's sequence."""

import warnings
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.random_streams import RANDOM_STRING, SOBOL_SCRAMBLE, search_stream
from agglom_mpi.search.proposals import EvaluatedStrings, Proposals, begun_with
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import COUNT

SOBOL_BITS: Final = 30
"""Binary digits of a point, for up to 10⁹ points."""

NO_STRINGS: Final = np.empty((0, COUNT))


class BaselineSearch(EvaluatedStrings):
    """Strings that depend on nothing but the seed.

    Parameters
    ----------
    space
        The box to search.
    seed
        Seed of the campaign.
    population
        Strings of each generation.
    given
        Strings that the first generation begins with, shape (n, 10), n at most `population`.
    """

    parents = 1

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        population: int,
        given: NDArray[np.float64] = NO_STRINGS,
    ) -> None:
        super().__init__(population)
        self.space = space
        self.seed = seed
        self.population = population
        self.given = given

    def ask(self) -> Proposals:
        """Return the strings of the next generation."""
        return self._proposals(self.generation)

    def known_proposals(self, generation: int) -> tuple[int, Proposals]:
        """Return any generation, which depends on no result, and the number of its first string."""
        return generation * self.population, self._proposals(generation)

    def _proposals(self, generation: int) -> Proposals:
        first = len(self.given) if generation == 0 else 0
        return begun_with(self.given[:first], self._strings(generation, first), generation)

    def _strings(self, generation: int, first: int) -> NDArray[np.float64]:
        """Return the strings of a generation in the slots from `first` on, shape (n, 10)."""
        raise NotImplementedError


class RandomSearch(BaselineSearch):
    """Independent points, uniform in the box."""

    def _strings(self, generation: int, first: int) -> NDArray[np.float64]:
        slots = range(first, self.population)
        draws = [search_stream(self.seed, RANDOM_STRING, generation, slot) for slot in slots]
        return np.array([self.space.sample(rng) for rng in draws]).reshape(-1, COUNT)


class SobolSearch(BaselineSearch):
    """A scrambled Sobol sequence (Sobol 1967, Owen 1998), which fills the box evenly."""

    def _strings(self, generation: int, first: int) -> NDArray[np.float64]:
        before = generation * self.population + first
        return sobol_strings(self.space, self.seed, before, self.population - first)


def sobol_strings(space: SearchSpace, seed: int, first: int, count: int) -> NDArray[np.float64]:
    """Return strings `first` to `first + count - 1` of a seed's Sobol sequence, (count, 10)."""
    from scipy.stats import qmc  # takes half a second to load

    scramble = search_stream(seed, SOBOL_SCRAMBLE)
    sequence = qmc.Sobol(space.dimensions, bits=SOBOL_BITS, seed=scramble)
    if first:
        sequence.fast_forward(first)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # evenness is best with powers of two
        return space.from_unit(sequence.random(count))
