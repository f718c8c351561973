"""A search by a process begins with the results of strings that it has learned."""

import numpy as np
import pytest
from searches import surrogate_search
from test_surrogate import box, run, same

from agglom_mpi.search.methods.method import SearchInputs
from agglom_mpi.search.methods.surrogate import Surrogate
from agglom_mpi.search.proposals import GIVEN, MODEL, Evaluations


def away(points):
    """Return signed deviations whose zero is the plane x = 0.7."""
    return points[:, 0] - 0.7


def learned_of(space, points, noise=0.02):
    """Return results of strings at points of the unit cube, or beyond it."""
    values = away(points) + noise * np.random.default_rng(4).normal(size=len(points))
    strings = np.ones((len(points), space.count))
    strings[:, space.searched] = 1.0 + 10.0 * points
    numbers = np.arange(len(points))
    return Evaluations(numbers, strings, abs(values), values, np.ones(len(points), np.int64))


def scattered(count, low=0.0, high=1.0):
    return np.random.default_rng(3).uniform(low, high, (count, 2))


def test_the_first_generation_is_proposed_where_the_learned_strings_are_best():
    space = box(2)
    search = surrogate_search(
        space, 1, 20, 8, magnitude=True, learned=learned_of(space, scattered(40))
    )
    first, second = run(search, 2, worth=away)
    assert len(first.parameters) == len(second.parameters) == 10
    for batch in (first, second):
        assert set(batch.origin.tolist()) == {MODEL}
        assert abs(away(space.to_unit(batch.parameters))).mean() < 0.1
    even = surrogate_search(space, 1, 20, 8, magnitude=True).ask()
    assert abs(away(space.to_unit(even.parameters))).mean() > 0.2


def test_given_strings_come_before_those_of_the_model():
    space = box(2)
    given = space.from_unit(np.array([[0.1, 0.2], [0.3, 0.4]]))
    learned = learned_of(space, scattered(40))
    search = surrogate_search(space, 1, 20, 8, given, magnitude=True, learned=learned)
    first = search.ask()
    assert first.origin.tolist() == [GIVEN] * 2 + [MODEL] * 8
    assert np.array_equal(first.parameters[:2], given)
    assert first.slot.tolist() == list(range(10))


@pytest.mark.parametrize("low", [-1.5, 1.2])
def test_strings_outside_of_the_box_are_data_but_are_not_proposed(low):
    space = box(2)
    learned = learned_of(space, scattered(12, low, low + 1.0))
    search = surrogate_search(space, 1, 20, 8, magnitude=True, learned=learned)
    for batch in run(search, 3, worth=away):
        points = space.to_unit(batch.parameters)
        assert points.min() >= 0.0
        assert points.max() <= 1.0


def test_the_search_ranks_its_own_strings_alone():
    space = box(2)
    learned = learned_of(space, np.array([[0.7, y] for y in np.linspace(0.0, 1.0, 30)]), 0.0)
    search = surrogate_search(space, 1, 20, 8, magnitude=True, learned=learned)
    run(search, 3, worth=away)
    assert len(search) == 28
    assert sorted(ranked.string for ranked in search.best(100)) == list(range(28))


def test_repeated_searches_propose_the_same_in_a_thread_too():
    space = box(2)
    learned = learned_of(space, scattered(40))
    wanted = [
        run(
            surrogate_search(space, 1, 20, 8, magnitude=True, learned=learned, background=b),
            4,
            away,
        )
        for b in (False, True)
    ]
    for one, other in zip(*wanted, strict=True):
        assert same(one, other)


def test_learned_strings_that_failed_count_as_the_worst():
    space = box(2)
    learned = learned_of(space, scattered(40))
    objectives = learned.objectives.copy()
    objectives[[3, 7]] = np.inf
    search = surrogate_search(
        space, 1, 20, 8, magnitude=True, learned=learned._replace(objectives=objectives)
    )
    assert set(search.ask().origin.tolist()) == {MODEL}


def test_the_error_of_a_set_is_known_once_there_are_enough_strings_of_both():
    space = box(2)
    method = Surrogate(initial=20, batch=8, aim="set", tolerance=0.2)
    errors = []
    for count in (0, 45):
        learned = learned_of(space, scattered(count)) if count else None
        inputs = SearchInputs(
            space, 1, space.no_strings, True, coordinates=space.to_unit, learned=learned
        )
        search = method.build(inputs)
        run(search, 1, worth=away)
        errors.append(search.set_error())
    assert errors[0] == np.inf
    assert 0.0 < errors[1] < 0.5
