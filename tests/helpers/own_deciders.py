"""A small campaign whose search, stopping rule and objective are like none of the package."""

from campaign_runs import write_campaign

DECIDERS = '''\
"""Fewest grains for their growth, by steps along the axes of the box that halve when none helps."""

import math
from typing import Annotated, ClassVar

import numpy as np

from agglom_mpi.components import (
    NO_PARENT,
    OFFSPRING,
    OWN_SEARCH,
    AdaptiveRule,
    EvaluatedStrings,
    In,
    Objective,
    SearchMethod,
    Whole,
    as_proposals,
    begun_with,
    search_stream,
)


class LeftPerGrowth(Objective):
    """E[n/N]/E[b/b0], a ratio of two means."""

    symbol: ClassVar[str] = "R"
    summary: ClassVar[str] = "fraction of grains left over mean radius ratio"

    def accumulator(self):
        """Return an accumulator without samples."""
        return Ratio(self)

    def of_samples(self, rows):
        """Return the ratio of each sample."""
        return rows["particles"] / self._grains / rows["mean_radius_ratio"]

    def influence_values(self, outcomes):
        """Return R + (n/N - R b/b0)/E[b/b0] of each sample."""
        left = np.array([outcome.particles for outcome in outcomes]) / self._grains
        growth = np.array([outcome.mean_radius_ratio for outcome in outcomes])
        ratio = left.mean() / growth.mean()
        return ratio + (left - ratio * growth) / growth.mean()


class Ratio:
    """The ratio of the samples so far."""

    def __init__(self, objective):
        self.objective, self.outcomes = objective, []

    def add(self, outcome):
        """Take one more completed sample."""
        self.outcomes.append(outcome)

    @property
    def value(self):
        """The ratio."""
        if not self.outcomes:
            return math.nan
        return float(self.objective.influence_values(self.outcomes).mean())

    @property
    def standard_error(self):
        """Standard error by the delta method."""
        count = len(self.outcomes)
        if count < 2:
            return math.nan
        values = self.objective.influence_values(self.outcomes)
        return float(values.std(ddof=1)) / math.sqrt(count)


class SettledOrPoor(AdaptiveRule):
    """Ends an ensemble that is known well enough, or too poor by two standard errors."""

    poor: Annotated[float, In("1", above=0)] = 0.02
    label: ClassVar[str] = "settled or poor"
    summary: ClassVar[str] = "until the relative error is small, or the objective surely large"

    def holds(self, before, after):
        """Compare the error with the objective, and the objective with `poor`."""
        settled = after.standard_error <= self.tolerance * after.objective
        poor = after.objective - 2.0 * after.standard_error >= self.poor
        return (after.samples >= self.min_samples) & (settled | poor)


class Compass(SearchMethod):
    """Begins with random strings; then steps both ways from the best one along random axes."""

    first: Annotated[int, Whole(at_least=1)] = 3
    axes: Annotated[int, Whole(at_least=1)] = 2
    step: Annotated[float, In("1", above=0, at_most=1)] = 0.25
    summary: ClassVar[str] = "a compass search"

    @property
    def first_generation(self):
        """Number of strings in the first generation."""
        return self.first

    @property
    def population(self):
        """Number of strings that are ranked as the population: the best alone."""
        return 1

    def strings(self, generations):
        """Return the number of strings in `generations` generations."""
        return self.first + (generations - 1) * 2 * self.axes

    def build(self, inputs):
        """Return the search before its first generation."""
        return Steps(self, inputs)


class Steps(EvaluatedStrings):
    """A compass search: the step halves after each generation without a better string."""

    parents = 1

    def __init__(self, method, inputs):
        super().__init__(1)
        self.method, self.inputs, self.step = method, inputs, method.step

    def stream(self, generation, slot):
        """Return the random numbers of a string."""
        return search_stream(self.inputs.seed, OWN_SEARCH, generation, slot)

    def ask(self):
        """Return the strings of the next generation."""
        generation, given, space = self.generation, self.inputs.given, self.inputs.space
        if generation == 0:
            slots = range(len(given), self.method.first)
            drawn = np.array([space.sample(self.stream(0, slot)) for slot in slots])
            return begun_with(given, drawn.reshape(-1, space.count))
        [best] = self.best(1)
        centre = space.to_unit(self.parameters[[best.string]])[0]
        points = np.repeat(centre[None], 2 * self.method.axes, axis=0)
        axes = self.stream(generation, 0).permutation(space.dimensions)[: self.method.axes]
        for pair, axis in enumerate(axes):
            points[2 * pair : 2 * pair + 2, axis] += self.step, -self.step
        strings = space.from_unit(points.clip(0.0, 1.0))
        allowed = space.allows(space.to_unit(strings))
        for slot in np.flatnonzero(~allowed):
            strings[slot] = space.sample(self.stream(generation, 1 + slot))
        proposals = as_proposals(generation, strings, OFFSPRING)
        proposals.parents[:] = best.string, NO_PARENT
        return proposals

    def known_proposals(self, generation):
        """Return None: every generation depends on the one before it."""
        return None

    def tell(self, evaluations):
        """Keep the results, and halve the step if none is better than all before."""
        before = self.best(1)
        super().tell(evaluations)
        if before and self.best(1)[0].string == before[0].string:
            self.step *= 0.5
'''
"""The module of the three classes."""

SECTIONS = (
    ("{law: growth_target, ratio: 2}", '{law: "deciders.py:LeftPerGrowth"}'),
    ("search: {population: 12, parents: 4}", 'search: {method: "deciders.py:Compass"}'),
    ("rule: standard_error", 'rule: "deciders.py:SettledOrPoor"'),
)
"""Sections of a campaign, and those that replace them."""


def write_deciders(folder, name="own"):
    """Write `name`.yaml and `deciders.py` beside it; its path."""
    numbers = {"generations": 5, "tolerance": 0.1, "max_samples": 4}
    path = write_campaign(folder / f"{name}.yaml", final="{strings: 2, samples: 4}", **numbers)
    text = path.read_text()
    for old, new in SECTIONS:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)
    (folder / "deciders.py").write_text(DECIDERS)
    return path
