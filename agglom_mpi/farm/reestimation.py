"""The best strings on fresh samples: which are asked for, which are there, which are missing."""

from collections.abc import Callable, Collection

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.chores import Chore
from agglom_mpi.farm.messages import TASK
from agglom_mpi.farm.work import Finalists, Stage
from agglom_mpi.words import counted


class Reestimation(Chore):
    """Fresh samples of the best strings, those numbers of `/samples` that no decision sees.

    Parameters
    ----------
    finalists
        Strings, the best first, and how many samples are asked for of each.
    fresh_from, max_samples
        Numbers of the first fresh sample of a string, and of the first that there is no room for.
    known
        (string, sample) that need no simulation, from an earlier leg.
    parameters
        Parameter string, (10,), of a number.
    """

    def __init__(
        self,
        finalists: Finalists,
        fresh_from: int,
        max_samples: int,
        known: Collection[tuple[int, int]],
        parameters: Callable[[int], NDArray[np.float64]],
    ) -> None:
        self._finalists = finalists
        self._numbers = range(fresh_from, min(fresh_from + finalists.samples, max_samples))
        self._parameters = parameters
        pairs = {(string, sample) for string in finalists.strings for sample in self._numbers}
        self._missing = pairs.difference(known)

    @property
    def complete(self) -> bool:
        """Whether all are there that are asked for and that there is room for."""
        return not self._missing

    @property
    def done(self) -> bool:
        """Whether nothing more will come."""
        return not self._missing

    @property
    def stage(self) -> Stage:
        """Count the samples that are asked for."""
        total = len(self._finalists.strings) * len(self._numbers)
        return Stage(total - len(self._missing), total, "fresh samples")

    def open(self) -> NDArray[np.void]:
        """Return the tasks, (n,) of `TASK`, for samples that are missing; the best string first."""
        pairs = [(i, j) for i in self._finalists.strings for j in self._numbers]
        tasks = np.zeros(len(self._missing), TASK)
        lacking = [pair for pair in pairs if pair in self._missing]
        for task, (string, sample) in zip(tasks, lacking, strict=True):
            task["string"], task["first"], task["count"] = string, sample, 1
            task["parameters"] = self._parameters(string)
        return tasks

    def announcement(self, tasks: NDArray[np.void]) -> str:
        """Say what is to be done."""
        strings = counted(len(set(tasks["string"].tolist())), "string")
        return f"estimating {strings} again, on {counted(len(tasks), 'fresh sample')}"

    def take(self, rows: NDArray[np.void]) -> None:
        """Take samples, (n,), completed or failed."""
        self._missing.difference_update(rows[["string", "sample"]].tolist())
