"""The objective of measured data: how far all samples of a string together are from them."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.measurements.census import Census
from agglom_mpi.measurements.datum import Datum, Predictions, predictions
from agglom_mpi.measurements.layout import CENSUS_COLUMNS, CensusLayout, census_names
from agglom_mpi.outcome import SampleSummary, summaries
from agglom_mpi.physics.impact_tests import ImpactTests
from agglom_mpi.search.criteria import Criterion, NoCriterionError
from agglom_mpi.search.objectives.objective import Objective, accumulated
from agglom_mpi.statistics import Floats

if TYPE_CHECKING:
    from agglom_mpi.measurements.misfit import Misfit

RULES: Final = ("fixed", "standard_error")
"""Stopping rules that need no objective of a sample alone."""


SampleCensus: TypeAlias = tuple[NDArray[np.generic], ...]
"""Values of the columns `CENSUS_COLUMNS` of a sample, of one experiment after the other."""


class MeasuredString(NamedTuple):
    """Measured data for the samples of a string, and the scales of their censuses.

    Attributes
    ----------
    data
        The measured data.
    layout
        Times and classes of the censuses.
    diameter
        Twice the mean radius b⁰ of the grains, m.
    density
        Of the grains, kg/m³.
    grains
        Number of grains that a sample begins with.
    impact_tests
        Laws that predict the coefficients of measured impacts; None where there are none.
    """

    data: tuple[Datum, ...]
    layout: CensusLayout
    diameter: float
    density: float
    grains: int
    impact_tests: ImpactTests | None = None

    def census(self, samples: Sequence[SampleCensus]) -> Census:
        """Return the censuses of n > 0 samples together."""
        columns = [np.array(each, np.float64) for each in zip(*samples, strict=True)]
        counts, masses, largest, temperatures = columns
        edges = self.diameter * self.layout.edges
        content = counts, masses, temperatures, largest
        tests = None if self.impact_tests is None else self.impact_tests.coefficients
        return Census(edges, *content, self.grains, self.density, tests, self.layout.times)


class MeasuredExperiments(NamedTuple):
    """The data of all experiments for the samples of a string.

    Attributes
    ----------
    strings
        What is known of each experiment, by its name, in the order of the file.
    """

    strings: Mapping[str, MeasuredString]

    @property
    def data(self) -> tuple[Datum, ...]:
        """The measured data of all experiments."""
        return tuple(datum for each in self.strings.values() for datum in each.data)

    def census(self, samples: Sequence[SampleCensus]) -> dict[str, Census]:
        """Return the censuses of n > 0 samples together."""
        size, found = len(CENSUS_COLUMNS), dict[str, Census]()
        for i, (name, string) in enumerate(self.strings.items()):
            found[name] = string.census([each[i * size : (i + 1) * size] for each in samples])
        return found


Measured: TypeAlias = MeasuredString | MeasuredExperiments


class MisfitOfData(Objective):
    """Misfit of the data of the section `data`: χ² over its rank, sampling noise removed.

    The sizes of all samples of a string are pooled. A sample alone has no objective.

    Attributes
    ----------
    string
        What the samples of a string are compared with; None where that is not known yet.
    """

    least: ClassVar[float] = -math.inf
    needs_data: ClassVar[bool] = True
    rules: ClassVar[tuple[str, ...] | None] = RULES
    symbol: ClassVar[str] = "χ²/rank"
    law: Literal["misfit"] = "misfit"
    _string: Measured | None = None

    @property
    def summary(self) -> str:
        """One line on the objective."""
        return "misfit of the measured data, χ² over its rank; about 1 where only errors differ"

    def of_string(self, string: Measured) -> Self:
        """Return the objective of the samples of a string."""
        bound = self.model_copy()
        bound.__dict__["_string"] = string
        return bound

    def criterion(self, tolerance: float) -> Criterion:
        """Refuse a feasible set: a posterior says which strings fit the data.

        Raises
        ------
        NoCriterionError
            Always.
        """
        raise NoCriterionError(
            f"the objective {self.name!r} has no feasible set; the posterior of the data says "
            "which strings fit them: agglom report --posterior"
        )

    def accumulator(self) -> "MisfitAccumulator":
        """Return an accumulator without samples."""
        return MisfitAccumulator(self._known)

    def of_samples(self, rows: NDArray[np.void]) -> Floats:
        """Return nan for each sample: alone it has no distribution."""
        return np.full(len(rows), math.nan)

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> Floats:
        """Return the jackknife's pseudo-values, moved and scaled to the stated value and error.

        Without a sample the sampling noise is larger, too, which is none of that sample's doing.
        """
        whole = self.misfit(outcomes)
        if len(outcomes) < 3 or not math.isfinite(whole.standard_error):
            return np.full(len(outcomes), whole.value)
        rest = [[*outcomes[:i], *outcomes[i + 1 :]] for i in range(len(outcomes))]
        away = -np.array([self.misfit(others).value for others in rest])
        away -= away.mean()
        spread = float(away.std(ddof=1)) / math.sqrt(len(away))
        return np.asarray(whole.value + away * (whole.standard_error / spread if spread else 0.0))

    def summaries(self, rows: NDArray[np.void]) -> list[SampleSummary]:
        """Return the summaries of samples with their censuses."""
        censuses = zip(*(rows[name] for name in census_names(rows.dtype.names)), strict=True)
        return [
            summary._replace(census=census)
            for summary, census in zip(summaries(rows), censuses, strict=True)
        ]

    def misfit(self, outcomes: Sequence[SampleSummary]) -> "Misfit":
        """Return the misfit of completed samples with all that is known of each datum."""
        return accumulated(self.accumulator(), outcomes).misfit

    def predictions(
        self, outcomes: Sequence[SampleSummary], data: Sequence[Datum] | None = None
    ) -> Predictions:
        """Return what completed samples predict for the values of data.

        Parameters
        ----------
        outcomes
        data
            Measured or not, at the times of the censuses; None: what was measured.
        """
        census = self._known.census([o.census for o in outcomes])
        return predictions(census, self.data if data is None else data)

    @property
    def data(self) -> tuple[Datum, ...]:
        """The data that samples are compared with."""
        return self._known.data

    @property
    def _known(self) -> Measured:
        if self._string is None:
            raise ValueError("the misfit of samples is known of a string of the campaign alone")
        return self._string


class MisfitAccumulator:
    """The censuses of the samples so far, and their misfit when it is asked for.

    Parameters
    ----------
    string
        What the samples are compared with.
    """

    def __init__(self, string: Measured) -> None:
        self._string = string
        self._censuses: list[SampleCensus] = []

    def add(self, outcome: SampleSummary) -> None:
        """Take one more completed sample."""
        assert outcome.census is not None
        self._censuses.append(outcome.census)
        self.__dict__.pop("misfit", None)

    @cached_property
    def misfit(self) -> "Misfit":
        """The misfit of the samples so far."""
        # SciPy is loaded where a misfit is asked for, and not wherever objectives are known.
        from agglom_mpi.measurements.misfit import misfit

        return misfit(self._string.census(self._censuses), self._string.data)

    @property
    def value(self) -> float:
        """The misfit; nan without samples."""
        return self.misfit.value if self._censuses else math.nan

    @property
    def standard_error(self) -> float:
        """Its standard error by the jackknife; nan below two samples, but 0 of impacts alone."""
        return self.misfit.standard_error if self._censuses else math.nan
