"""Criteria that end a campaign: each a key of the section `stopping`; a campaign ends by any.

A criterion is a subclass of `EndingCriterion` in a module of this package. `any_of`
makes one of several.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

import numpy as np

from agglom_mpi.declaration.components import Component, In, Whole
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.needed import needed
from agglom_mpi.search.methods.method import RunningSearch, SearchMethod
from agglom_mpi.search.objectives.objective import Objective


class EndingCriterion(Component):
    """Base class of the criteria.

    Attributes
    ----------
    key
        Its key in the section `stopping`; empty for a base class, and for what is composed. Where
        its only field has the same name, a file gives the value of that field alone.
    always_recorded
        Whether the identity of a campaign has an entry for it where a file does not give it; of
        criteria added after version 0.1.0 it has none.
    """

    found_in: ClassVar[str] = "agglom_mpi.search"
    may_be_own: ClassVar[bool] = False
    key: ClassVar[str] = ""
    always_recorded: ClassVar[bool] = False

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the key."""
        return (cls.key,) if cls.key and cls.in_files else ()

    @classmethod
    def _is_one_value(cls) -> bool:
        return list(cls.model_fields) == [cls.key]

    @classmethod
    def as_mapping(cls, entry: Any) -> Any:
        """Return the entry of a file as a mapping."""
        given = isinstance(entry, EndingCriterion)
        return {cls.key: entry} if cls._is_one_value() and not given else entry

    def entries(self) -> Any:
        """Return the fields as plain values, or the value of the only field."""
        entries = super().entries()
        return entries[self.key] if self._is_one_value() else entries

    @needed
    def holds(self, generations: int, search: RunningSearch) -> bool:
        """Return whether the campaign ends.

        Parameters
        ----------
        generations
            Number of generations that are evaluated.
        search
            Search that knows their results.
        """
        raise NotImplementedError

    def met(self, generations: int, search: RunningSearch) -> "EndingCriterion | None":
        """Return the criterion that ends the campaign; None if it goes on."""
        return self if self.holds(generations, search) else None

    def is_seen_in(self, generation: np.void) -> bool:
        """Return whether the row of the last generation in a campaign file shows that it holds."""
        return False

    @property
    def reached(self) -> str:
        """Statement that it holds, for the end of a run: the summary as a sentence."""
        return f"the {self.summary.replace(' at most ', ' is at most ')}"

    @property
    def best_strings(self) -> int | None:
        """Number of best strings of which it takes the mean; None if it takes none."""
        return None

    @property
    def max_generations(self) -> float:
        """Number of generations after which it holds in any case; inf if there is none."""
        return math.inf

    def misfits(
        self, search: SearchMethod | None, objective: Objective | None
    ) -> Iterator[tuple[FieldPath, str]]:
        """Yield fields that do not fit other sections, which are None where they are invalid."""
        yield from ()


class MeanOfBest(EndingCriterion):
    """The mean objective of the best `top` strings is at most `objective` [A 26].

    Attributes
    ----------
    top
        Number of best strings.
    objective
        Mean objective of these at which the search has succeeded.
    """

    key: ClassVar[str] = "target"
    example: ClassVar[str] = "{top: 6, objective: 5e-4}"
    always_recorded: ClassVar[bool] = True
    top: Annotated[int, Whole(at_least=1, meaning="a number of strings")]
    objective: Annotated[float, In("1", meaning="like 5e-4")]

    def holds(self, generations: int, search: RunningSearch) -> bool:
        """Return whether the mean is low enough."""
        return search.mean_of_top(self.top) <= self.objective

    def is_seen_in(self, generation: np.void) -> bool:
        """Return whether the stored mean is low enough."""
        return bool(generation["mean_of_top"] <= self.objective)

    @property
    def summary(self) -> str:
        """One line on the criterion."""
        return f"mean objective of the best {self.top} at most {self.objective:g}"

    @property
    def best_strings(self) -> int:
        """Number of best strings of which it takes the mean."""
        return self.top

    def misfits(
        self, search: SearchMethod | None, objective: Objective | None
    ) -> Iterator[tuple[FieldPath, str]]:
        """Yield more strings than a population has, and an objective that none can have."""
        if search is not None and self.top > search.population:
            most = f"must be at most the population, {search.population}"
            yield ("top",), f"is {self.top}; {most}"
        if objective is not None and self.objective < 0.0 <= objective.least:
            yield ("objective",), f"is {self.objective:g}; must be at least 0"


class ExpectedError(EndingCriterion):
    """The expected error of the set that the search looks for is small enough.

    Attributes
    ----------
    expected_error
        Expected volume that is wrongly in or out of the set, over that of the set.
    """

    key: ClassVar[str] = "expected_error"
    example: ClassVar[str] = "0.05"
    expected_error: Annotated[float, In("1", above=0, below=1)]

    def holds(self, generations: int, search: RunningSearch) -> bool:
        """Return whether the expected error is small enough."""
        return search.set_error() <= self.expected_error

    @property
    def summary(self) -> str:
        """One line on the criterion."""
        return f"expected error of the set at most {self.expected_error:g}"

    def misfits(
        self, search: SearchMethod | None, objective: Objective | None
    ) -> Iterator[tuple[FieldPath, str]]:
        """Yield the criterion itself where no set is searched for."""
        if search is not None and not search.looks_for_a_set:
            yield (), "is that of a set; needs search {method: surrogate, aim: set}"


class Generations(EndingCriterion):
    """So many generations are evaluated; every campaign has this limit."""

    generations: Annotated[int, Whole(at_least=1)]

    def holds(self, generations: int, search: RunningSearch) -> bool:
        """Return whether all generations are evaluated."""
        return generations >= self.generations

    @property
    def reached(self) -> str:
        """Statement that it holds."""
        count = self.generations
        return "the 1 generation is done" if count == 1 else f"all {count} generations are done"

    @property
    def max_generations(self) -> float:
        """Number of generations."""
        return self.generations


class AnyOf(EndingCriterion):
    """At least one of several criteria holds."""

    parts: tuple[EndingCriterion, ...]

    def holds(self, generations: int, search: RunningSearch) -> bool:
        """Return whether one holds; those after it are not evaluated."""
        return self.met(generations, search) is not None

    def met(self, generations: int, search: RunningSearch) -> EndingCriterion | None:
        """Return the first criterion that holds."""
        found = (part.met(generations, search) for part in self.parts)
        return next((part for part in found if part is not None), None)

    @property
    def reached(self) -> str:
        """Statement that it holds."""
        return " or ".join(part.reached for part in self.parts)

    @property
    def best_strings(self) -> int | None:
        """That of the first criterion that takes a mean."""
        counts = (part.best_strings for part in self.parts)
        return next((count for count in counts if count is not None), None)

    @property
    def max_generations(self) -> float:
        """The smallest one of its parts."""
        return min((part.max_generations for part in self.parts), default=math.inf)


def any_of(*criteria: EndingCriterion) -> EndingCriterion:
    """Return the criterion that at least one of several holds, evaluated in this order."""
    return criteria[0] if len(criteria) == 1 else AnyOf(parts=criteria)
