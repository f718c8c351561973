"""A search of one's own loop: it proposes strings, and any simulator judges them.

The search methods and the criteria that end a campaign are those of a run, built by the same
functions; ensembles, stopping rules and racing are left out, for whoever judges a string decides
how many samples it takes.
"""

import math
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.inversion import own_sections, search_of
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.formatting import pluralise
from agglom_mpi.public_face import PublicFace
from agglom_mpi.search.ending import EndingCriterion
from agglom_mpi.search.proposals import ORIGINS, Evaluations, Proposals
from agglom_mpi.variables import VOLUME_FRACTION

Floats = npt.NDArray[np.float64]

LEAST_ERROR: Final = 0.01
"""Minimum error by which a value is weighed, relative to the largest one; where no grain grows the
error is 0."""
MAX_VALUE: Final = 1e100
"""Maximum magnitude of a value: squares of larger ones are infinite in a model."""


class ProposedStrings(dict[str, npt.NDArray[Any]]):
    """Strings of a generation as a table by names, which `Searcher.ask` returns.

    Columns, each of shape (n,): `string`, the number of each; `origin`, such as `random` or
    `offspring`; and all variables that the scene uses, named as in the campaign, in SI units.
    `pandas.DataFrame(strings)` makes a DataFrame of it, and `campaign.simulate_many(strings)` takes
    it as it is.

    Attributes
    ----------
    generation : int
        Number of the generation.
    parameters : array, shape (n, k)
        The same strings as arrays, as `campaign.simulate_many` takes them.
    units : dict
        SI unit of each variable.
    """

    def __init__(self, campaign: Campaign, proposals: Proposals, first: int) -> None:
        table = campaign.variables
        columns = campaign.variables.used_columns(proposals.parameters)
        super().__init__(
            string=np.arange(first, first + len(proposals.parameters)),
            origin=np.array([ORIGINS[code] for code in proposals.origin]),
            **columns,
        )
        self.generation = proposals.generation
        self.parameters = proposals.parameters.copy()
        self.units = {
            name: VOLUME_FRACTION.unit if name == VOLUME_FRACTION.name else table[name].unit
            for name in columns
        }
        self._searched = [each.name for each in campaign.variables.own]

    def __repr__(self) -> str:
        numbers = self["string"]
        which = f"{numbers[0]} to {numbers[-1]}" if len(numbers) else "none"
        return (
            f"<ProposedStrings: generation {self.generation}, {pluralise(len(numbers), 'string')} "
            f"({which}) of {', '.join(self._searched)}>"
        )


class JudgedString(NamedTuple):
    """The best string of a search.

    Attributes
    ----------
    string
        Its number.
    value, error
        Objective by which the search ranks it, and its standard error, nan if unknown. Of a search
        by a model they are the model's.
    parameters
        Variables that the scene uses, named as in the campaign, in SI units.
    """

    string: int
    value: float
    error: float
    parameters: dict[str, float]


class Searcher(metaclass=PublicFace):
    """The search of a campaign, in a loop of your own; `campaign.searcher()` returns it.

    `ask` returns the strings of the next generation, `tell` takes what any simulator or experiment
    makes of them.

    Attributes
    ----------
    generation : int
        Number of generations that are judged.

    Examples
    --------
    >>> import agglom_mpi
    >>> campaign = agglom_mpi.load_campaign("jobs/quickstart.yaml")
    >>> searcher = campaign.searcher()
    >>> while not searcher.is_finished:
    ...     strings = searcher.ask()
    ...     found = campaign.simulate_many(strings, samples=5)
    ...     searcher.tell(found.mean_radius_ratio.mean(axis=1) / 2 - 1)
    >>> searcher.generation, searcher.best.value < 0.2
    (6, True)
    """

    def __init__(
        self, campaign: Campaign, given: Floats, learned: Evaluations | None = None
    ) -> None:
        self._campaign = campaign
        self._is_magnitude = campaign.objective.is_magnitude
        self._own = ", ".join(own_sections(campaign))
        with self._users_code():
            self._search = search_of(campaign, given, learned=learned)
        self._ending = campaign.stopping.ending
        self._ended_by: EndingCriterion | None = None
        self._strings: list[Floats] = []
        self._errors: list[float] = []
        self._largest_error = math.nan
        self.generation = 0

    def __repr__(self) -> str:
        if self.is_finished:
            state = f"finished, {self.why_finished}"
        else:
            state = f"{pluralise(self.generation, 'generation')} judged"
        best = f"; best {self.best.value:.4g}" if self.generation else ""
        method = self._campaign.search.name
        return f"<Searcher of {self._campaign.name!r} by {method}: {state}{best}>"

    @property
    def is_finished(self) -> bool:
        """Whether a criterion of the campaign's section `stopping` is met."""
        return self._ended_by is not None

    @property
    def why_finished(self) -> str:
        """The criterion that is met, in words; empty while the search goes on."""
        return "" if self._ended_by is None else self._ended_by.reached

    @property
    def best(self) -> JudgedString:
        """The best string so far: number, value, error and parameters.

        Raises
        ------
        CampaignError
            Before the first generation is judged.
        """
        if not self.generation:
            raise self._error("best", "is unknown; tell the values of the first generation")
        with self._users_code():
            [ranked] = self._search.best(1)
        error = self._errors[ranked.string]
        if ranked.standard_error is not None:
            error = ranked.standard_error
        columns = self._campaign.variables.used_columns(self._strings[ranked.string][None])
        parameters = {name: float(values[0]) for name, values in columns.items()}
        return JudgedString(ranked.string, ranked.objective, error, parameters)

    def ask(self) -> ProposedStrings:
        """Return the strings of the next generation; the same until their values are told.

        Returns
        -------
        ProposedStrings
            Columns by name. A string of origin `again` was judged before, and is to be judged by
            more samples: its value is that of all samples together.

        Raises
        ------
        CampaignError
            If the search is finished.
        """
        return ProposedStrings(self._campaign, self._proposals(), len(self._strings))

    def tell(
        self,
        values: npt.ArrayLike,
        errors: npt.ArrayLike | None = None,
        samples: npt.ArrayLike | None = None,
    ) -> None:
        """Take the values of the strings that `ask` returned, in their order.

        Parameters
        ----------
        values
            What is minimised, shape (n,); nan, inf or masked where a string could not be judged,
            which then ranks last. A pandas Series is ordered by its index, the numbers of the
            strings or 0 to n-1. Where the campaign's objective is the magnitude of a deviation, as
            for `growth_target`, give the deviation with its sign if you know it: the magnitude is
            minimised, and a model learns faster from the sign.
        errors
            Standard errors of the values, shape (n,) or one for all. A model weighs values by
            them, relative to the largest error of the first generation; less than 1 % of that
            counts as 1 %.
        samples
            Number of samples behind each value, shape (n,) or one for all; by default it follows
            from the errors, or is 1. A model takes the variance of a value to be inversely
            proportional to it.

        Raises
        ------
        CampaignError
            If there are more or fewer values than strings, or an error or a number of samples is
            impossible.
        """
        proposals = self._proposals()
        told = self._read("values", values, len(proposals.parameters), one_for_all=False)
        judged, error = np.isfinite(told), np.full(len(told), np.nan)
        if (large := told[judged & (np.abs(told) > MAX_VALUE)]).size:
            raise self._error("values", f"is {large[0]:g}; must be within ±{MAX_VALUE:g}, or inf")
        if errors is not None:
            error = self._read("errors", errors, len(told))
            self._check("errors", error[judged], error[judged] >= 0.0)
        weights = self._weights(error, judged)
        if samples is not None:
            weights = self._read("samples", samples, len(told))
            self._check("samples", weights, weights >= 1.0)
        objectives = np.where(judged, np.abs(told) if self._is_magnitude else told, np.inf)
        numbers = np.arange(len(self._strings), len(self._strings) + len(told))
        with self._users_code():
            self._search.tell(Evaluations(numbers, proposals.parameters, objectives, told, weights))
            self.generation += 1
            self._ended_by = self._ending.met(self.generation, self._search)
        self._strings += list(proposals.parameters)
        self._errors += error.tolist()

    def _proposals(self) -> Proposals:
        if self.is_finished:
            message = f"is met: {self.why_finished}; nothing is left to ask or to tell"
            raise self._error("stopping", message)
        with self._users_code():
            return self._search.ask()

    def _read(
        self, field: str, given: npt.ArrayLike, count: int, one_for_all: bool = True
    ) -> Floats:
        try:
            numbers = np.ma.filled(np.ma.asarray(given, np.float64), np.nan)
        except (TypeError, ValueError):
            raise self._error(field, f"are {type(given).__name__}; must be numbers") from None
        if numbers.ndim == 0 and one_for_all:
            return np.full(count, float(numbers))
        if numbers.shape != (count,):
            must = f"must be {pluralise(count, 'number')}, one of each string"
            raise self._error(field, f"have the shape {numbers.shape}; {must}")
        index = getattr(given, "index", None)
        if index is None or callable(index):  # that of a list is a method
            return numbers.copy()
        labels, first = np.asarray(index), len(self._strings)
        for start in (first, 0):
            if set(labels.tolist()) == set(range(start, start + count)):
                return np.asarray(numbers[np.argsort(labels)])
        must = f"must be the strings {first} to {first + count - 1}, or 0 to {count - 1}"
        raise self._error(field, f"have another index than the strings; {must}")

    def _check(self, field: str, numbers: Floats, allowed: npt.NDArray[np.bool_]) -> None:
        wrong = numbers[~(allowed & np.isfinite(numbers))]
        if len(wrong):
            least = "of at least 0" if field == "errors" else "of at least 1"
            raise self._error(field, f"is {wrong[0]:g}; must be a finite number {least}")

    def _weights(self, errors: Floats, judged: npt.NDArray[np.bool_]) -> Floats:
        """Return the numbers of samples to which errors correspond, 1 for the largest error.

        The largest is that of the first generation told with errors.
        """
        if math.isnan(self._largest_error) and np.isfinite(errors[judged]).any():
            self._largest_error = float(errors[judged].max())
        if not self._largest_error > 0.0:
            return np.ones(len(errors))
        weights = (self._largest_error / np.maximum(errors, LEAST_ERROR * self._largest_error)) ** 2
        return np.where(np.isfinite(weights) & judged, np.maximum(weights, 1.0), 1.0)

    def _error(self, field: str, message: str) -> ArgumentError:
        return ArgumentError.of(self._campaign.name, field, message)

    def _users_code(self) -> AbstractContextManager[None]:
        """Return a context for a search that components of one's own decide in."""
        return users_code(self._own) if self._own else nullcontext()
