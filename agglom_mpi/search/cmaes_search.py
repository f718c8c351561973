"""The covariance matrix adaptation evolution strategy (Hansen 2016), by the cmaes library."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.random_streams import EVOLUTION, search_stream
from agglom_mpi.search.baselines import NO_STRINGS
from agglom_mpi.search.proposals import (
    MODEL,
    EvaluatedStrings,
    Evaluations,
    Proposals,
    as_proposals,
    begun_with,
)
from agglom_mpi.search.space import SearchSpace

FAILED_OBJECTIVE: Final = 1e300
"""Objective of a string that could not be evaluated, for a method that only ranks."""


class CmaesSearch(EvaluatedStrings):
    """Draw strings from a normal distribution that moves towards the best of them.

    Parameters
    ----------
    space
        The box to search.
    seed
        Seed of the campaign.
    population
        Strings of each generation.
    sigma
        First standard deviation in units of the box.
    given
        Strings that the first generation begins with, shape (n, 10), n at most `population`. The
        distribution begins about the first of them, or in the middle of the box.
    """

    parents = 1

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        population: int,
        sigma: float,
        given: NDArray[np.float64] = NO_STRINGS,
    ) -> None:
        from cmaes import CMA

        super().__init__(population)
        self.space = space
        self.given = given
        dimensions = space.dimensions
        self._strategy = CMA(
            mean=space.to_unit(given)[0] if len(given) else np.full(dimensions, 0.5),
            sigma=sigma,
            bounds=np.tile([0.0, 1.0], (dimensions, 1)),
            population_size=population,
            seed=int(search_stream(seed, EVOLUTION).integers(2**31)),
        )
        self._points = self._drawn(population)

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
        objectives = self.objectives[-count:]
        objectives = np.where(np.isfinite(objectives), objectives, FAILED_OBJECTIVE)
        self._strategy.tell(list(zip(points, objectives.tolist(), strict=True)))
        self._points = self._drawn(count)

    def _drawn(self, number: int) -> NDArray[np.float64]:
        return np.array([self._strategy.ask() for _ in range(number)])
