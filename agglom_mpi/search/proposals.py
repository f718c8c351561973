"""Proposed strings, the results of their evaluation, and what a search decides by these."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.statistics import Floats

if TYPE_CHECKING:
    from agglom_mpi.search.ensemble import EnsembleResult

RANDOM: Final = 0
OFFSPRING: Final = 1
MODEL: Final = 2
GIVEN: Final = 3
AGAIN: Final = 4
ORIGINS: Final = ("random", "offspring", "model", "given", "again")
"""Origin of a string, by its code."""
NO_PARENT: Final = -1


class Proposals(NamedTuple):
    """The n new strings of a generation, in the order of their numbers."""

    generation: int
    slot: NDArray[np.int64]
    """Index in the population, shape (n,)."""
    origin: NDArray[np.int8]
    """Index in ORIGINS, shape (n,)."""
    parents: NDArray[np.int64]
    """Numbers of the two parent strings, -1 for none, shape (n, 2); for origin `again` the string
    that gets more samples."""
    parameters: Floats
    """The strings in SI units, shape (n, k)."""


class Evaluations(NamedTuple):
    """Results of the n new strings of a generation, in any order."""

    ids: NDArray[np.int64]
    """Their numbers, in the order of the proposals, shape (n,)."""
    parameters: Floats
    """The strings as they were evaluated, shape (n, k); a resumed campaign reads them from its
    file."""
    objectives: Floats
    """Shape (n,); not finite where a string could not be evaluated."""
    deviations: Floats
    """The signed means whose magnitudes the objectives are, or the objectives, shape (n,)."""
    samples: NDArray[np.int64] | Floats
    """Number of completed samples of each, or another number that the variance of its noise is
    inversely proportional to, shape (n,)."""


class Ranked(NamedTuple):
    """A string with the objective by which a search ranks it."""

    string: int
    objective: float
    standard_error: float | None = None
    """Of the search's own estimate; None where the objective is that of the string's ensemble."""


def as_proposals(generation: int, strings: Floats, origin: int, slot: int = 0) -> Proposals:
    """Return strings, shape (n, k), without parents as proposals, in the slots from `slot` on."""
    count = len(strings)
    return Proposals(
        generation,
        slot=np.arange(slot, slot + count),
        origin=np.full(count, origin, np.int8),
        parents=np.full((count, 2), NO_PARENT),
        parameters=strings,
    )


def begun_with(
    given: Floats,
    others: Floats,
    generation: int = 0,
    origin: int = RANDOM,
) -> Proposals:
    """Return given strings, shape (n, k), and others of an origin in the slots after."""
    return joined_proposals(
        as_proposals(generation, given, GIVEN),
        as_proposals(generation, others, origin, len(given)),
    )


def joined_proposals(first: Proposals, *others: Proposals) -> Proposals:
    """Return several proposals of the same generation as one."""
    columns = zip(*(each[1:] for each in (first, *others)), strict=True)
    return Proposals(first.generation, *map(np.concatenate, columns))


class EvaluatedStrings:
    """All evaluated strings by number; the best of them are the population.

    Parameters
    ----------
    kept
        Largest size of the population.

    Attributes
    ----------
    generation : int, number of generations told
    parameters : array, shape (n, k), in the order of their numbers
    objectives, deviations : array, shape (n,), as in `Evaluations`; inf if not finite
    samples : array of int64, shape (n,), completed samples of each
    """

    def __init__(self, kept: int) -> None:
        self.generation = 0
        self.parameters = np.empty((0, 0))
        self.objectives = np.empty(0)
        self.deviations = np.empty(0)
        self.samples = np.empty(0, np.int64)
        self._kept = kept

    def __len__(self) -> int:
        return len(self.objectives)

    def tell(self, evaluations: Evaluations) -> None:
        """Add the results of a generation."""
        order = np.argsort(evaluations.ids)
        if not np.array_equal(evaluations.ids[order], np.arange(len(order)) + len(self)):
            raise ValueError("a generation is told whole, and after those before it")
        finite = np.isfinite(evaluations.objectives)
        told = evaluations._replace(objectives=np.where(finite, evaluations.objectives, np.inf))
        for name in ("parameters", "objectives", "deviations", "samples"):
            new, known = getattr(told, name)[order], getattr(self, name)
            setattr(self, name, np.concatenate((known, new)) if len(known) else new)
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

    def set_error(self) -> float:
        """Return inf: no set is searched for."""
        return np.inf

    def _ranked(self) -> NDArray[np.int64]:
        """Return the numbers of the ranked strings, the best first."""
        return np.argsort(self.objectives, kind="stable")


class FixedProposals(EvaluatedStrings):
    """A search method that proposes given strings at once and learns nothing.

    Parameters
    ----------
    parameters
        Shape (n, k), SI units.
    """

    parents = 1

    def __init__(self, parameters: Floats) -> None:
        super().__init__(len(parameters))
        self._given = parameters

    def ask(self) -> Proposals:
        """Propose all strings."""
        return as_proposals(0, self._given, RANDOM)

    def known_proposals(self, generation: int) -> None:
        """Return None: there is one generation only."""


def restored(proposals: Proposals, first: int, known: Mapping[int, Floats]) -> Proposals:
    """Return proposals, numbered from `first`, with the `known` ones, by number, replaced."""
    parameters = proposals.parameters.copy()
    for row in range(len(parameters)):
        if first + row in known:
            parameters[row] = known[first + row]
    return proposals._replace(parameters=parameters)


class Progress(NamedTuple):
    """Samples used and allowed of a string that is not evaluated yet."""

    next_sample: int
    """Samples used so far, hence the number of the one that is needed next."""
    max_samples: int


class StringsProposed(NamedTuple):
    """Strings that the search has proposed."""

    proposals: Proposals
    strings: NDArray[np.int64]
    """Their numbers, shape (n,)."""
    ahead: bool
    """Whether their generation is still to come: they are proposed once more when it begins."""


class StringEvaluated(NamedTuple):
    """A string of the generation under way that needs no more samples."""

    string: int
    result: "EnsembleResult"


class GenerationSummary(NamedTuple):
    """A generation whose strings are all evaluated."""

    generation: int
    best: int
    """Number of the best string of the population."""
    objective: float
    standard_error: float
    """Of the best string: as its ensemble gives them, or a search that makes its own estimate."""
    mean_of_top: float
    """Mean objective of the best strings of the target, or of the parents without a target."""
    population: NDArray[np.int64]
    """Numbers of the strings, the best first, shape (S,)."""
    evaluations: int
    """Strings evaluated so far."""
    samples_used: int
    """Samples used so far, of all evaluated strings."""
    estimated: bool = False
    """Whether the objective is the search's own estimate, not that of the string's ensemble."""


Decision = StringsProposed | StringEvaluated | GenerationSummary
