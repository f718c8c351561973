"""What every objective can do, whatever of the samples it looks at."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.running import RunningMean
from agglom_mpi.simulation.outcome import Measured, measured


class Tally(Protocol):
    """The completed samples of one string so far, as an objective sees them."""

    def add(self, outcome: Measured) -> None:
        """Take one more completed sample."""

    @property
    def value(self) -> float:
        """Objective of the samples so far, smaller is better; nan if there are none."""

    @property
    def standard_error(self) -> float:
        """Of the value, by the delta method; nan below two samples."""


class Objective(ABC):
    """A law that turns the completed samples of a string into a number to minimise.

    Attributes
    ----------
    least : float
        No objective is less.
    """

    least: ClassVar[float] = 0.0

    @abstractmethod
    def tally(self) -> Tally:
        """Return a tally of no samples."""

    @abstractmethod
    def of_samples(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the objective of each sample alone, shape (n,), of rows with `OUTCOME`'s columns.

        What it gives for a sample that failed means nothing.
        """

    @abstractmethod
    def linear(self, outcomes: Sequence[Measured]) -> NDArray[np.float64]:
        """Return a number of each sample, shape (n,): together they are the ensemble's objective.

        Their mean is the objective, signed where it is a magnitude; the standard error of that
        mean is the objective's, by the delta method. n must be at least 1.
        """

    def of_ensemble(self, outcomes: Iterable[Measured]) -> tuple[float, float]:
        """Return the objective of completed samples and its standard error.

        The error of a single one is nan, and an empty ensemble is worth inf.
        """
        tally = self.tally()
        for outcome in outcomes:
            tally.add(outcome)
        value = tally.value
        return (math.inf, math.nan) if math.isnan(value) else (value, tally.standard_error)

    def of_rows(self, rows: NDArray[np.void]) -> tuple[float, float]:
        """Return the same of rows, (n,), of completed samples; see `outcome.measured`."""
        return self.of_ensemble(measured(rows))


class MeanTally:
    """The running mean of one number of each sample.

    Parameters
    ----------
    number
        Of a sample.
    """

    def __init__(self, number: Callable[[Measured], float]) -> None:
        self._number = number
        self._mean = RunningMean()

    def add(self, outcome: Measured) -> None:
        """Take one more completed sample."""
        self._mean.add(self._number(outcome))

    @property
    def value(self) -> float:
        """The mean."""
        return self._mean.mean

    @property
    def standard_error(self) -> float:
        """Standard error of the mean."""
        return self._mean.standard_error
