"""What a search decides: strings proposed, strings evaluated, generations closed."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.ensemble import EnsembleResult
from agglom_mpi.search.proposals import Proposals


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
    result: EnsembleResult


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
