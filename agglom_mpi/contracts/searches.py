"""Properties of objectives and stopping rules, on made-up samples, and of search methods.

A method is driven for three generations with a made-up objective.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.cases import Violation, equal, within
from agglom_mpi.outcome import COMPLETED, OUTCOME, SampleSummary, summaries
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.methods.method import RunningSearch, SearchInputs, SearchMethod
from agglom_mpi.search.objectives.growth import GrowthTarget
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.proposals import AGAIN, Evaluations, Proposals
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.stopping import EnsembleState, StoppingRule, rows_of

MADE_UP_GRAINS: Final = 1000
"""Number of grains of the made-up samples."""
MADE_UP_SAMPLES: Final = 40
"""Number of samples of a string."""
MADE_UP_STRINGS: Final = 12
"""Number of strings."""
SUM_ROUNDING: Final = 1e-9
"""Relative rounding of sums over some ten samples, and a margin."""
LOOSER: Final = 4.0
"""Factor between a tolerance and the larger one that it is compared with."""

OBJECTIVE_PROPERTIES: Final = ("finite", "mean", "error", "order", "single", "least", "signed")
RULE_PROPERTIES: Final = ("limits", "elementwise", "past", "repeatable", "tolerance")


def made_up_rows(seed: int, count: int = MADE_UP_SAMPLES) -> NDArray[np.void]:
    """Return samples of one string, (n,), with moments of radii that really are such moments."""
    random = np.random.default_rng(seed)
    columns = [(name, OUTCOME[name]) for name in OUTCOME.names or ()]
    rows = np.zeros(count, [*columns, ("objective", np.float64)])
    rows["state"] = COMPLETED
    for row in rows:
        left = int(random.integers(20, MADE_UP_GRAINS))
        radii = random.lognormal(0.5 + 0.1 * random.standard_normal(), 0.3, left)
        away = radii - radii.mean()
        row["mean_radius_ratio"], row["particles"] = radii.mean(), left
        for order in (2, 3, 4):
            row[f"radius_moment_{order}"] = (away**order).mean()
        row["objective"] = random.normal(1.0, 0.2)
    return rows


def objective_failures(objective: Objective, seed: int) -> Iterator[tuple[str, str]]:
    """Yield each property of an objective that does not hold, and what is wrong."""
    objective = objective.of_grains(MADE_UP_GRAINS)
    for string in range(MADE_UP_STRINGS):
        for name, text in _wrong_estimates(objective, made_up_rows(seed + string, 2 + string)):
            if text:
                yield name, f"{text}; of {2 + string} made-up samples"


def _wrong_estimates(
    objective: Objective, rows: NDArray[np.void]
) -> Iterator[tuple[str, Violation]]:
    """Yield the properties of the objective of some samples, and what is wrong, if anything."""
    samples = summaries(rows)
    value, error = objective.of_ensemble(samples)
    if not (math.isfinite(value) and math.isfinite(error) and error >= 0.0):
        yield "finite", f"the objective is {value} +- {error}"
        return
    yield "least", within("the objective", value, objective.least, math.inf)
    values = np.asarray(objective.influence_values(samples))
    if values.shape != (len(samples),):
        yield "mean", f"influence values have the shape {values.shape}"
    mean = abs(float(values.mean())) if objective.is_magnitude else float(values.mean())
    size = SUM_ROUNDING * max(abs(value), float(np.abs(values).max()))
    rough = size + 1e-6 * error
    yield "mean", equal("the mean of influence values", mean, value, size)
    spread = float(values.std(ddof=1)) / math.sqrt(len(values))
    yield "error", equal("the standard error of influence values", spread, error, rough)
    turned = objective.of_ensemble(samples[::-1])
    yield "order", equal("the objective in the other order", turned[0], value, size)
    yield "order", equal("the standard error in the other order", turned[1], error, rough)
    alone = np.array([objective.of_ensemble([sample])[0] for sample in samples])
    single = np.asarray(objective.of_samples(rows))
    if single.shape != alone.shape or np.abs(single - alone).max() > size:
        yield "single", "of_samples and the accumulator differ for samples that are alone"
    signed = objective.signed(value, float(rows["mean_radius_ratio"].mean()))
    yield "signed", equal("the magnitude of signed", abs(signed), abs(value), size)


def made_up_states(seed: int) -> EnsembleState[Any]:
    """Return the states of made-up ensembles after each sample, shape (samples, ensembles)."""
    random = np.random.default_rng(seed)
    count = np.arange(1, MADE_UP_SAMPLES + 1)[:, None]
    objectives = random.normal(1.0, 0.2, (MADE_UP_SAMPLES, MADE_UP_STRINGS))
    moments = random.lognormal(0.0, 0.3, (4, *objectives.shape)).cumsum(axis=1) / count
    mean = objectives.cumsum(axis=0) / count
    spread = np.sqrt(np.maximum((objectives**2).cumsum(axis=0) / count - mean**2, 0.0))
    error = np.where(count > 1, spread / np.sqrt(np.maximum(count - 1, 1)), np.nan)
    return EnsembleState(count, moments[0], mean, error, (moments[1], moments[2], moments[3]))


def _of_one(states: EnsembleState[Any], string: int) -> EnsembleState[Any]:
    count, *means, moments = states
    one, two, three, *others = (each[:, [string]] for each in (*(moments or ()), *means))
    return EnsembleState._make((count, *others, (one, two, three)))


def rule_failures(rule: StoppingRule, seed: int) -> Iterator[tuple[str, str]]:
    """Yield each property of a stopping rule that does not hold, and what is wrong.

    A rule depends on two successive states alone: of one ensemble or of many, now or later, and
    whatever comes after them. It ends every ensemble within its limits.
    """
    states, half = made_up_states(seed), MADE_UP_SAMPLES // 2
    together = rule.satisfied_paths(states)
    alone = [rule.satisfied_paths(_of_one(states, each)) for each in range(MADE_UP_STRINGS)]
    if not np.array_equal(np.hstack(alone), together):
        yield "elementwise", "holds differs for an ensemble alone and among others"
    if not np.array_equal(rule.satisfied_paths(states), together):
        yield "repeatable", "holds decides otherwise when it is asked again"
    begun = rule.satisfied_paths(rows_of(states, slice(half)))
    if not np.array_equal(begun, together[:half]):
        yield "past", f"decisions up to sample {half} depend on samples after it"
    looser = rule
    if "tolerance" in rule.model_fields:
        looser = rule.model_copy(update={"tolerance": LOOSER * rule.tolerance})
    objective = GrowthTarget(ratio=1.5)
    for string in range(MADE_UP_STRINGS):
        samples = summaries(made_up_rows(seed + string))
        used, fewer = (_used(each, objective, samples) for each in (rule, looser))
        if not rule.min_samples <= used <= rule.max_samples and used < len(samples):
            yield "limits", f"string {string} uses {used} samples"
        if fewer > used:
            text = f"string {string} uses {used} samples, and {fewer} with a larger tolerance"
            yield "tolerance", text


def _used(rule: StoppingRule, objective: Objective, samples: Sequence[SampleSummary]) -> int:
    ensemble = Ensemble(rule, objective, MADE_UP_GRAINS)
    for sample in samples:
        if not ensemble.finished:
            ensemble.add(sample)
    return ensemble.samples_used


Floats = NDArray[np.float64]

DRIVEN_GENERATIONS: Final = 3
"""Number of generations whose results a search gets; one more is proposed."""
OPTIMUM: Final = 0.3
"""Every coordinate, in the unit cube, of the string with the lowest made-up objective."""
ALLOWED_MEAN: Final = 0.7
"""Mean coordinate in the unit cube up to which strings are allowed in the second drive."""
NUDGE: Final = 1e-9
"""Relative change of strings as a campaign file gives them back."""

SEARCH_PROPERTIES: Final = (
    *("count", "box", "given", "repeatable", "seed", "record", "ahead", "ranking", "failures"),
)

Failures = Iterator[tuple[str, str]]


DrivenGeneration = tuple[RunningSearch, Proposals, Evaluations, int]
"""The search after a generation, its strings and results, and the number of strings before it."""


def made_up(space: SearchSpace, strings: Floats) -> Floats:
    """Return the made-up objective of strings, (n, k): a square distance, with some noise."""
    points = space.to_unit(strings)
    noise = np.modf(np.abs(np.sin(1e4 * points.sum(axis=1))) * 1e3)[0]
    return np.asarray(((points - OPTIMUM) ** 2).sum(axis=1) + 0.05 * noise)


def driven_generations(
    method: SearchMethod,
    inputs: SearchInputs,
    *,
    nudge: float = 0.0,
    asked: int = 1,
    failing: bool = False,
) -> Iterator[DrivenGeneration]:
    """Yield the generations of a search.

    Parameters
    ----------
    method, inputs
        The method; box, seed and given strings.
    nudge
        Relative change between the strings proposed and those reported as evaluated.
    asked
        Number of times that it is asked for each generation.
    failing
        Whether every third string has no finite objective.
    """
    search, first, space = method.build(inputs), 0, inputs.space
    for _ in range(DRIVEN_GENERATIONS):
        proposals = [search.ask() for _ in range(asked)][-1]
        strings = proposals.parameters
        if nudge:
            strings = space.clip(strings * (1.0 - nudge))
        objectives = made_up(space, strings)
        if failing:
            objectives[::3] = np.inf
        ids, samples = np.arange(first, first + len(strings)), np.full(len(strings), 5)
        results = Evaluations(ids, strings, objectives, objectives.copy(), samples)
        search.tell(results)
        yield search, proposals, results, first
        first += len(ids)


def search_failures(method: SearchMethod, space: SearchSpace, seed: int) -> Failures:
    """Yield each property of a search method that does not hold, and what is wrong.

    Parameters
    ----------
    method
        The method.
    space
        The box.
    seed
        Seed of the search.
    """
    lower, upper = space.lower, space.upper
    given = np.vstack([lower + 0.25 * (upper - lower), lower + 0.5 * (upper - lower)])
    inputs = SearchInputs(space, seed, given[: min(2, method.first_generation)])
    generations = list(driven_generations(method, inputs))
    yield from _wrong_proposals(method, inputs, generations)
    # Second drive: only strings near enough to the lower ends are allowed.
    fewer = space.within(lambda strings: space.to_unit(strings).mean(axis=1) <= ALLOWED_MEAN)
    constrained = inputs._replace(space=fewer)
    yield from _wrong_proposals(method, constrained, driven_generations(method, constrained))
    for name, asked in (("repeatable", 3), ("seed", 1)):
        again = driven_generations(method, inputs, asked=asked)
        pairs = zip(generations, again, strict=True)
        if not all(_same(one[1], other[1]) for one, other in pairs):
            yield name, f"other strings are proposed, asked {asked} times and driven again"
    yield from _not_restored(method, inputs)
    yield from _wrong_ahead(driven_generations(method, inputs))
    yield from _wrong_ranking(method, inputs)
    for _, proposals, _, _ in driven_generations(method, inputs, failing=True):
        if text := _out_of_box(space, proposals):
            yield "failures", f"after strings without a finite objective {text}"


def _same(one: Proposals, other: Proposals) -> bool:
    return np.array_equal(one.parameters, other.parameters, equal_nan=True)


def _out_of_box(space: SearchSpace, proposals: Proposals) -> str:
    """Return a text on the first proposal out of the box or not allowed; empty if none is."""
    strings = proposals.parameters
    inside = ((strings >= space.lower) & (strings <= space.upper) | np.isnan(space.lower)).all(1)
    allowed = inside if space.allowed is None else space.allowed(strings)
    for good, fault in ((inside, "is out of the box"), (allowed, "breaks a constraint")):
        if not good.all():
            return f"string {good.argmin()} of generation {proposals.generation} {fault}"
    return ""


def _wrong_proposals(
    method: SearchMethod, inputs: SearchInputs, generations: Iterable[DrivenGeneration]
) -> Failures:
    """Yield numbers of strings, places and first strings that are not as they should be."""
    for number, (_, proposals, _, _) in enumerate(generations):
        wanted = method.strings(number + 1) - (method.strings(number) if number else 0)
        found = len(proposals.parameters)
        if found != wanted or (number == 0 and found != method.first_generation):
            yield "count", f"generation {number} has {found} strings; stated are {wanted}"
        if proposals.generation != number:
            yield "count", f"generation {number} is called {proposals.generation}"
        if text := _out_of_box(inputs.space, proposals):
            yield "box", text
        begun = proposals.parameters[: len(inputs.given)]
        if number == 0 and not np.array_equal(begun, inputs.given, equal_nan=True):
            yield "given", f"the first {len(inputs.given)} strings are not those given"


def _not_restored(method: SearchMethod, inputs: SearchInputs) -> Failures:
    """Yield the first generation that is another one when a campaign is continued from its file.

    The search gets the recorded results, and is asked in between for its best strings, and for
    those of coming generations.
    """
    recorded = list(driven_generations(method, inputs, nudge=NUDGE))
    search = method.build(inputs)
    for number, (_, proposals, results, _) in enumerate(recorded):
        for coming in (number, number + 1):
            search.known_proposals(coming)
        if not _same(search.ask(), proposals):
            yield "record", f"generation {number} is another one continued from its record"
            return
        search.tell(results)
        search.best(1)
        search.mean_of_top(1)


def _wrong_ahead(generations: Iterable[DrivenGeneration]) -> Failures:
    """Yield strings that were known ahead, and are others when their generation comes."""
    promised: dict[int, tuple[int, Floats]] = {}
    for number, (search, proposals, _, first) in enumerate(generations):
        start, strings = promised.get(number, (first, proposals.parameters))
        found = proposals.parameters[start - first :] if start >= first else np.empty(0)
        if not np.array_equal(found, strings, equal_nan=True):
            yield "ahead", f"{len(strings)} strings of generation {number} were other ones ahead"
        for coming in range(number + 1, number + 3):
            known = search.known_proposals(coming)
            if known is not None:
                promised[coming] = known[0], known[1].parameters


def _wrong_ranking(method: SearchMethod, inputs: SearchInputs) -> Failures:
    """Yield rankings that are out of order, or have unknown strings."""
    for search, proposals, results, begin in driven_generations(method, inputs):
        known = set(range(begin + len(results.ids)))
        ranked = search.best(len(known))
        values = [each.objective for each in ranked]
        numbers = [each.string for each in ranked]
        first = values[: max(search.parents, 1)]  # duplicates of a better string may come last
        best, after = results.objectives.min(), f"after generation {proposals.generation}"
        if first != sorted(values)[: len(first)] or not set(numbers) <= known:
            yield "ranking", f"the best strings {after} are {numbers[:5]} ..."
        if not set(search.population_ids.tolist()) <= known:
            yield "ranking", f"the population {after} has unknown strings"
        if not np.isfinite(search.mean_of_top(1)):
            yield "ranking", f"the mean of the best {after} is not finite"
        ranks = not method.ranks_itself and (proposals.origin != AGAIN).all()
        if ranks and values and values[0] > best:
            yield "ranking", f"a string {after} is better than the best one"
