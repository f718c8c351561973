"""Properties of a search method, driven for three generations with a made-up objective."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.methods.method import RunningSearch, SearchInputs, SearchMethod
from agglom_mpi.search.proposals import AGAIN, Evaluations, Proposals
from agglom_mpi.search.space import SearchSpace

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


class Drive(NamedTuple):
    """Inputs of a search, its results, and how often it is asked.

    Attributes
    ----------
    inputs
        Box, seed and given strings.
    nudge
        Relative change between the strings proposed and those reported as evaluated.
    asked
        Number of times that it is asked for each generation.
    failing
        Whether every third string has no finite objective.
    """

    inputs: SearchInputs
    nudge: float = 0.0
    asked: int = 1
    failing: bool = False


def made_up(space: SearchSpace, strings: Floats) -> Floats:
    """Return the made-up objective of strings, (n, k): a square distance, with some noise."""
    points = space.to_unit(strings)
    noise = np.modf(np.abs(np.sin(1e4 * points.sum(axis=1))) * 1e3)[0]
    return np.asarray(((points - OPTIMUM) ** 2).sum(axis=1) + 0.05 * noise)


def evaluated(drive: Drive, proposals: Proposals, first: int) -> Evaluations:
    """Return the results of proposals whose first string has the number `first`."""
    space, strings = drive.inputs.space, proposals.parameters
    if drive.nudge:
        strings = space.clip(strings * (1.0 - drive.nudge))
    objectives = made_up(space, strings)
    if drive.failing:
        objectives[::3] = np.inf
    ids = np.arange(first, first + len(strings))
    samples = np.full(len(strings), 5)
    return Evaluations(ids, strings, objectives, objectives.copy(), samples)


def driven_generations(
    method: SearchMethod, drive: Drive
) -> Iterator[tuple[RunningSearch, Proposals, Evaluations]]:
    """Yield the search after each generation, with its proposals and their results."""
    search, first = method.build(drive.inputs), 0
    for _ in range(DRIVEN_GENERATIONS):
        for _ in range(drive.asked):
            proposals = search.ask()
        results = evaluated(drive, proposals, first)
        search.tell(results)
        first += len(results.ids)
        yield search, proposals, results


def search_failures(
    method: SearchMethod, space: SearchSpace, seed: int
) -> Iterator[tuple[str, str]]:
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
    for drive in (Drive(inputs), Drive(inputs._replace(space=constrained(space)))):
        yield from _wrong_proposals(method, drive)
    yield from _not_repeated(method, inputs)
    yield from _not_restored(method, Drive(inputs, nudge=NUDGE))
    yield from _wrong_ahead(method, inputs)
    yield from _wrong_ranking(method, inputs)
    for _, proposals, _ in driven_generations(method, Drive(inputs, failing=True)):
        if text := _out_of_box(space, proposals):
            yield "failures", f"after strings without a finite objective {text}"


def constrained(space: SearchSpace) -> SearchSpace:
    """Return the box with only those strings allowed that are near enough to the lower ends."""
    return space.within(lambda strings: space.to_unit(strings).mean(axis=1) <= ALLOWED_MEAN)


def _out_of_box(space: SearchSpace, proposals: Proposals) -> str:
    """Return a text on the first proposal out of the box or not allowed; empty if none is."""
    strings = proposals.parameters
    unused = np.isnan(space.lower)
    inside = (strings >= space.lower) & (strings <= space.upper) | unused
    if not inside.all():
        row = int(np.flatnonzero(~inside.all(axis=1))[0])
        return f"string {row} of generation {proposals.generation} is out of the box"
    if space.allowed is not None and not space.allowed(strings).all():
        row = int(np.flatnonzero(~space.allowed(strings))[0])
        return f"string {row} of generation {proposals.generation} breaks a constraint"
    return ""


def _wrong_proposals(method: SearchMethod, drive: Drive) -> Iterator[tuple[str, str]]:
    """Yield numbers of strings, places and first strings that are not as they should be."""
    inputs = drive.inputs
    for number, (_, proposals, _) in enumerate(driven_generations(method, drive)):
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


def _same(one: Floats, other: Floats) -> bool:
    return np.array_equal(one, other, equal_nan=True)


def _not_repeated(method: SearchMethod, inputs: SearchInputs) -> Iterator[tuple[str, str]]:
    """Yield generations that are not the same bits when all is done again."""
    cases: dict[str, tuple[Drive, Drive, str]] = {
        "repeatable": (Drive(inputs), Drive(inputs, asked=3), "asked three times"),
        "seed": (Drive(inputs), Drive(inputs), "driven again with the same seed"),
    }
    for name, (first, second, how) in cases.items():
        pairs = zip(
            driven_generations(method, first), driven_generations(method, second), strict=True
        )
        for number, ((_, one, _), (_, other, _)) in enumerate(pairs):
            if not _same(one.parameters, other.parameters):
                yield name, f"generation {number} is another one {how}"
                break


def _not_restored(method: SearchMethod, drive: Drive) -> Iterator[tuple[str, str]]:
    """Yield the first generation that is another one when a campaign is continued from its file.

    The search gets the recorded results, and is asked in between for its best strings, and for
    those of coming generations.
    """
    recorded = [(proposals, results) for _, proposals, results in driven_generations(method, drive)]
    search = method.build(drive.inputs)
    for number, (proposals, results) in enumerate(recorded):
        for coming in (number, number + 1):
            search.known_proposals(coming)
        if not _same(search.ask().parameters, proposals.parameters):
            yield "record", f"generation {number} is another one continued from its record"
            return
        search.tell(results)
        search.best(1)
        search.mean_of_top(1)


def _wrong_ahead(method: SearchMethod, inputs: SearchInputs) -> Iterator[tuple[str, str]]:
    """Yield strings that were known ahead, and are others when their generation comes."""
    promised: dict[int, tuple[int, Floats]] = {}
    first = 0
    for number, (search, proposals, results) in enumerate(
        driven_generations(method, Drive(inputs))
    ):
        if number in promised:
            start, strings = promised[number]
            begin = start - first
            found = proposals.parameters[begin:] if 0 <= begin <= len(results.ids) else np.empty(0)
            if not _same(found, strings):
                yield (
                    "ahead",
                    f"{len(strings)} strings of generation {number} were other ones ahead",
                )
        first += len(results.ids)
        for coming in range(number + 1, number + 3):
            known = search.known_proposals(coming)
            if known is not None:
                promised[coming] = known[0], known[1].parameters


def _wrong_ranking(method: SearchMethod, inputs: SearchInputs) -> Iterator[tuple[str, str]]:
    """Yield rankings that are out of order, or have unknown strings."""
    total = 0
    for number, (search, proposals, results) in enumerate(
        driven_generations(method, Drive(inputs))
    ):
        total += len(results.ids)
        ranked = search.best(total)
        values = [each.objective for each in ranked]
        numbers = [each.string for each in ranked]
        first = values[: max(search.parents, 1)]  # duplicates of a better string may come last
        if first != sorted(values)[: len(first)] or not set(numbers) <= set(range(total)):
            yield "ranking", f"the best strings after generation {number} are {numbers[:5]} ..."
        if not set(search.population_ids.tolist()) <= set(range(total)):
            yield "ranking", f"the population after generation {number} has unknown strings"
        if not np.isfinite(search.mean_of_top(1)):
            yield "ranking", f"the mean of the best after generation {number} is not finite"
        if not method.ranks_itself and (proposals.origin != AGAIN).all() and values:
            best = made_up(inputs.space, results.parameters).min()
            if values[0] > best:
                yield "ranking", f"string {results.objectives.argmin()} is better than the best one"
