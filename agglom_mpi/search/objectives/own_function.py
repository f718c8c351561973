"""The objective that a user's Python function evaluates."""

import math
from collections.abc import Iterator, Sequence
from keyword import iskeyword
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.declared import FieldPath, Meaning
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.criteria import Band, Criterion
from agglom_mpi.search.objectives.objective import MeanAccumulator, Objective, ObjectiveAccumulator


def _stored_objective(outcome: SampleSummary) -> float:
    return outcome.objective


class MeanOfFunction(Objective):
    """Mean over samples of a user's function, evaluated when each was simulated.

    The values are stored with the samples, so that a replay needs no code of the user's; see
    `config.user_function`.

    Attributes
    ----------
    call
        `module:function`.
    """

    least: ClassVar[float] = -math.inf
    law: Literal["function"] = "function"
    call: Annotated[str, Meaning("module:function, of module.py beside the campaign file")]

    @property
    def summary(self) -> str:
        """One line on the objective."""
        return f"mean over samples of {self.call}"

    @property
    def code(self) -> str:
        """The user's function, `module:function`."""
        return self.call

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield a call that does not have the form `module:function`."""
        words = self.call.split(":")
        named = all(word.isidentifier() and not iskeyword(word) for word in words)
        if len(words) != 2 or not named:
            must = "must be module:function, of module.py beside the campaign file"
            yield ("call",), f"is {self.call!r}; {must}"

    @property
    def tolerance_limits(self) -> tuple[float, float]:
        """None: any value may be the largest one."""
        return -math.inf, math.inf

    def criterion(self, tolerance: float) -> Criterion:
        """Return the criterion that the mean value is at most the tolerance."""
        text = f"mean value of the function at most {tolerance:.4g}"
        return Band("objective", -math.inf, tolerance, text)

    @property
    def scale(self) -> float:
        """Unknown: the function may compare anything."""
        return 0.0

    def accumulator(self) -> ObjectiveAccumulator:
        """Return an accumulator without samples."""
        return MeanAccumulator(_stored_objective)

    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the stored value of each sample."""
        stored: NDArray[np.float64] = rows["objective"]
        return stored

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> NDArray[np.float64]:
        """Return the stored value of each sample."""
        return np.array([outcome.objective for outcome in outcomes])
