"""Base classes of the search methods: the declaration in a campaign file, and the running state.

A method is a subclass of `SearchMethod` in a module of this package: its numbers, its size, and
`build`, which returns the state that proposes strings and learns from them, a `RunningSearch`.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.components import Component, Whole
from agglom_mpi.declaration.declared import LATER, FieldPath
from agglom_mpi.declaration.given_values import EarlierCampaign, GivenStrings
from agglom_mpi.declaration.needed import needed
from agglom_mpi.formatting import pluralise
from agglom_mpi.search.proposals import Evaluations, Proposals, Ranked
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.statistics import Floats

DEFAULT_METHODS: Final = ("surrogate", "genetic")
"""Methods of a section `search` without the key `method`: the one that has most of its keys, the
first of several."""


class RunningSearch(Protocol):
    """A search that proposes strings and learns from their objectives, generation by generation."""

    @property
    def parents(self) -> int:
        """Number of best strings that the search keeps."""

    @property
    def population_ids(self) -> NDArray[np.int64]:
        """Numbers of the strings of the last evaluated population, in slot order."""

    def ask(self) -> Proposals:
        """Return the strings of the next generation; repeated calls return the same."""

    def known_proposals(self, generation: int) -> tuple[int, Proposals] | None:
        """Return those strings of a coming generation that no further result changes.

        Returns
        -------
        tuple or None
            Number of the first of them, and the strings, the last ones of the generation; None if
            there are none, or if they are not known yet.
        """

    def tell(self, evaluations: Evaluations) -> None:
        """Learn from the results of the strings proposed last."""

    def best(self, k: int) -> list[Ranked]:
        """Return the k best strings, best first."""

    def mean_of_top(self, k: int) -> float:
        """Return the mean objective of the k best strings."""

    def set_error(self) -> float:
        """Return the expected error of the set that is searched for; inf where there is none."""


class SearchInputs(NamedTuple):
    """Inputs of a search beside the numbers of its method.

    Attributes
    ----------
    space
        The search box.
    seed
        Seed of the campaign.
    given
        Strings to start with, in SI units, shape (n, k), n at most the first generation.
    magnitude
        Whether the objective is the magnitude of a signed mean; a model then fits the signed mean.
    background
        Whether long computations may run in a thread.
    coordinates
        Returns the coordinates in which strings, (n, k), are emulated.
    groups
        Number of groups of variables among the coordinates, the last ones.
    learned
        Results of strings of another campaign, also outside of the box; None: there are none.
    """

    space: SearchSpace
    seed: int
    given: Floats
    magnitude: bool = False
    background: bool = False
    coordinates: Callable[[Floats], Floats] = np.asarray
    groups: int = 0
    learned: Evaluations | None = None


class SearchMethod(Component):
    """Base class of the search methods.

    Attributes
    ----------
    start
        Strings to begin with: a list of them, or the best of an earlier campaign file,
        `{file: EARLIER.h5, strings: 6}`.
    lag
        Generation g is proposed from the results of generations up to g - lag.
    library
        Optional library that the method needs, of the extra `search`; None: none.
    ranks_by_model
        Whether strings are ranked by a model of all samples, not by their own objectives.
    """

    named_by: ClassVar[str] = "method"
    found_in: ClassVar[str] = "agglom_mpi.search.methods"
    lag: ClassVar[int] = 1
    library: ClassVar[str | None] = None
    ranks_by_model: ClassVar[bool] = False
    start: Annotated[GivenStrings | None, LATER] = None

    if TYPE_CHECKING:  # a field of most methods, which cannot hide an attribute of its base class

        @property
        def population(self) -> int:
            """Number of strings that the search ranks as its population."""

    @classmethod
    def as_mapping(cls, entry: Any) -> Any:
        """Return a section with its method."""
        if isinstance(entry, Mapping) and cls.named_by not in entry:
            methods = cls.components()

            def known(name: str) -> int:
                return len(methods[name].model_fields.keys() & entry.keys())

            return {cls.named_by: max(DEFAULT_METHODS, key=known), **entry}
        return entry

    @property
    @needed
    def first_generation(self) -> int:
        """Number of strings in the first generation."""
        raise NotImplementedError

    @needed
    def strings(self, generations: int) -> int:
        """Return the number of strings in `generations` generations."""
        raise NotImplementedError

    @needed
    def build(self, inputs: SearchInputs) -> RunningSearch:
        """Return the search before its first generation."""
        raise NotImplementedError

    @property
    def kept(self) -> int:
        """Number of best strings whose mean is shown, unless the target says otherwise."""
        return 1

    @property
    def has_parents(self) -> bool:
        """Whether the best strings are kept as parents, for whose places strings can race."""
        return False

    @property
    def ranks_itself(self) -> bool:
        """Whether strings are ranked otherwise than by their own objectives."""
        return self.ranks_by_model

    @property
    def added_samples(self) -> int | None:
        """Samples added to a kept parent in every generation; None: none."""
        return None

    def first_sample(self, string: int) -> int:
        """Return the number that `verbs.simulate` takes for sample 0 of a string."""
        return 0

    @property
    def favours_low_objectives(self) -> bool:
        """Whether strings are proposed near those whose objectives came out low."""
        return True

    @property
    def looks_for_a_set(self) -> bool:
        """Whether the set of strings that meet a target is searched, not the best string."""
        return False

    @property
    def earlier(self) -> EarlierCampaign | None:
        """The campaign with whose best strings the search begins; None: with no other's."""
        return self.start if isinstance(self.start, EarlierCampaign) else None

    @property
    def learns_from(self) -> str | None:
        """Name of the campaign file whose samples the search learns from; None: there is none."""
        return None

    @property
    def listed(self) -> list[dict[str, float]]:
        """Strings to begin with that the file lists: searched values by name in SI units."""
        return self.start if isinstance(self.start, list) else []

    @property
    def given(self) -> int:
        """Number of strings to begin with."""
        return len(self.listed) if self.earlier is None else self.earlier.strings

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield `start` if it gives more strings than the first generation has."""
        if self.given > self.first_generation:
            path: FieldPath = ("start",) if self.earlier is None else ("start", "strings")
            most = f"at most {self.first_generation}, those of the first generation"
            yield path, f"gives {pluralise(self.given, 'string')}; {most}"

    def describe(self) -> list[str]:
        """Return lines on the method and the strings it begins with."""
        lines = [f"search: {self.summary}", *self.details]
        if self.earlier is not None:
            lines.append(f"begins with: the best {self.given} of {self.earlier.file}")
        elif self.given:
            lines.append(f"begins with: {pluralise(self.given, 'given string')}")
        if self.learns_from is not None:
            lines.append(f"learns from: all samples of {self.learns_from}")
        return lines

    @property
    def details(self) -> list[str]:
        """Further lines of `agglom check` on the method."""
        return []


class PopulationMethod(SearchMethod):
    """Base class of methods whose generations all have the same size.

    Attributes
    ----------
    population
        Strings of each generation.
    """

    population: Annotated[int, Whole(at_least=1, at_most=10**5)] = 20

    @property
    def first_generation(self) -> int:
        """Number of strings in the first generation, the population."""
        return self.population

    def strings(self, generations: int) -> int:
        """Return the number of strings in `generations` generations."""
        return self.population * generations
