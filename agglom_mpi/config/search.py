"""The `search` section: how strings are proposed."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from agglom_mpi.config.bounds import read_named
from agglom_mpi.config.units import Number, shown
from agglom_mpi.config.validation import (
    LATER,
    FieldError,
    Line,
    Section,
    WholeNumber,
    raise_field_errors,
)
from agglom_mpi.config.yaml_source import Path
from agglom_mpi.search.baselines import NO_STRINGS, RandomSearch, SobolSearch
from agglom_mpi.search.genetic import GeneticSearch
from agglom_mpi.search.proposals import SearchMethod
from agglom_mpi.search.space import SearchSpace


class EarlierCampaign(Section):
    """The best strings of a campaign file, by re-estimates first where it has some."""

    file: Annotated[Line, Field(min_length=1, description="a campaign file")]
    strings: Annotated[WholeNumber, Field(ge=1, le=10**5)] = 1


def _read_strings(value: Any) -> Any:
    """Values by name in SI units, of each string of a list; a mapping is an `EarlierCampaign`."""
    if isinstance(value, dict):
        return EarlierCampaign.model_validate(value)
    if not isinstance(value, list) or not value:
        raise ValueError(
            f"is {shown(value)}; must be a list of strings like {{density: 6000}}, or "
            "{file: EARLIER.h5, strings: 6}"
        )
    problems: list[tuple[Path, str]] = []
    strings = [dict(_read_string(string, (i,), problems)) for i, string in enumerate(value)]
    raise_field_errors(problems)
    return strings


def _read_string(string: Any, path: Path, problems: list[tuple[Path, str]]) -> Any:
    if not isinstance(string, dict):
        problems.append((path, f"is {shown(string)}; must be a mapping like {{density: 6000}}"))
        return
    for name, value in string.items():
        try:
            yield name, read_named(str(name), value)
        except ValueError as error:
            problems.append(((*path, str(name)), str(error)))


GivenStrings = Annotated[list[dict[str, float]] | EarlierCampaign, BeforeValidator(_read_strings)]
"""Strings to begin with: values of searched variables, or the best of another campaign."""


class SearchInputs(NamedTuple):
    """What a search is built from, beside its section.

    Attributes
    ----------
    space
        The box to search.
    seed
        Seed of the campaign.
    given
        Strings to begin with, shape (n, 10).
    magnitude
        Whether the objective is the magnitude of a signed mean, which a model then is of.
    background
        Whether long computations may run in a thread.
    """

    space: SearchSpace
    seed: int
    given: NDArray[np.float64] = NO_STRINGS
    magnitude: bool = False
    background: bool = False


class SearchSection(Section):
    """What all methods have.

    Attributes
    ----------
    lag
        A generation learns from the results of all that come so many before it, or earlier.
    """

    lag: ClassVar[int] = 1
    library: ClassVar[str | None] = None
    start: Annotated[GivenStrings | None, LATER] = None

    @property
    def first_generation(self) -> int:
        """Strings of the first generation."""
        raise NotImplementedError

    @property
    def kept(self) -> int:
        """Strings in the mean of the best, unless the campaign's target says otherwise."""
        return 1

    @property
    def given(self) -> int:
        """How many strings to begin with are given."""
        if self.start is None:
            return 0
        return self.start.strings if isinstance(self.start, EarlierCampaign) else len(self.start)

    @model_validator(mode="after")
    def _given_strings_fit(self) -> Self:
        if self.given > self.first_generation:
            path = ("start", "strings") if isinstance(self.start, EarlierCampaign) else ("start",)
            most = f"at most {self.first_generation}, those of the first generation"
            raise FieldError((path, f"gives {self.given} strings; {most}"))
        return self

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search, which has learned nothing yet."""
        raise NotImplementedError


class _Populated(SearchSection):
    """Methods whose generations are all as large."""

    population: Annotated[WholeNumber, Field(ge=1, le=10**5)] = 20

    @property
    def first_generation(self) -> int:
        """The population."""
        return self.population

    def strings(self, generations: int) -> int:
        """Count the strings of so many generations."""
        return self.population * generations


class Rescale(Section):
    """Every so many generations, shrink the search box around the best string by a factor."""

    every: Annotated[WholeNumber, Field(ge=1, description="a number of generations")]
    factor: Annotated[Number, Field(gt=0, lt=1, description="between 0 and 1")]


class Genetic(_Populated):
    """The genetic algorithm [A 22] [B section 7]."""

    method: Literal["genetic"] = "genetic"
    population: Annotated[WholeNumber, Field(ge=4, le=10**5)] = 20
    parents: Annotated[WholeNumber, Field(ge=2, multiple_of=2)] = 6
    blend: tuple[Number, Number] = (0.0, 1.0)
    more_samples: Annotated[Annotated[WholeNumber, Field(ge=1, le=10**6)] | None, LATER] = None
    rescale: Annotated[
        Rescale | None, BeforeValidator(lambda value: None if value == "none" else value)
    ] = None

    @property
    def kept(self) -> int:
        """The parents."""
        return self.parents

    def strings(self, generations: int) -> int:
        """Count q + (g - 1)(q - p) strings [A 22]; parents that get more samples anew."""
        if self.more_samples is not None:
            return self.population * generations
        return self.population + (generations - 1) * (self.population - self.parents)

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search, which has learned nothing yet."""
        space, seed, given, _, _ = inputs
        rescale = None if self.rescale is None else (self.rescale.every, self.rescale.factor)
        again = self.more_samples is not None
        return GeneticSearch(
            space, seed, self.population, self.parents, self.blend, rescale, given, again
        )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems: list[tuple[Path, str]] = []
        if 2 * self.parents > self.population:
            message = (
                f"is {self.parents}; parents and as many offspring must fit into the population "
                f"of {self.population}, so at most {self.population // 4 * 2}"
            )
            problems.append((("parents",), message))
        lower, upper = self.blend
        if lower >= upper:
            message = f"is [{lower:g}, {upper:g}]; the lower end must be less than the upper"
            problems.append((("blend",), message))
        raise_field_errors(problems)
        return self


class Surrogate(SearchSection):
    """A Gaussian process through all samples so far, batches by Thompson sampling."""

    lag: ClassVar[int] = 2
    library: ClassVar[str | None] = "threadpoolctl"
    method: Literal["surrogate"]
    initial: Annotated[WholeNumber, Field(ge=8, le=10**4)] = 48
    batch: Annotated[WholeNumber, Field(ge=2, le=10**4)] = 24

    @property
    def population(self) -> int:
        """A batch, or as many as there are when the first generation is done."""
        return min(self.batch, self.first_generation)

    @property
    def first_generation(self) -> int:
        """Half of the strings that come before the first that a model proposes."""
        return (self.initial + 1) // 2

    def strings(self, generations: int) -> int:
        """Count two generations of Sobol points, and those of a model."""
        if generations == 1:
            return self.first_generation
        return self.initial + (generations - 2) * self.batch

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search, which has learned nothing yet."""
        from agglom_mpi.search.surrogate import SurrogateSearch

        space, seed, given, magnitude, background = inputs
        return SurrogateSearch(space, seed, self.initial, self.batch, given, magnitude, background)


class Evolution(_Populated):
    """The covariance matrix adaptation evolution strategy."""

    library: ClassVar[str | None] = "cmaes"
    method: Literal["cmaes"]
    population: Annotated[WholeNumber, Field(ge=4, le=10**5)] = 20
    sigma: Annotated[Number, Field(gt=0, le=1, description="a share of the box")] = 0.3

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search, which has learned nothing yet."""
        from agglom_mpi.search.cmaes_search import CmaesSearch

        space, seed, given, _, _ = inputs
        return CmaesSearch(space, seed, self.population, self.sigma, given)


class Sampled(_Populated):
    """Points that learn nothing, as a baseline."""

    method: Literal["random", "sobol"]

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search, which has learned nothing yet."""
        space, seed, given, _, _ = inputs
        search = RandomSearch if self.method == "random" else SobolSearch
        return search(space, seed, self.population, given)


def _with_method(value: Any) -> Any:
    if isinstance(value, Mapping) and "method" not in value:
        return {"method": "genetic", **value}
    return value


Search = Genetic | Surrogate | Evolution | Sampled
AnySearch = Annotated[Search, Field(discriminator="method"), BeforeValidator(_with_method)]
