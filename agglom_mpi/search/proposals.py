"""What passes between a search and whoever drives it: batches of proposed strings."""

from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

RANDOM: Final = 0
OFFSPRING: Final = 1
ORIGINS: Final = ("random", "offspring")
"""Where a string comes from, by its origin code."""
NO_PARENT: Final = -1


class Batch(NamedTuple):
    """The n new strings of one generation, in the order in which they get their numbers."""

    generation: int
    slot: NDArray[np.int64]
    """Index in the population, shape (n,)."""
    origin: NDArray[np.int8]
    """Index in ORIGINS, shape (n,)."""
    parents: NDArray[np.int64]
    """Numbers of the two parent strings, -1 for none, shape (n, 2)."""
    parameters: NDArray[np.float64]
    """The strings in SI units, shape (n, 10)."""


class Search(Protocol):
    """A method that proposes strings and learns from their objectives, batch by batch."""

    @property
    def parents(self) -> int:
        """How many of the best strings the method keeps."""

    @property
    def population_ids(self) -> NDArray[np.int64]:
        """Numbers of the strings of the population last told, in slot order."""

    def ask(self) -> Batch:
        """Propose the strings of the next generation; asking again changes nothing."""

    def random_proposals(self, generation: int) -> tuple[int, Batch] | None:
        """Propose the strings of a coming generation that depend on no result, the last of it.

        Returns
        -------
        tuple or None
            Number that the first of them will have, and the strings; None if there are none, or
            if they are not known yet.
        """

    def tell(
        self,
        ids: NDArray[np.int64],
        parameters: NDArray[np.float64],
        objectives: NDArray[np.float64],
    ) -> None:
        """Take what the proposed strings turned out to be worth."""

    def best(self, k: int) -> list[tuple[int, float]]:
        """Return number and objective of the k best strings, best first."""

    def mean_of_top(self, k: int) -> float:
        """Return the mean objective of the k best strings."""
