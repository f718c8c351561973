"""The objective that a user's Python function evaluates, of one number or of named quantities."""

import math
from collections.abc import Iterator, Mapping, Sequence
from keyword import iskeyword
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.declared import LATER, FieldError, FieldPath, Meaning, Reads
from agglom_mpi.declaration.units import is_si, quoted
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.outcome import SampleSummary, summaries
from agglom_mpi.search.criteria import Band, Criterion
from agglom_mpi.search.objectives.function_of_means import (
    MeansAccumulator,
    MeansBelow,
    ObjectiveOfMeans,
    OfMeans,
)
from agglom_mpi.search.objectives.objective import (
    MeanAccumulator,
    Objective,
    ObjectiveAccumulator,
    accumulated,
)
from agglom_mpi.statistics import Floats

MAX_QUANTITIES: Final = 30
"""Maximum number of quantities of a sample."""


class Quantities(NamedTuple):
    """Names of the numbers that a function returns of a sample, with their SI units.

    A file gives a mapping of names to units, or a list of names of pure numbers; the order does not
    matter.

    Attributes
    ----------
    units
        Name and unit of each, by name.
    """

    units: tuple[tuple[str, str], ...] = ()

    @classmethod
    def read(cls, value: Any) -> "Quantities":
        """Return the quantities of an entry of a file; raise a FieldError if it names none."""
        if isinstance(value, Quantities):
            return value
        if isinstance(value, list) and value and all(isinstance(name, str) for name in value):
            if twice := next((name for name in value if value.count(name) > 1), None):
                raise FieldError(((), f"names {quoted(twice)} twice"))
            value = dict.fromkeys(value, "1")
        if not isinstance(value, dict) or not value:
            message = "must be a mapping of names to SI units, such as {mass_loss: kg, spread: 1}"
            raise FieldError(((), f"is {quoted(value)}; {message}, or a list of names"))
        if len(value) > MAX_QUANTITIES:
            raise FieldError(((), f"has {len(value)} names; must be at most {MAX_QUANTITIES}"))
        units = {str(name): str(unit) for name, unit in value.items()}
        problems = [((name,), message) for name in units if (message := _no_unit(value, name))]
        if problems:
            raise FieldError(*problems)
        return cls.of_entries(units)

    @classmethod
    def of_entries(cls, entries: Mapping[str, str]) -> "Quantities":
        """Return quantities by their recorded units."""
        return cls(tuple(sorted(entries.items())))

    def entries(self) -> dict[str, str]:
        """Return the units by name."""
        return dict(self.units)


def _no_unit(entries: Mapping[Any, Any], name: str) -> str:
    """Return what is wrong with the unit of a quantity; empty if it is an SI unit."""
    unit = entries.get(name)
    if unit == 1 and not isinstance(unit, bool):  # written without quotes
        return ""
    must = "must be an SI unit without a factor, such as kg, m/s or 1"
    if not isinstance(unit, str):
        return f"is {quoted(unit)}; {must}"
    if not unit.strip():
        return f"is empty; {must}"
    try:
        if is_si(unit):
            return ""
    except ValueError as error:
        return f"is {quoted(unit)}: {error}; {must}"
    return f"is {quoted(unit)}; {must}: the function returns numbers in it"


class MeanOfFunction(Objective):
    """Mean over samples of a user's function, or a function of the means of what it returns.

    The values are stored with the samples, so that a replay of a function of one number needs no
    code of the user's; see `config.user_function`.

    Attributes
    ----------
    call
        The function, `module:function`, of `module.py` beside the campaign file.
    quantities
        Names and SI units of the numbers that the function returns as a mapping.
    of_means
        `module:function` of the same module, which makes the objective of their means.
    """

    least: ClassVar[float] = -math.inf
    scale: ClassVar[float] = 0.0  # unknown: the function may compare anything
    tolerance_limits: ClassVar[tuple[float, float]] = (-math.inf, math.inf)
    law: Literal["function"] = "function"
    example: ClassVar[str] = '{law: function, call: "growth:loss"}'
    call: Annotated[str, Meaning("module:function, of module.py beside the campaign file")]
    quantities: Annotated[Quantities | None, Reads(Quantities.read), LATER] = None
    of_means: Annotated[str | None, LATER] = None
    _function: OfMeans | None = None

    @classmethod
    def recorded(cls, entries: Mapping[str, Any]) -> Self:
        """Return the objective of entries that were checked when they were recorded."""
        if "quantities" in entries:
            entries = {**entries, "quantities": Quantities.of_entries(entries["quantities"])}
        return super().recorded(entries)

    @property
    def summary(self) -> str:
        """One line on the objective."""
        if not self.of_means:
            return f"mean over samples of {self.call}"
        units = self.quantity_units.items()
        listed = ", ".join(name if unit == "1" else f"{name} ({unit})" for name, unit in units)
        return f"{self.of_means} of the means over samples of {listed}, which {self.call} returns"

    @property
    def code(self) -> str:
        """The user's function, `module:function`."""
        return self.call

    @property
    def code_of_means(self) -> str:
        """The user's function of means, `module:function`; empty where there is none."""
        return self.of_means or ""

    @property
    def quantity_units(self) -> dict[str, str]:
        """SI units of the quantities, by name."""
        return {} if self.quantities is None else self.quantities.entries()

    def with_code(self, of_means: OfMeans | None) -> Self:
        """Return the objective with the user's function of means; None: it is not run here."""
        bound = self.model_copy()
        bound.__dict__["_function"] = of_means if self.of_means else None
        return bound

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield functions that are not `module:function`, and a key without the other."""
        must = "must be module:function, of module.py beside the campaign file"
        if not _is_call(self.call):
            yield ("call",), f"is {self.call!r}; {must}"
        if self.quantities is not None and self.of_means is None:
            message = "is missing; must name the function of the means of the quantities"
            yield ("of_means",), f"{message}, module:function as `call`"
        if self.of_means is None:
            return
        if self.quantities is None:
            message = "needs `quantities`, the names of what the function of `call` returns"
            yield ("of_means",), f"is {self.of_means!r}; {message}"
        elif not _is_call(self.of_means):
            yield ("of_means",), f"is {self.of_means!r}; {must}"
        elif self.of_means.partition(":")[0] != self.call.partition(":")[0]:
            message = f"must be a function of the same module as {self.call!r}"
            yield ("of_means",), f"is {self.of_means!r}; {message}"

    def criterion(self, tolerance: float) -> Criterion:
        """Return the criterion that the mean value, or the objective, is at most the tolerance."""
        if self.of_means:
            return MeansBelow(self._of_means(), tolerance)
        text = f"mean value of the function at most {tolerance:.4g}"
        return Band("objective", -math.inf, tolerance, text)

    @property
    def why_infinite(self) -> str:
        """Reason for an infinite objective of samples that completed."""
        if not self.of_means:
            return super().why_infinite
        return f"{self.of_means} raises, or is not finite, at the means of every string"

    def summaries(self, rows: NDArray[np.void]) -> list[SampleSummary]:
        """Return the summaries of samples with their quantities."""
        return summaries(rows, tuple(self.quantity_units))

    def accumulator(self) -> ObjectiveAccumulator:
        """Return an accumulator without samples."""
        return (
            self._means() if self.of_means else MeanAccumulator(lambda outcome: outcome.objective)
        )

    def of_samples(self, rows: NDArray[np.void]) -> Floats:
        """Return the stored value of each sample."""
        stored: Floats = rows["objective"]
        return stored

    def influence_values(self, outcomes: Sequence[SampleSummary]) -> Floats:
        """Return the stored values, or the objective plus the influence of each sample."""
        if not self.of_means:
            return np.array([outcome.objective for outcome in outcomes])
        return accumulated(self._means(), outcomes).influence_values(outcomes)

    def _means(self) -> MeansAccumulator:
        return MeansAccumulator(self._of_means())

    def _of_means(self) -> ObjectiveOfMeans:
        if self._function is None:
            message = f"the objective needs {self.of_means}, Python code that is not run here"
            raise CodeNotAllowedError(f"{message}; it runs only with --allow-code")
        return ObjectiveOfMeans(list(self.quantity_units), self._function)


def _is_call(text: str) -> bool:
    """Return whether a text has the form `module:function`."""
    words = text.split(":")
    return len(words) == 2 and all(word.isidentifier() and not iskeyword(word) for word in words)
