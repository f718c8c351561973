"""What passes between a search and whoever drives it: strings proposed, and their worth."""

from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

RANDOM: Final = 0
OFFSPRING: Final = 1
MODEL: Final = 2
GIVEN: Final = 3
AGAIN: Final = 4
ORIGINS: Final = ("random", "offspring", "model", "given", "again")
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
    """Numbers of the two parent strings, -1 for none, shape (n, 2); of a string that gets more
    samples the one that it was before."""
    parameters: NDArray[np.float64]
    """The strings in SI units, shape (n, 10)."""


class Judged(NamedTuple):
    """What the n new strings of a generation turned out to be, in any order."""

    ids: NDArray[np.int64]
    """Their numbers, which grow in the order of the proposals, shape (n,)."""
    parameters: NDArray[np.float64]
    """The strings as they were evaluated, shape (n, 10); a resumed campaign reads them from its
    file."""
    objectives: NDArray[np.float64]
    """Shape (n,); not finite where a string could not be judged."""
    deviations: NDArray[np.float64]
    """The signed means whose magnitudes the objectives are, or the objectives, shape (n,)."""
    samples: NDArray[np.int64]
    """Completed samples that these rest on, shape (n,)."""


class Ranked(NamedTuple):
    """A string that a search has made its mind up about."""

    string: int
    objective: float
    standard_error: float | None = None
    """Of a search's own estimate; None where the objective is that of the string's ensemble."""


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

    def known_proposals(self, generation: int) -> tuple[int, Batch] | None:
        """Propose strings of a coming generation that no further result changes, the last of it.

        Returns
        -------
        tuple or None
            Number that the first of them will have, and the strings; None if there are none, or
            if they are not known yet.
        """

    def tell(self, judged: Judged) -> None:
        """Take what the proposed strings turned out to be worth."""

    def best(self, k: int) -> list[Ranked]:
        """Return the k best strings, best first."""

    def mean_of_top(self, k: int) -> float:
        """Return the mean objective of the k best strings."""


def as_batch(generation: int, strings: NDArray[np.float64], origin: int, slot: int = 0) -> Batch:
    """Strings, shape (n, 10), that have no parents, in the slots from `slot` on."""
    count = len(strings)
    return Batch(
        generation,
        slot=np.arange(slot, slot + count),
        origin=np.full(count, origin, np.int8),
        parents=np.full((count, 2), NO_PARENT),
        parameters=strings,
    )


def begun_with(
    given: NDArray[np.float64], random: NDArray[np.float64], generation: int = 0
) -> Batch:
    """One batch of strings that were given, shape (n, 10), and random ones in the slots after."""
    return joined(
        as_batch(generation, given, GIVEN), as_batch(generation, random, RANDOM, len(given))
    )


def joined(first: Batch, *others: Batch) -> Batch:
    """One batch of several of the same generation."""
    columns = zip(*(batch[1:] for batch in (first, *others)), strict=True)
    return Batch(first.generation, *map(np.concatenate, columns))
