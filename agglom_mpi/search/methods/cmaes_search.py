"""The covariance matrix adaptation evolution strategy (Hansen 2016), by the cmaes library."""

from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.random_streams import EVOLUTION, search_stream
from agglom_mpi.search.methods.baselines import SobolStrings
from agglom_mpi.search.methods.method import PopulationMethod, SearchInputs
from agglom_mpi.search.proposals import (
    MODEL,
    EvaluatedStrings,
    Evaluations,
    Proposals,
    as_proposals,
    begun_with,
)
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.statistics import Floats

FAILED_OBJECTIVE: Final = 1e300
"""Objective of a string that could not be evaluated, for a method that only ranks."""


MAX_DRAWS: Final = 200
"""Maximum number of draws until a string is allowed."""
MIDDLE_CANDIDATES: Final = 256
"""Number of allowed strings of which the most central one is where a search begins."""


class Cmaes(PopulationMethod):
    """Draw strings from a normal distribution that moves towards the best of them.

    Attributes
    ----------
    population
        Strings of each generation.
    sigma
        First standard deviation in units of the box.
    """

    library: ClassVar[str | None] = "cmaes"
    method: Literal["cmaes"] = "cmaes"
    population: Annotated[int, Whole(at_least=4, at_most=10**5)] = 20
    sigma: Annotated[float, In("1", above=0, at_most=1, meaning="a share of the box")] = 0.3

    def build(self, inputs: SearchInputs) -> "CmaesSearch":
        """Return the search before its first generation."""
        return CmaesSearch(self, inputs)

    @property
    def summary(self) -> str:
        """One line on the method."""
        deviation = f"first standard deviation {self.sigma:g} of the box"
        return f"CMA-ES, population {self.population}, {deviation}"


class CmaesSearch(EvaluatedStrings):
    """The distribution of a search by `Cmaes`.

    It begins about the first given string, or in the middle of what is allowed of the box.

    Parameters
    ----------
    method
        Its numbers.
    inputs
        Box, seed and given strings.
    """

    parents = 1

    def __init__(self, method: Cmaes, inputs: SearchInputs) -> None:
        from cmaes import CMA

        super().__init__(method.population)
        space, seed, given = inputs.space, inputs.seed, inputs.given
        self.space = space
        self.given = given
        dimensions = space.dimensions
        self._random = search_stream(seed, EVOLUTION)
        self._best = space.to_unit(given)[0] if len(given) else _middle(space, seed)
        self._strategy = CMA(
            mean=self._best,
            sigma=method.sigma,
            bounds=np.tile([0.0, 1.0], (dimensions, 1)),
            population_size=method.population,
            seed=int(self._random.integers(2**31)),
        )
        self._points = self._drawn(method.population)

    def ask(self) -> Proposals:
        """Return the strings of the next generation."""
        drawn = self.space.from_unit(self._points)
        if self.generation:
            return as_proposals(self.generation, drawn, MODEL)
        return begun_with(self.given, drawn[len(self.given) :])

    def known_proposals(self, generation: int) -> None:
        """Return None: all generations depend on the one before."""

    def tell(self, evaluations: Evaluations) -> None:
        """Move the distribution by the results of a generation, at the points evaluated."""
        super().tell(evaluations)
        count = len(evaluations.ids)
        points = self.space.to_unit(self.parameters[-count:])
        objectives = np.where(np.isinf(new := self.objectives[-count:]), FAILED_OBJECTIVE, new)
        self._strategy.tell(list(zip(points, objectives.tolist(), strict=True)))
        self._best = self.space.to_unit(self.parameters[self._ranked()[:1]])[0]
        self._points = self._drawn(count)

    def _drawn(self, number: int) -> Floats:
        return np.array([self._allowed_point() for _ in range(number)])

    def _allowed_point(self) -> Floats:
        """Return a point that is drawn until it is allowed, or moved towards the best one."""
        for _ in range(MAX_DRAWS):
            point = self._strategy.ask()
            if self.space.allowed is None or self.space.allows(point[None])[0]:
                return np.asarray(point)
        moved = self.space.towards(point[None], self._best[None])
        return (
            moved[0]
            if self.space.allows(moved)[0]
            else self.space.sample_points(self._random, 1)[0]
        )


def _middle(space: SearchSpace, seed: int) -> Floats:
    """Return the middle of the unit cube, or the most central of some allowed points."""
    middle = np.full(space.dimensions, 0.5)
    if space.allows(middle[None])[0]:
        return middle
    points = space.to_unit(SobolStrings(space, seed).strings(0, MIDDLE_CANDIDATES))
    return np.asarray(points[np.argmin(np.sum((points - points.mean(axis=0)) ** 2, axis=1))])
