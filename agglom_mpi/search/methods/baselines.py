"""Search methods that learn nothing, as baselines: random points and Sobol's sequence."""

import warnings
from typing import TYPE_CHECKING, ClassVar, Final, Literal

import numpy as np

from agglom_mpi.declaration.needed import needed
from agglom_mpi.random_streams import RANDOM_STRING, SOBOL_SCRAMBLE, search_stream
from agglom_mpi.search.methods.method import PopulationMethod, SearchInputs
from agglom_mpi.search.proposals import EvaluatedStrings, Proposals, begun_with
from agglom_mpi.search.space import BLOCK, SearchSpace
from agglom_mpi.statistics import Floats

if TYPE_CHECKING:
    from scipy.stats import qmc

SOBOL_BITS: Final = 30
"""Binary digits of a point, for up to 10⁹ points."""


class Baseline(PopulationMethod):
    """Base class of methods whose proposals depend on no result."""

    favours_low_objectives: ClassVar[bool] = False

    @property
    def summary(self) -> str:
        """One line on the method."""
        return f"{self.points}, {self.population} in a generation; nothing is learnt"

    @property
    @needed
    def points(self) -> str:
        """The points, in words."""
        raise NotImplementedError


class RandomPoints(Baseline):
    """Independent points, uniform in what is allowed of the box."""

    points: ClassVar[str] = "independent random points"
    method: Literal["random"] = "random"

    def build(self, inputs: SearchInputs) -> "RandomSearch":
        """Return the search before its first generation."""
        return RandomSearch(self, inputs)


class SobolPoints(Baseline):
    """A scrambled Sobol sequence (Sobol 1967, Owen 1998), which fills the box evenly."""

    points: ClassVar[str] = "a Sobol sequence"
    method: Literal["sobol"] = "sobol"

    def build(self, inputs: SearchInputs) -> "SobolSearch":
        """Return the search before its first generation."""
        return SobolSearch(self, inputs)


class BaselineSearch(EvaluatedStrings):
    """Strings that depend on nothing but the seed.

    Parameters
    ----------
    method
        Its numbers.
    inputs
        Box, seed and given strings.
    """

    parents = 1

    def __init__(self, method: Baseline, inputs: SearchInputs) -> None:
        super().__init__(method.population)
        self.space = inputs.space
        self.seed = inputs.seed
        self.population = method.population
        self.given = inputs.given

    def ask(self) -> Proposals:
        """Return the strings of the next generation."""
        return self._proposals(self.generation)

    def known_proposals(self, generation: int) -> tuple[int, Proposals]:
        """Return any generation, which depends on no result, and the number of its first string."""
        return generation * self.population, self._proposals(generation)

    def _proposals(self, generation: int) -> Proposals:
        first = len(self.given) if generation == 0 else 0
        return begun_with(self.given[:first], self._strings(generation, first), generation)

    def _strings(self, generation: int, first: int) -> Floats:
        """Return the strings of a generation in the slots from `first` on, shape (n, k)."""
        raise NotImplementedError


class RandomSearch(BaselineSearch):
    """Search by the method `RandomPoints`."""

    def _strings(self, generation: int, first: int) -> Floats:
        slots = range(first, self.population)
        draws = [search_stream(self.seed, RANDOM_STRING, generation, slot) for slot in slots]
        return np.array([self.space.sample(rng) for rng in draws]).reshape(-1, self.space.count)


class SobolSearch(BaselineSearch):
    """Search by the method `SobolPoints`."""

    def __init__(self, method: SobolPoints, inputs: SearchInputs) -> None:
        super().__init__(method, inputs)
        self._sequence = SobolStrings(inputs.space, inputs.seed)

    def _strings(self, generation: int, first: int) -> Floats:
        before = generation * self.population + first
        return self._sequence.strings(before, self.population - first)


class SobolStrings:
    """The strings of a seed's Sobol sequence that are allowed, numbered from 0.

    A sequence has 2**`SOBOL_BITS` points; where these hold too few allowed ones, others of the same
    seed follow.

    Parameters
    ----------
    space
        The box to fill.
    seed
        Seed of the campaign.
    """

    def __init__(self, space: SearchSpace, seed: int) -> None:
        self._space = space
        self._seed = seed
        self._whole: qmc.Sobol | None = None  # the sequence, beyond what is searched
        self._sequences = 0
        self._allowed = space.no_strings

    def strings(self, first: int, count: int) -> Floats:
        """Return strings `first` to `first + count - 1`, shape (count, k)."""
        if self._space.allowed is None:
            return sobol_strings(self._space, self._seed, first, count)
        while len(self._allowed) < first + count:
            if self._whole is None or self._whole.num_generated + BLOCK > 1 << SOBOL_BITS:
                self._whole = _sequence(self._space, self._seed, self._sequences)
                self._sequences += 1
            strings = self._space.from_unit(self._whole.random(BLOCK))
            self._allowed = np.vstack((self._allowed, strings[self._space.allowed(strings)]))
        return self._allowed[first : first + count]


def sobol_strings(space: SearchSpace, seed: int, first: int, count: int) -> Floats:
    """Return strings `first` to `first + count - 1` of a seed's Sobol sequence, (count, k).

    Whether they are allowed does not matter.
    """
    sequence = _sequence(space, seed)
    if first:
        sequence.fast_forward(first)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # evenness is best with powers of two
        return space.from_unit(sequence.random(count))


def _sequence(space: SearchSpace, seed: int, number: int = 0) -> "qmc.Sobol":
    """Return a sequence of a seed; the first one has the number 0."""
    from scipy.stats import qmc  # takes half a second to load

    scramble = search_stream(seed, SOBOL_SCRAMBLE, number)
    return qmc.Sobol(space.dimensions, bits=SOBOL_BITS, seed=scramble)
