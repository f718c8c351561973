"""Where samples fail: the probability that too many of a string do, for it to be a member."""

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.emulation.emulator import Emulator, merged

Floats = NDArray[np.float64]


class FailingShare:
    """The probability of failure, a regression of which strings failed.

    Parameters
    ----------
    points
        Coordinates of all strings, shape (n, p).
    failed
        Which of them failed, shape (n,).
    random
    groups
        How many of the coordinates, the last ones, are groups of variables.
    """

    def __init__(
        self,
        points: Floats,
        failed: NDArray[np.bool_],
        random: np.random.Generator,
        groups: int = 0,
    ) -> None:
        self.count = int(failed.sum())
        self._process = (
            Emulator(merged(points, failed.astype(np.float64)), random, groups, rounds=0)
            if self.count
            else None
        )

    def at(self, points: Floats) -> Floats:
        """Return the probability at points, (m, p), shape (m,)."""
        if self._process is None:
            return np.zeros(len(points))
        return np.clip(self._process.mean(points), 0.0, 1.0)
