"""Search methods, objectives and stopping rules: those of the package hold, broken ones fail."""

import importlib.util
import math

import numpy as np
import pytest
from goals import FUNCTION_MEAN, growth_target, maximum_growth, moment_targets

from agglom_mpi.contracts.searches import (
    OBJECTIVE_PROPERTIES,
    RULE_PROPERTIES,
    SEARCH_PROPERTIES,
    objective_failures,
    rule_failures,
    search_failures,
)
from agglom_mpi.search.methods.baselines import RandomPoints, RandomSearch
from agglom_mpi.search.methods.genetic import Genetic, GeneticSearch
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.growth import GrowthTarget
from agglom_mpi.search.objectives.moment_targets import MomentTarget
from agglom_mpi.search.objectives.objective import MeanAccumulator, Objective
from agglom_mpi.search.objectives.own_function import MeanOfFunction
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.stopping import (
    AdaptiveRule,
    FixedNumber,
    Moments,
    StandardError,
    StoppingRule,
    SuccessiveDifference,
)

LOWER = np.array([0.1, 0.4, 1e3, 1e7, 10, 0.01, 273.13, 10, 0, np.nan])
UPPER = np.array([30, 0.8, 1e4, 2e8, 1500, 0.01, 373.13, 10, 0, np.nan])
SPACE = SearchSpace(LOWER, UPPER, logarithmic=[0, 0, 0, 1, *[0] * 6])
METHODS = [
    *(method() for method in SearchMethod.components().values()),
    Genetic(more_samples=5),
    Genetic(rescale={"every": 2, "factor": 0.5}, blend=(-0.5, 1.5)),
]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.summary)
def test_every_search_method_of_the_package_has_its_properties(method):
    if method.library is not None and importlib.util.find_spec(method.library) is None:
        pytest.skip(f"needs {method.library}")
    assert list(search_failures(method, SPACE, 1)) == []


class Driven(RandomPoints):
    """A method whose running search is of the class `search`."""

    in_files = False
    search = RandomSearch

    def build(self, inputs):
        return self.search(self, inputs)


def broken_method(**methods):
    """Return random points with methods of the running search replaced."""
    return type("Broken", (Driven,), {"search": type("Broken", (RandomSearch,), methods)})()


def out_of_box(self):
    proposals = RandomSearch.ask(self)
    return proposals._replace(parameters=proposals.parameters * 1.5)


def shorter(self):
    proposals = RandomSearch.ask(self)
    return type(proposals)(proposals.generation, *(column[:-1] for column in proposals[1:]))


def unseeded(self):
    proposals = RandomSearch.ask(self)
    share = np.random.default_rng().random()
    moved = SPACE.lower + share * (proposals.parameters - SPACE.lower)
    if self.space.allowed is not None or len(self.given):
        return proposals
    return proposals._replace(parameters=moved)


def counting(self):
    self.asked = 1 + self.__dict__.get("asked", 0)
    proposals = RandomSearch.ask(self)
    moved = SPACE.lower + (proposals.parameters - SPACE.lower) / self.asked
    moved[: len(self.given)] = proposals.parameters[: len(self.given)]
    return proposals._replace(parameters=moved)


def without_given(self):
    proposals = RandomSearch.ask(self)
    return proposals._replace(parameters=proposals.parameters[::-1].copy())


def worst_first(self, k):
    return RandomSearch.best(self, 10**6)[::-1][:k]


BROKEN_METHODS = {
    "box": {"ask": out_of_box},
    "count": {"ask": shorter},
    "repeatable": {"ask": counting},
    "given": {"ask": without_given},
    "ranking": {"best": worst_first},
    "ahead": {"known_proposals": lambda self, g: (0, RandomSearch.ask(self))},
}


@pytest.mark.parametrize("name", BROKEN_METHODS)
def test_a_broken_search_method_fails_by_its_property(name):
    found = dict(search_failures(broken_method(**BROKEN_METHODS[name]), SPACE, 1))
    assert name in found
    assert set(found) <= set(SEARCH_PROPERTIES)
    assert all("\n" not in text for text in found.values())


class Unseeded(GeneticSearch):
    """A genetic search whose random strings are of no seed."""

    def _random_strings(self, generation):
        proposals = super()._random_strings(generation)
        shares = np.random.default_rng().random((len(proposals.parameters), 1))
        moved = SPACE.lower + shares * (proposals.parameters - SPACE.lower)
        return proposals._replace(parameters=moved)


class Hasty(GeneticSearch):
    """A genetic search that is changed by a question for coming strings."""

    def known_proposals(self, generation):
        self.seed += 1
        return


class Unaware(GeneticSearch):
    """A genetic search that proposes the worst string if some had no objective."""

    def ask(self):
        proposals = super().ask()
        if self.generation and not np.isfinite(self.objectives).all():
            return proposals._replace(parameters=proposals.parameters * 2.0)
        return proposals


@pytest.mark.parametrize(
    ("search", "name"), [(Unseeded, "seed"), (Hasty, "record"), (Unaware, "failures")]
)
def test_a_broken_genetic_search_fails_by_its_property(search, name):
    class Broken(Genetic):
        in_files = False

        def build(self, inputs):
            return search(self, inputs)

    assert name in dict(search_failures(Broken(), SPACE, 1))


OBJECTIVES = [
    growth_target(),
    maximum_growth(1000),
    moment_targets([MomentTarget("mean", 2.0), MomentTarget("kurtosis", 4.0, 0.5)]),
    FUNCTION_MEAN,
]


@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda objective: objective.name)
def test_every_objective_of_the_package_has_its_properties(objective):
    assert list(objective_failures(objective, 1)) == []


def test_all_objectives_but_those_of_data_are_among_those_tested():
    """Made-up samples have no censuses; `tests/search/test_misfit_of_data.py` tests these."""
    others = {each for each in Objective.components().values() if each.needs_data}
    tested = {type(each) for each in OBJECTIVES}
    assert tested == set(Objective.components().values()) - others


class Square:
    """Accumulates the square of the mean, with an error that forgets the derivative."""

    def __init__(self):
        self._mean = MeanAccumulator(lambda sample: sample.mean_radius_ratio)

    def add(self, outcome):
        self._mean.add(outcome)

    @property
    def value(self):
        return self._mean.value**2

    @property
    def standard_error(self):
        return self._mean.standard_error


class Last:
    """Accumulates nothing but the last sample."""

    value = math.nan
    standard_error = 0.1

    def add(self, outcome):
        self.value = outcome.mean_radius_ratio


def broken_objective(base=MeanOfFunction, **methods):
    attributes = {"in_files": False, **methods}
    kind = type("Broken", (base,), attributes)
    return kind(call="worth:worth") if base is MeanOfFunction else kind()


BROKEN_OBJECTIVES = {
    "error": broken_objective(accumulator=lambda self: Square()),
    "mean": broken_objective(influence_values=lambda self, outcomes: np.ones(len(outcomes))),
    "order": broken_objective(accumulator=lambda self: Last()),
    "single": broken_objective(of_samples=lambda self, rows: rows["mean_radius_ratio"] * 0.0),
    "finite": broken_objective(accumulator=lambda self: MeanAccumulator(lambda sample: math.inf)),
    "least": broken_objective(least=10.0),
    "signed": broken_objective(GrowthTarget, signed=lambda self, objective, ratio: 5.0),
}


@pytest.mark.parametrize("name", BROKEN_OBJECTIVES)
def test_a_broken_objective_fails_by_its_property(name):
    found = dict(objective_failures(BROKEN_OBJECTIVES[name], 1))
    assert name in found
    assert set(found) <= set(OBJECTIVE_PROPERTIES)


RULES = [
    SuccessiveDifference(tolerance=1e-3, max_samples=30),
    SuccessiveDifference(tolerance=1e-3, max_samples=30, quantity="mean_radius"),
    Moments(tolerance=1e-2, max_samples=30),
    StandardError(tolerance=0.1, max_samples=30),
    FixedNumber(samples=7),
]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.summary)
def test_every_stopping_rule_of_the_package_has_its_properties(rule):
    assert list(rule_failures(rule, 1)) == []


def test_all_stopping_rules_are_among_those_tested():
    assert {type(rule) for rule in RULES} == set(StoppingRule.components().values())


def broken_rule(holds):
    attributes = {"in_files": False, "label": "broken", "summary": "broken", "holds": holds}
    return type("Broken", (AdaptiveRule,), attributes)(tolerance=0.03, max_samples=30)


def alternating(self, before, after):
    self.__dict__["asked"] = self.__dict__.get("asked", 0) + 1
    return np.asarray(after.objective > -1.0) & (self.asked % 2 == 0)


BROKEN_RULES = {
    "elementwise": lambda self, before, after: after.objective == np.max(after.objective),
    "repeatable": alternating,
    "past": lambda self, before, after: after.objective <= 0.99 * np.mean(after.objective),
    "tolerance": lambda self, before, after: (
        np.abs(after.objective - before.objective) >= self.tolerance * np.abs(after.objective)
    ),
}


@pytest.mark.parametrize("name", BROKEN_RULES)
def test_a_broken_stopping_rule_fails_by_its_property(name):
    found = dict(rule_failures(broken_rule(BROKEN_RULES[name]), 1))
    assert set(found) <= set(RULE_PROPERTIES)
    assert name in found
