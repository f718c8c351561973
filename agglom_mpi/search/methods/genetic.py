"""The genetic algorithm of both papers [A 22] [B 7]."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import LATER, NONE, Declared, FieldPath
from agglom_mpi.formatting import pluralise
from agglom_mpi.random_streams import OFFSPRING_BLEND, RANDOM_STRING, search_stream
from agglom_mpi.search.methods.method import PopulationMethod, SearchInputs
from agglom_mpi.search.proposals import (
    AGAIN,
    GIVEN,
    OFFSPRING,
    RANDOM,
    EvaluatedStrings,
    Evaluations,
    Proposals,
    as_proposals,
    joined_proposals,
)
from agglom_mpi.search.space import HALVINGS
from agglom_mpi.statistics import Floats

MAX_BLENDS: Final = 100
"""Maximum number of blends of two parents that are drawn until a child is allowed."""

RESAMPLE_BITS: Final = 32
"""Bits of a sample's number within a generation; the generation is in the bits above."""


class Rescale(Declared):
    """Shrink the search box around the best string by `factor` every `every` generations.

    Attributes
    ----------
    every
        Number of generations between two restrictions.
    factor
        Edge of the box after a restriction, relative to the edge before.
    """

    every: Annotated[int, Whole(at_least=1, meaning="a number of generations")]
    factor: Annotated[float, In("1", above=0, below=1, meaning="between 0 and 1")]


class Genetic(PopulationMethod):
    """Genetic algorithm: blend neighbours in rank, keep parents, add random strings [A 22] [B 7].

    A population of S strings is K kept parents (slots 0 … K-1), K offspring (K … 2K-1) and
    M = S - 2K random strings; the first one is all random. g generations take S + (g-1)(S-K)
    evaluations.

    Attributes
    ----------
    population
        Strings S of each generation.
    parents
        Strings K that are kept and mate, in pairs: an even number.
    blend
        Range of the blending number φ. Beyond [0, 1] it is the papers' mutation: offspring may
        leave the hull of their parents, but never the box.
    more_samples
        Samples by which kept parents, proposed again under new numbers, go on in every generation;
        None: parents keep their value, as published.
    rescale
        Restriction of the box of new random strings around the best string,
        `SearchSpace.around`, starting from its last restriction. Offspring remain free in the whole
        space. None never restricts.
    """

    has_parents: ClassVar[bool] = True
    method: Literal["genetic"] = "genetic"
    population: Annotated[int, Whole(at_least=4, at_most=10**5)] = 20
    parents: Annotated[int, Whole(at_least=2, multiple_of=2)] = 6
    blend: Annotated[tuple[float, float], In("1")] = (0.0, 1.0)
    more_samples: Annotated[Annotated[int, Whole(at_least=1, at_most=10**6)] | None, LATER] = None
    rescale: Annotated[Rescale | None, NONE] = None

    def build(self, inputs: SearchInputs) -> "GeneticSearch":
        """Return the search before its first generation."""
        return GeneticSearch(self, inputs)

    @property
    def kept(self) -> int:
        """Number of parents."""
        return self.parents

    @property
    def ranks_itself(self) -> bool:
        """Whether parents got more samples under other numbers."""
        return self.more_samples is not None

    @property
    def added_samples(self) -> int | None:
        """Samples added to a kept parent in every generation."""
        return self.more_samples

    @property
    def new_strings(self) -> int:
        """Number of strings to evaluate in every generation but the first."""
        return self.population - (self.parents if self.more_samples is None else 0)

    def strings(self, generations: int) -> int:
        """Return q + (g - 1)(q - p) [A 22], or g q if parents are sampled again."""
        return self.population + (generations - 1) * self.new_strings

    def first_sample(self, string: int) -> int:
        """Return the number that `verbs.simulate` takes for sample 0 of a string.

        It is 0 unless the string is a parent sampled again: its samples then have numbers of their
        own generation, so that they are independent of earlier ones.
        """
        if self.more_samples is None:
            return 0
        generation, slot = divmod(string, self.population)
        return generation << RESAMPLE_BITS if slot < self.parents else 0

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield parents that do not fit into the population, and a blend out of order."""
        yield from super().problems()
        if 2 * self.parents > self.population:
            message = (
                f"is {self.parents}; parents and as many offspring must fit into the population "
                f"of {self.population}, so at most {self.population // 4 * 2}"
            )
            yield ("parents",), message
        lower, upper = self.blend
        if lower >= upper:
            message = f"is [{lower:g}, {upper:g}]; the lower end must be less than the upper"
            yield ("blend",), message

    @property
    def summary(self) -> str:
        """One line on the method."""
        return (
            f"genetic, population {self.population}, parents {self.parents}, "
            f"blend {self.blend[0]:g} to {self.blend[1]:g} [A 22]"
        )

    @property
    def details(self) -> list[str]:
        """Lines on what is not as published."""
        lines = []
        if self.more_samples is not None:
            more = pluralise(self.more_samples, "more sample")
            lines.append(f"parents: each gets {more} in every generation")
        if self.rescale is not None:
            shrunk = f"every {pluralise(self.rescale.every, 'generation')} shrunk"
            lines.append(f"search box: {shrunk} by {self.rescale.factor:g} around the best")
        return lines


class GeneticSearch(EvaluatedStrings):
    """The population of a genetic search: the kept parents, then the new strings.

    Draws are keyed by seed, generation and slot, and `ask` changes nothing, so that the same
    evaluations always lead to the same proposals.

    Parameters
    ----------
    method
        Its numbers.
    inputs
        Box, seed and given strings.
    """

    def __init__(self, method: Genetic, inputs: SearchInputs) -> None:
        super().__init__(method.population)
        self.method = method
        self.space = self.box = inputs.space
        self.seed = inputs.seed
        self.given = inputs.given
        self._population = np.empty(0, np.int64)

    @property
    def parents(self) -> int:
        """Number of strings that are kept."""
        return self.method.parents

    def ask(self) -> Proposals:
        """Propose the strings of the next generation."""
        random = self._random_strings(self.generation)
        if self.generation == 0:
            return joined_proposals(as_proposals(0, self.given, GIVEN), random)
        if self.method.more_samples is not None:
            return joined_proposals(self._resampled_parents(), self._offspring(), random)
        return joined_proposals(self._offspring(), random)

    def tell(self, evaluations: Evaluations) -> None:
        """Learn from the results of the generation last asked for.

        Strings without a finite objective rank last.

        Raises
        ------
        ValueError
            If some of the generation are missing.
        """
        size, new = self.method.population, self.method.new_strings
        expected = new if self.generation else size
        if len(evaluations.ids) != expected:
            raise ValueError(f"generation {self.generation} has {expected} new strings")
        kept = self._ranked()[: size - new]
        super().tell(evaluations)
        self._population = np.concatenate((kept, np.sort(evaluations.ids)))
        self._restrict()

    @property
    def population_ids(self) -> NDArray[np.int64]:
        """Numbers of the strings of the population, in slot order."""
        return self._population

    def _ranked(self) -> NDArray[np.int64]:
        order = np.lexsort((self._population, self.objectives[self._population]))
        return np.asarray(self._population[order])

    def known_proposals(self, generation: int) -> tuple[int, Proposals] | None:
        """Return the number of the first random string of a coming generation, and all of these.

        None while the box that they are drawn from is not known.
        """
        rescale = self.method.rescale
        if rescale is not None and generation // rescale.every != self.generation // rescale.every:
            return None
        if generation == 0:
            return len(self.given), self._random_strings(0)
        end = self.method.strings(generation + 1)
        random = self._random_strings(generation)
        return end - len(random.slot), random

    def _resampled_parents(self) -> Proposals:
        kept = self._ranked()[: self.parents]
        proposals = as_proposals(self.generation, self.parameters[kept], AGAIN)
        proposals.parents[:, 0] = kept
        return proposals

    def _random_strings(self, generation: int) -> Proposals:
        first = 2 * self.parents if generation else len(self.given)
        parameters = np.empty((self.method.population - first, self.space.count))
        for row, slot in enumerate(range(first, self.method.population)):
            parameters[row] = self.box.sample(
                search_stream(self.seed, RANDOM_STRING, generation, slot)
            )
        return as_proposals(generation, parameters, RANDOM, first)

    def _offspring(self) -> Proposals:
        mates = np.repeat(self._ranked()[: self.parents].reshape(-1, 2), 2, axis=0)
        slots = np.arange(self.parents, 2 * self.parents)
        streams = [
            search_stream(self.seed, OFFSPRING_BLEND, self.generation, int(slot)) for slot in slots
        ]
        blend = np.array(
            [random.uniform(*self.method.blend, self.space.count) for random in streams]
        )
        better, worse = (self.space.scaled(self.parameters[some]) for some in mates.T)
        children = self._children(better, worse, blend)
        if self.space.allowed is not None:
            for row in np.flatnonzero(~self.space.allowed(children)).tolist():
                pair = better[row], worse[row]
                child = self._allowed_child(*pair, blend[row], streams[row])
                children[row] = self.parameters[mates[row, 0]] if child is None else child
        origin = np.full(slots.size, OFFSPRING, np.int8)
        return Proposals(self.generation, slots, origin, mates, children)

    def _children(
        self,
        better: Floats,
        worse: Floats,
        blend: Floats,
    ) -> Floats:
        """Return blends of scaled parents in the box, shape (..., k)."""
        # φ·better + (1-φ)·worse, in the form that gives equal parents an equal child.
        return self.space.clip(self.space.unscaled(worse + blend * (better - worse)))

    def _allowed_child(
        self,
        better: Floats,
        worse: Floats,
        blend: Floats,
        random: np.random.Generator,
    ) -> Floats | None:
        """Return an allowed child of scaled parents whose first blend is not allowed, or None.

        Other blends are drawn; if none of them is allowed, children nearer and nearer to the better
        parent are tried.
        """
        assert self.space.allowed is not None
        drawn = random.uniform(*self.method.blend, (MAX_BLENDS, self.space.count))
        nearer = 1.0 + (blend - 1.0) * 0.5 ** np.arange(1.0, HALVINGS)[:, None]
        children = self._children(better, worse, np.vstack((drawn, nearer)))
        allowed = np.flatnonzero(self.space.allowed(children))
        return np.asarray(children[allowed[0]]) if len(allowed) else None

    def _restrict(self) -> None:
        best, rescale = self._ranked()[0], self.method.rescale
        if rescale is None or self.generation % rescale.every:
            return
        # Nothing is known about where to look while every string has failed.
        if np.isfinite(self.objectives[best]):
            self.box = self.box.around(self.parameters[best], rescale.factor)
