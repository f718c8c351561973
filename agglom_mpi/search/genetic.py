"""The genetic algorithm of both papers [A 22] [B 7]."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.random_streams import OFFSPRING_BLEND, RANDOM_STRING, search_stream
from agglom_mpi.search.baselines import NO_STRINGS
from agglom_mpi.search.proposals import (
    AGAIN,
    GIVEN,
    OFFSPRING,
    RANDOM,
    Evaluations,
    Proposals,
    Ranked,
    as_proposals,
    joined_proposals,
)
from agglom_mpi.search.space import HALVINGS, SearchSpace
from agglom_mpi.variables import COUNT

BLENDS: Final = 100
"""Blends of two parents that are drawn at most to find an allowed one."""


class GeneticSearch:
    """Blend neighbours in rank, keep the parents, add random strings [A 22] [B 7].

    A population of S strings is K kept parents (slots 0 … K-1), K offspring (K … 2K-1) and
    M = S - 2K random strings; the first one is all random. g generations take S + (g-1)(S-K)
    evaluations. Draws are keyed by seed, generation and slot, and `ask` changes nothing, so
    that the same evaluations always lead to the same proposals.

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
        leave the hull of their parents, but never the box.
    rescale
        (every, factor): each `every` generations the box of new random strings is restricted
        around the best string, `SearchSpace.around`, starting from its last restriction.
        Offspring remain free in the whole space. None never restricts.
    given
        Strings that the first generation begins with, shape (n, 10), n at most S.
    again
        Whether kept parents are proposed again, under new numbers, to get more samples; as
        published they keep their value.
    """

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        population: int = 20,
        parents: int = 6,
        blend: tuple[float, float] = (0.0, 1.0),
        rescale: tuple[int, float] | None = None,
        given: NDArray[np.float64] = NO_STRINGS,
        again: bool = False,
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
        self.given = given
        self.again = again
        self.generation = 0
        self.population_ids = np.empty(0, np.int64)
        self._parameters = np.empty((0, COUNT))
        self._objectives = np.empty(0)
        self._ranked = np.empty(0, np.int64)

    def ask(self) -> Proposals:
        """Propose the strings of the next generation."""
        random = self._random_strings(self.generation)
        if self.generation == 0:
            return joined_proposals(as_proposals(0, self.given, GIVEN), random)
        if self.again:
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
        expected = self._new if self.generation else self.population
        if len(evaluations.ids) != expected:
            raise ValueError(f"generation {self.generation} has {expected} new strings")
        kept = self._ranked[: self.population - self._new]
        order = np.argsort(evaluations.ids)
        objectives = evaluations.objectives[order]
        objectives = np.where(np.isfinite(objectives), objectives, np.inf)
        self.population_ids = np.concatenate((self.population_ids[kept], evaluations.ids[order]))
        self._parameters = np.concatenate((self._parameters[kept], evaluations.parameters[order]))
        self._objectives = np.concatenate((self._objectives[kept], objectives))
        self._ranked = np.lexsort((self.population_ids, self._objectives))
        self.generation += 1
        self._restrict()

    def best(self, k: int) -> list[Ranked]:
        """Return the k best strings of the population, best first."""
        top = self._ranked[:k]
        return [Ranked(int(self.population_ids[i]), float(self._objectives[i])) for i in top]

    def mean_of_top(self, k: int) -> float:
        """Return the mean objective of the k best strings of the population [A 26]."""
        return float(np.mean(self._objectives[self._ranked[:k]]))

    def known_proposals(self, generation: int) -> tuple[int, Proposals] | None:
        """Return the number of the first random string of a coming generation, and all of these.

        None while the box that they are drawn from is not known.
        """
        if self.rescale is not None:
            every = self.rescale[0]
            if generation // every != self.generation // every:
                return None
        if generation == 0:
            return len(self.given), self._random_strings(0)
        end = self.population + generation * self._new
        random = self._random_strings(generation)
        return end - len(random.slot), random

    @property
    def _new(self) -> int:
        """Number of strings to evaluate in every generation but the first."""
        return self.population if self.again else self.population - self.parents

    def _resampled_parents(self) -> Proposals:
        kept = self._ranked[: self.parents]
        proposals = as_proposals(self.generation, self._parameters[kept], AGAIN)
        proposals.parents[:, 0] = self.population_ids[kept]
        return proposals

    def _random_strings(self, generation: int) -> Proposals:
        first = 2 * self.parents if generation else len(self.given)
        parameters = np.empty((self.population - first, COUNT))
        for row, slot in enumerate(range(first, self.population)):
            parameters[row] = self.box.sample(
                search_stream(self.seed, RANDOM_STRING, generation, slot)
            )
        return as_proposals(generation, parameters, RANDOM, first)

    def _offspring(self) -> Proposals:
        mates = np.repeat(self._ranked[: self.parents].reshape(-1, 2), 2, axis=0)
        slots = np.arange(self.parents, 2 * self.parents)
        streams = [
            search_stream(self.seed, OFFSPRING_BLEND, self.generation, int(slot)) for slot in slots
        ]
        blend = np.array([random.uniform(*self.blend, COUNT) for random in streams])
        better, worse = (self.space.scaled(self._parameters[some]) for some in mates.T)
        children = self._children(better, worse, blend)
        if self.space.allowed is not None:
            for row in np.flatnonzero(~self.space.allowed(children)).tolist():
                pair = better[row], worse[row]
                child = self._allowed_child(*pair, blend[row], streams[row])
                children[row] = self._parameters[mates[row, 0]] if child is None else child
        origin = np.full(slots.size, OFFSPRING, np.int8)
        return Proposals(self.generation, slots, origin, self.population_ids[mates], children)

    def _children(
        self,
        better: NDArray[np.float64],
        worse: NDArray[np.float64],
        blend: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return blends of scaled parents in the box, shape (..., 10)."""
        # φ·better + (1-φ)·worse, in the form that gives equal parents an equal child.
        return self.space.clip(self.space.unscaled(worse + blend * (better - worse)))

    def _allowed_child(
        self,
        better: NDArray[np.float64],
        worse: NDArray[np.float64],
        blend: NDArray[np.float64],
        random: np.random.Generator,
    ) -> NDArray[np.float64] | None:
        """Return an allowed child of scaled parents whose first blend is not allowed, or None.

        Other blends are drawn; if none of them is allowed, children nearer and nearer to the better
        parent are tried.
        """
        assert self.space.allowed is not None
        drawn = random.uniform(*self.blend, (BLENDS, COUNT))
        nearer = 1.0 + (blend - 1.0) * 0.5 ** np.arange(1.0, HALVINGS)[:, None]
        children = self._children(better, worse, np.vstack((drawn, nearer)))
        allowed = np.flatnonzero(self.space.allowed(children))
        return np.asarray(children[allowed[0]]) if len(allowed) else None

    def _restrict(self) -> None:
        best = self._ranked[0]
        if self.rescale is None or self.generation % self.rescale[0]:
            return
        # Nothing is known about where to look while every string has failed.
        if np.isfinite(self._objectives[best]):
            self.box = self.box.around(self._parameters[best], self.rescale[1])
