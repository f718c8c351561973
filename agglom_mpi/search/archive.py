"""All strings that were judged and what they turned out to be, for searches that forget nothing."""

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.proposals import Judged, Ranked
from agglom_mpi.variables import COUNT


class Archive:
    """Strings by number, with their objectives; the best of them are the population.

    Parameters
    ----------
    kept
        Strings of the population at most.

    Attributes
    ----------
    generation : int, how many batches were told
    parameters : array, shape (n, 10), in the order of their numbers
    objectives, deviations : array, shape (n,), as in `Judged`
    samples : array of int64, shape (n,), how many each of them rests on
    """

    def __init__(self, kept: int) -> None:
        self.generation = 0
        self.parameters = np.empty((0, COUNT))
        self.objectives = np.empty(0)
        self.deviations = np.empty(0)
        self.samples = np.empty(0, np.int64)
        self._kept = kept

    def __len__(self) -> int:
        return len(self.objectives)

    def tell(self, judged: Judged) -> None:
        """Take a generation."""
        order = np.argsort(judged.ids)
        if not np.array_equal(judged.ids[order], np.arange(len(order)) + len(self)):
            raise ValueError("a generation is told whole, and after those before it")
        for name in ("parameters", "objectives", "deviations", "samples"):
            told = getattr(judged, name)[order]
            setattr(self, name, np.concatenate((getattr(self, name), told)))
        self.generation += 1

    @property
    def population_ids(self) -> NDArray[np.int64]:
        """Numbers of the strings of the population, the best first."""
        return self._ranked()[: self._kept]

    def best(self, k: int) -> list[Ranked]:
        """Return the k best strings, best first."""
        return [Ranked(int(i), float(self.objectives[i])) for i in self._ranked()[:k]]

    def mean_of_top(self, k: int) -> float:
        """Return the mean objective of the k best strings."""
        return float(np.mean([ranked.objective for ranked in self.best(k)]))

    def _ranked(self) -> NDArray[np.int64]:
        worth = np.where(np.isfinite(self.objectives), self.objectives, np.inf)
        return np.argsort(worth, kind="stable")
