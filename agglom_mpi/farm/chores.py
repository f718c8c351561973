"""Work that is left when all is decided: its tasks are known, and all ranks do them."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.errands import Errands
from agglom_mpi.farm.work import Stage


class Chore(ABC):
    """Something to be done for the best strings after the search, once and for all.

    Attributes
    ----------
    errands
        Who does which of its tasks; there when it has begun.
    done_before
        What was done of its stage when it began.
    """

    errands: Errands
    done_before: int

    @property
    @abstractmethod
    def stage(self) -> Stage:
        """How far it is."""

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
        self.done_before = self.stage.done
        return self.announcement(tasks) if len(tasks) else ""
