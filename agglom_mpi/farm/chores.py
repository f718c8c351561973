"""Work that is left when all is decided: its tasks are known, and all ranks do them."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.errands import Errands


class Chore(ABC):
    """Something to be done for the best strings after the search, once and for all.

    Attributes
    ----------
    errands
        Who does which of its tasks; there when it has begun.
    """

    errands: Errands

    @property
    @abstractmethod
    def complete(self) -> bool:
        """Whether a run would have nothing to do."""

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether nothing more will come."""

    @abstractmethod
    def open(self) -> NDArray[np.void]:
        """Make ready; the tasks, (n,) of `TASK`, for what is missing."""

    @abstractmethod
    def announcement(self, tasks: NDArray[np.void]) -> str:
        """Say what is to be done."""

    def begin(self, ranks: int) -> str:
        """Make ready for so many ranks; what they have to do, in words, nothing if nothing."""
        tasks = self.open()
        self.errands = Errands(tasks, ranks)
        return self.announcement(tasks) if len(tasks) else ""
