"""The `search` section: how strings are proposed."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from agglom_mpi.config.bounds import read_variable
from agglom_mpi.declaration.sections import (
    LATER,
    FieldError,
    FieldPath,
    Line,
    Section,
    WholeNumber,
    raise_field_errors,
)
from agglom_mpi.declaration.units import Number, quoted
from agglom_mpi.formatting import pluralise
from agglom_mpi.search.baselines import NO_STRINGS, RandomSearch, SobolSearch
from agglom_mpi.search.genetic import GeneticSearch
from agglom_mpi.search.proposals import SearchMethod
from agglom_mpi.search.space import SearchSpace


class EarlierCampaign(Section):
    """The best strings of a campaign file, ranked by re-estimates where it has some.

    The name of the file is relative to the folder of the campaign that begins with them.
    """

    file: Annotated[Line, Field(min_length=1, description="a campaign file")]
    strings: Annotated[WholeNumber, Field(ge=1, le=10**5)] = 1


def _read_strings(value: Any) -> Any:
    """Return a list of strings, values by name in SI units, or an `EarlierCampaign`."""
    if isinstance(value, dict):
        return EarlierCampaign.model_validate(value)
    if not isinstance(value, list) or not value:
        raise ValueError(
            f"is {quoted(value)}; must be a list of strings like {{density: 6000}}, or "
            "{file: EARLIER.h5, strings: 6}"
        )
    problems: list[tuple[FieldPath, str]] = []
    strings = [dict(_read_string(string, (i,), problems)) for i, string in enumerate(value)]
    raise_field_errors(problems)
    return strings


def _read_string(string: Any, path: FieldPath, problems: list[tuple[FieldPath, str]]) -> Any:
    if not isinstance(string, dict):
        problems.append((path, f"is {quoted(string)}; must be a mapping like {{density: 6000}}"))
        return
    for name, value in string.items():
        try:
            yield read_variable(str(name), value)
        except ValueError as error:
            problems.append(((*path, str(name)), str(error)))


GivenStrings = Annotated[list[dict[str, float]] | EarlierCampaign, BeforeValidator(_read_strings)]
"""Strings to start with: values of searched variables, or the best of another campaign."""


class SearchInputs(NamedTuple):
    """What a search method is built from, beside its section.

    Attributes
    ----------
    space
        The search box.
    seed
        Seed of the campaign.
    given
        Strings to start with, in SI units, shape (n, 10).
    magnitude
        Whether the objective is the magnitude of a signed mean; a model then fits the signed mean.
    background
        Whether long computations may run in a thread.
    coordinates
        Returns the coordinates in which strings, (n, 10), are emulated.
    groups
        How many of them, the last ones, are groups of variables.
    """

    space: SearchSpace
    seed: int
    given: NDArray[np.float64] = NO_STRINGS
    magnitude: bool = False
    background: bool = False
    coordinates: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.asarray
    groups: int = 0


class SearchSection(Section):
    """Base of the search methods.

    Attributes
    ----------
    lag
        Generation g is proposed from the results of generations up to g - lag.
    library
        Optional library that the method needs, of the extra `search`; None: none.
    """

    lag: ClassVar[int] = 1
    library: ClassVar[str | None] = None
    start: Annotated[GivenStrings | None, LATER] = None

    @property
    def first_generation(self) -> int:
        """Number of strings in the first generation."""
        raise NotImplementedError

    @property
    def kept(self) -> int:
        """Number of best strings whose mean is shown, unless the target says otherwise."""
        return 1

    @property
    def favours_low_objectives(self) -> bool:
        """Whether strings are proposed near those whose objectives came out low."""
        return True

    @property
    def given(self) -> int:
        """Number of strings to start with."""
        if self.start is None:
            return 0
        return self.start.strings if isinstance(self.start, EarlierCampaign) else len(self.start)

    @model_validator(mode="after")
    def _given_strings_fit(self) -> Self:
        if self.given > self.first_generation:
            path = ("start", "strings") if isinstance(self.start, EarlierCampaign) else ("start",)
            most = f"at most {self.first_generation}, those of the first generation"
            raise FieldError((path, f"gives {pluralise(self.given, 'string')}; {most}"))
        return self

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search method before its first generation."""
        raise NotImplementedError

    def summary(self) -> list[str]:
        """Return lines on the method and the strings it starts with."""
        lines = [f"search: {line}" if i == 0 else line for i, line in enumerate(self._summary())]
        if isinstance(self.start, EarlierCampaign):
            lines.append(f"begins with: the best {self.given} of {self.start.file}")
        elif self.start is not None:
            lines.append(f"begins with: {pluralise(self.given, 'given string')}")
        return lines

    def _summary(self) -> list[str]:
        raise NotImplementedError


class _PopulationSearch(SearchSection):
    """Base of methods whose generations all have the same size."""

    population: Annotated[WholeNumber, Field(ge=1, le=10**5)] = 20

    @property
    def first_generation(self) -> int:
        """Number of strings in the first generation, the population."""
        return self.population

    def strings(self, generations: int) -> int:
        """Return the number of strings in `generations` generations."""
        return self.population * generations


class Rescale(Section):
    """Shrink the search box around the best string by `factor` every `every` generations."""

    every: Annotated[WholeNumber, Field(ge=1, description="a number of generations")]
    factor: Annotated[Number, Field(gt=0, lt=1, description="between 0 and 1")]


class Genetic(_PopulationSearch):
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
        """Number of parents."""
        return self.parents

    def strings(self, generations: int) -> int:
        """Return q + (g - 1)(q - p) [A 22], or g q if parents are sampled again."""
        if self.more_samples is not None:
            return self.population * generations
        return self.population + (generations - 1) * (self.population - self.parents)

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search method before its first generation."""
        space, seed, given, *_ = inputs
        rescale = None if self.rescale is None else (self.rescale.every, self.rescale.factor)
        again = self.more_samples is not None
        return GeneticSearch(
            space, seed, self.population, self.parents, self.blend, rescale, given, again
        )

    def _summary(self) -> list[str]:
        lines = [
            f"genetic, population {self.population}, parents {self.parents}, "
            f"blend {self.blend[0]:g} to {self.blend[1]:g} [A 22]"
        ]
        if self.more_samples is not None:
            more = pluralise(self.more_samples, "more sample")
            lines.append(f"parents: each gets {more} in every generation")
        if self.rescale is not None:
            shrunk = f"every {pluralise(self.rescale.every, 'generation')} shrunk"
            lines.append(f"search box: {shrunk} by {self.rescale.factor:g} around the best")
        return lines

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems: list[tuple[FieldPath, str]] = []
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


SET_TOLERANCE = 0.05
"""Tolerance of the set that a search looks for unless it says otherwise, as of its report."""


class Surrogate(SearchSection):
    """A Gaussian process through all samples so far, batches by Thompson sampling."""

    lag: ClassVar[int] = 2
    library: ClassVar[str | None] = "threadpoolctl"
    method: Literal["surrogate"]
    initial: Annotated[WholeNumber, Field(ge=8, le=10**4)] = 48
    batch: Annotated[WholeNumber, Field(ge=2, le=10**4)] = 24
    aim: Annotated[Literal["best", "set"], LATER] = "best"
    tolerance: Annotated[Annotated[Number, Field(gt=0, lt=1)] | None, LATER] = None

    @property
    def population(self) -> int:
        """Size of a batch, at most the first generation."""
        return min(self.batch, self.first_generation)

    @property
    def favours_low_objectives(self) -> bool:
        """Whether the search looks for the best string."""
        return self.aim == "best"

    @property
    def first_generation(self) -> int:
        """Half of the `initial` strings, rounded up."""
        return (self.initial + 1) // 2

    def strings(self, generations: int) -> int:
        """Return the number of strings: two generations of Sobol points, then batches."""
        if generations == 1:
            return self.first_generation
        return self.initial + (generations - 2) * self.batch

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search method before its first generation."""
        from agglom_mpi.search.surrogate import SurrogateSearch

        space, seed, given, magnitude, background, coordinates, groups = inputs
        aim = None
        if self.aim == "set":
            from agglom_mpi.search.set_aim import SetAim

            aim = SetAim(self.tolerance or SET_TOLERANCE, coordinates, groups)
        return SurrogateSearch(
            space, seed, self.initial, self.batch, given, magnitude, background, aim
        )

    @model_validator(mode="after")
    def _tolerance_is_of_a_set(self) -> Self:
        if self.tolerance is not None and self.aim != "set":
            raise FieldError((("tolerance",), "is that of a set; give aim: set, or leave it out"))
        return self

    def _summary(self) -> list[str]:
        return [
            f"Gaussian process through all samples, {self.initial} Sobol points first, then "
            f"batches of {self.batch} {self._batches}"
        ]

    @property
    def _batches(self) -> str:
        if self.aim == "best":
            return "by Thompson sampling"
        tolerance = self.tolerance or SET_TOLERANCE
        return (
            "half even around the target, half where it is unsure which strings are within "
            f"{tolerance:g} of it"
        )


class Cmaes(_PopulationSearch):
    """Covariance matrix adaptation evolution strategy (CMA-ES)."""

    library: ClassVar[str | None] = "cmaes"
    method: Literal["cmaes"]
    population: Annotated[WholeNumber, Field(ge=4, le=10**5)] = 20
    sigma: Annotated[Number, Field(gt=0, le=1, description="a share of the box")] = 0.3

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search method before its first generation."""
        from agglom_mpi.search.cmaes_search import CmaesSearch

        space, seed, given, *_ = inputs
        return CmaesSearch(space, seed, self.population, self.sigma, given)

    def _summary(self) -> list[str]:
        deviation = f"first standard deviation {self.sigma:g} of the box"
        return [f"CMA-ES, population {self.population}, {deviation}"]


class Baseline(_PopulationSearch):
    """Baselines: random or Sobol points, independent of all results."""

    method: Literal["random", "sobol"]

    @property
    def favours_low_objectives(self) -> bool:
        """Proposals depend on no result."""
        return False

    def build(self, inputs: SearchInputs) -> SearchMethod:
        """Return the search method before its first generation."""
        space, seed, given, *_ = inputs
        search = RandomSearch if self.method == "random" else SobolSearch
        return search(space, seed, self.population, given)

    def _summary(self) -> list[str]:
        kind = "independent random points" if self.method == "random" else "a Sobol sequence"
        return [f"{kind}, {self.population} in a generation; nothing is learnt"]


def _with_default_method(value: Any) -> Any:
    if isinstance(value, Mapping) and "method" not in value:
        return {"method": "genetic", **value}
    return value


Search = Genetic | Surrogate | Cmaes | Baseline
AnySearch = Annotated[Search, Field(discriminator="method"), BeforeValidator(_with_default_method)]
