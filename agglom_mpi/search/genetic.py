"""The genetic algorithm of both papers [A 22] [B 7], asked for strings and told their worth."""

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.proposals import NO_PARENT, OFFSPRING, RANDOM, Batch
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.streams import OFFSPRING_BLEND, RANDOM_STRING, stream
from agglom_mpi.variables import COUNT


class GeneticSearch:
    """Blend neighbours in rank, keep the parents, add random strings [A 22] [B 7].

    A population of S strings is K kept parents (slots 0 … K-1), K offspring (K … 2K-1) and
    M = S - 2K random strings; the first one is all random. g generations take S + (g-1)(S-K)
    evaluations. Draws are keyed by seed, generation and slot, and `ask` changes nothing, so
    that the same tells always lead to the same proposals.

    Parameters
    ----------
    space
        The box to search.
    seed
        Seed of the campaign.
    population
        S.
    parents
        K, even because they mate in pairs.
    blend
        Range of the blending number φ. Beyond [0, 1] it is the papers' mutation: offspring may
        leave the hull of their parents, though never the box.
    rescale
        (every, factor): each `every` generations the box of new random strings is restricted
        around the best string, `SearchSpace.around`, starting from its last restriction.
        Offspring remain free in the whole space. None never restricts.
    """

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        population: int = 20,
        parents: int = 6,
        blend: tuple[float, float] = (0.0, 1.0),
        rescale: tuple[int, float] | None = None,
    ) -> None:
        if parents < 2 or parents % 2 or 2 * parents > population:
            raise ValueError("parents must be an even number, at most half of the population")
        if blend[0] > blend[1]:
            raise ValueError("blend must be a range, lower end first")
        if rescale is not None and (rescale[0] < 1 or not 0.0 < rescale[1] <= 1.0):
            raise ValueError("rescale must be at least one generation and a factor in (0, 1]")
        self.space = space
        self.box = space
        self.seed = seed
        self.population = population
        self.parents = parents
        self.blend = blend
        self.rescale = rescale
        self.generation = 0
        self.population_ids = np.empty(0, np.int64)
        self._parameters = np.empty((0, COUNT))
        self._objectives = np.empty(0)
        self._ranked = np.empty(0, np.int64)

    def ask(self) -> Batch:
        """Propose the strings of the next generation."""
        random = self._random_strings(self.generation)
        if self.generation == 0:
            return random
        offspring = self._offspring()
        return Batch(
            self.generation,
            slot=np.concatenate((offspring.slot, random.slot)),
            origin=np.concatenate((offspring.origin, random.origin)),
            parents=np.concatenate((offspring.parents, random.parents)),
            parameters=np.concatenate((offspring.parameters, random.parameters)),
        )

    def tell(
        self,
        ids: NDArray[np.int64],
        parameters: NDArray[np.float64],
        objectives: NDArray[np.float64],
    ) -> None:
        """Take the worth of all strings of the generation last asked for, in any order.

        Parameters
        ----------
        ids
            Their numbers, growing in the order of the proposals, shape (n,).
        parameters
            The strings as they were evaluated, shape (n, 10); a resumed campaign reads them
            from its file.
        objectives
            Their objectives, shape (n,). What is not finite ranks last.
        """
        expected = self.population - (self.parents if self.generation else 0)
        if len(ids) != expected:
            raise ValueError(f"generation {self.generation} has {expected} new strings")
        kept = self._ranked[: self.parents]
        order = np.argsort(ids)
        worth = np.where(np.isfinite(objectives), objectives, np.inf)
        self.population_ids = np.concatenate((self.population_ids[kept], ids[order]))
        self._parameters = np.concatenate((self._parameters[kept], parameters[order]))
        self._objectives = np.concatenate((self._objectives[kept], worth[order]))
        self._ranked = np.lexsort((self.population_ids, self._objectives))
        self.generation += 1
        self._restrict()

    def best(self, k: int) -> list[tuple[int, float]]:
        """Return number and objective of the k best strings of the population, best first."""
        top = self._ranked[:k]
        return [(int(self.population_ids[i]), float(self._objectives[i])) for i in top]

    def mean_of_top(self, k: int) -> float:
        """Return the mean objective of the k best strings of the population [A 26]."""
        return float(np.mean(self._objectives[self._ranked[:k]]))

    def random_proposals(self, generation: int) -> tuple[int, Batch] | None:
        """Return the random strings of a coming generation, and the number of the first of them.

        None while the box that they come from is not known.
        """
        if self.rescale is not None:
            every = self.rescale[0]
            if generation // every != self.generation // every:
                return None
        new = self.population - self.parents
        first = self.population + (generation - 1) * new + self.parents if generation else 0
        return first, self._random_strings(generation)

    def _random_strings(self, generation: int) -> Batch:
        slots = np.arange(2 * self.parents if generation else 0, self.population)
        parameters = np.empty((slots.size, COUNT))
        for row, slot in enumerate(slots):
            rng = stream(self.seed, RANDOM_STRING, generation, int(slot))
            parameters[row] = self.box.sample(rng)
        origin = np.full(slots.size, RANDOM, np.int8)
        return Batch(generation, slots, origin, np.full((slots.size, 2), NO_PARENT), parameters)

    def _offspring(self) -> Batch:
        mates = np.repeat(self._ranked[: self.parents].reshape(-1, 2), 2, axis=0)
        slots = np.arange(self.parents, 2 * self.parents)
        blend = np.array(
            [
                stream(self.seed, OFFSPRING_BLEND, self.generation, int(slot)).uniform(
                    *self.blend, COUNT
                )
                for slot in slots
            ]
        )
        better, worse = self._parameters[mates[:, 0]], self._parameters[mates[:, 1]]
        # φ·better + (1-φ)·worse, in the form that gives equal parents an equal child.
        children = self.space.clip(worse + blend * (better - worse))
        origin = np.full(slots.size, OFFSPRING, np.int8)
        return Batch(self.generation, slots, origin, self.population_ids[mates], children)

    def _restrict(self) -> None:
        best = self._ranked[0]
        if self.rescale is None or self.generation % self.rescale[0]:
            return
        # Nothing is known about where to look while every string has failed.
        if np.isfinite(self._objectives[best]):
            self.box = self.box.around(self._parameters[best], self.rescale[1])
