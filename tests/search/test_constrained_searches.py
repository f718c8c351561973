"""Searches with constraints propose what is allowed alone, and the same when they are asked again.

The region is a thin curved shell, so that blends of two allowed strings are often not allowed.
"""

import numpy as np
import pytest
from search_fakes import judged
from searches import cmaes_search, genetic_search, random_search, sobol_search, surrogate_search

from agglom_mpi.search.methods.baselines import SobolStrings, sobol_strings
from agglom_mpi.search.proposals import GIVEN
from agglom_mpi.search.space import BLOCK, SearchSpace
from agglom_mpi.variables import TEN

CENTRE = 20.0


def free_box():
    lower, upper = np.ones(TEN.count), np.ones(TEN.count)
    upper[:3] = 100.0
    return SearchSpace(
        lower, upper, logarithmic=np.arange(TEN.count) < 1, cubic=np.arange(TEN.count) == 1
    )


def shell(strings):
    """Return whether the points are in 3 % of the box, a shell about a corner."""
    distance = np.linalg.norm((free_box().to_unit(strings)), axis=1)
    return (distance > 0.95) & (distance < 0.99)


def box():
    return free_box().within(shell)


def methods():
    space = box()
    given = sobol_strings(space, 3, 0, 4096)
    given = given[shell(given)][:2]
    return {
        "random": lambda: random_search(space, 1, 12, given),
        "sobol": lambda: sobol_search(space, 1, 12, given),
        "genetic": lambda: genetic_search(space, 1, 12, 6, given=given),
        "mutation": lambda: genetic_search(space, 1, 12, 6, (-0.5, 1.5), given=given),
        "rescaled": lambda: genetic_search(space, 1, 12, 6, rescale=(1, 0.3), given=given),
        "again": lambda: genetic_search(space, 1, 12, 6, given=given, again=True),
        "cmaes": lambda: cmaes_search(space, 1, 12, 0.3, given),
        "unguided cmaes": lambda: cmaes_search(space, 1, 12, 0.3),
        "surrogate": lambda: surrogate_search(space, 1, 24, 8, given, magnitude=True),
    }


def run(search, generations, asked=1):
    batches, first = [], 0
    for _ in range(generations):
        for _ in range(asked):
            batch = search.ask()
        batches.append(batch)
        ids = np.arange(len(batch.parameters)) + first
        first += len(ids)
        # Best outside of what is allowed, so that the search is driven against its edge.
        worth = np.sum((box().to_unit(batch.parameters) - 0.2) ** 2, axis=1)
        search.tell(judged(ids, batch.parameters, worth))
    return batches


@pytest.mark.parametrize("name", methods())
def test_every_string_is_allowed_and_in_the_box(name):
    batches = run(methods()[name](), 6)
    strings = np.concatenate([batch.parameters for batch in batches])
    assert shell(strings).all()
    assert np.all((strings >= box().lower) & (strings <= box().upper))
    new = strings if name != "again" else batches[0].parameters
    assert len(np.unique(new, axis=0)) == len(new)


@pytest.mark.parametrize("name", methods())
def test_the_same_results_lead_to_the_same_strings(name):
    first, second = run(methods()[name](), 4), run(methods()[name](), 4, asked=2)
    for one, other in zip(first, second, strict=True):
        assert one.parameters.tobytes() == other.parameters.tobytes()


@pytest.mark.parametrize("name", ["random", "sobol", "genetic", "rescaled"])
def test_strings_known_ahead_are_those_that_are_proposed(name):
    search = methods()[name]()
    known = search.known_proposals(0)
    _, ahead = known
    batch = search.ask()
    assert np.array_equal(ahead.parameters, batch.parameters[-len(ahead.parameters) :])
    assert batch.origin.tolist()[:2] == [GIVEN] * 2


def test_random_strings_are_the_draws_that_are_allowed():
    random, plain = np.random.default_rng(5), np.random.default_rng(5)
    found = box().sample(random)
    draws = np.array([free_box().sample(plain) for _ in range(2 * BLOCK)])
    assert np.array_equal(found, draws[shell(draws)][0])


def test_allowed_sobol_strings_are_those_of_the_whole_sequence():
    whole = sobol_strings(free_box(), 7, 0, 4 * BLOCK)
    sequence = SobolStrings(box(), 7)
    later = sequence.strings(20, 100)
    assert np.array_equal(later, whole[shell(whole)][20:120])
    assert np.array_equal(sequence.strings(0, 20), whole[shell(whole)][:20])


def test_allowed_strings_fill_their_region_evenly():
    # Uniform in the shell of an octant: the angle's cosine is uniform.
    random = np.random.default_rng(2)
    points = box().sample_points(random, 4000)
    assert box().allows(points).all()
    cosine = points[:, 0] / np.linalg.norm(points, axis=1)
    error = 1.0 / np.sqrt(12.0 * len(cosine))
    assert abs(cosine.mean() - 0.5) < 4.0 * error


def test_another_sequence_follows_one_that_is_used_up(monkeypatch):
    monkeypatch.setattr("agglom_mpi.search.methods.baselines.SOBOL_BITS", 13)
    found = SobolStrings(box(), 7).strings(0, 900)  # of four sequences: 3 % of each is allowed
    assert shell(found).all()
    assert len(np.unique(found, axis=0)) == 900


def test_points_are_found_where_too_few_of_the_draws_are_allowed(monkeypatch):
    """In two separate spots, one of them three times as large as the other."""

    def spots(strings):
        x, y, z = free_box().to_unit(strings).T
        small, large = np.abs(x - 0.1) < 0.05, np.abs(x - 0.7) < 0.15
        return (small | large) & (np.abs(y - 0.5) < 0.05) & (z < 0.2)

    monkeypatch.setattr("agglom_mpi.search.space.MOST_DRAWS", 16 * BLOCK)
    space = free_box().within(spots)
    points = space.sample_points(np.random.default_rng(1), 2000)
    again = space.sample_points(np.random.default_rng(1), 2000)
    assert points.tobytes() == again.tobytes()
    assert 100 < 0.008 * 16 * BLOCK < 1000  # independent ones; the others are walked to
    assert space.allows(points).all()
    assert len(np.unique(points, axis=0)) == 2000
    # The share of the small spot has the error of the independent points, of which walks go on.
    error = np.sqrt(0.25 * 0.75 / (0.008 * 16 * BLOCK))
    assert abs(np.mean(points[:, 0] < 0.4) - 0.25) < 4.0 * error
    for column, middle, half in ((1, 0.5, 0.05), (2, 0.1, 0.1)):
        # Less than as many independent points, and no fewer than the draws.
        deviations = (points[:, column] - middle) / half
        assert abs(deviations.mean()) < 4.0 / np.sqrt(3.0 * 0.008 * 16 * BLOCK)
        assert abs(np.mean(np.abs(deviations) < 0.5) - 0.5) < 4.0 * 0.5 / np.sqrt(500.0)


def test_where_enough_draws_are_allowed_the_points_are_these():
    space, random = box(), np.random.default_rng(5)
    drawn = random.random((BLOCK, 3))
    drawn = drawn[space.allows(drawn)][:50]
    assert space.sample_points(np.random.default_rng(5), 50).tobytes() == drawn.tobytes()


def test_a_point_is_moved_to_the_edge_of_what_is_allowed():
    space = box()
    origin, point = np.array([[0.97, 0.0, 0.0]]), np.array([[0.97, 0.9, 0.0]])
    [moved] = space.towards(point, origin)
    assert np.linalg.norm(moved) == pytest.approx(0.99, abs=2e-6)
    assert space.allows(moved[None])[0]
    assert np.array_equal(space.towards(origin, origin), origin)


def test_a_restricted_box_without_a_draw_falls_back_on_its_centre(monkeypatch):
    monkeypatch.setattr("agglom_mpi.search.space.MOST_DRAWS", 64)
    centre = free_box().from_unit(np.array([[0.97, 0.0, 0.0]]))[0]
    only = free_box().within(lambda strings: np.all(np.isclose(strings, centre, 1e-9), axis=1))
    found = only.around(centre, 0.5).sample(np.random.default_rng(1))
    np.testing.assert_allclose(found, centre, rtol=1e-9)
    with pytest.raises(RuntimeError, match="no string of 64 satisfies the constraints"):
        only.sample(np.random.default_rng(1))


def test_a_box_without_constraints_draws_as_ever():
    plain, one = np.random.default_rng(9), np.random.default_rng(9)
    every = free_box().within(lambda strings: np.ones(len(strings), bool))
    assert free_box().sample(plain).tobytes() == every.sample(one).tobytes()


def test_a_cubic_component_is_uniform_in_its_cube():
    random = np.random.default_rng(4)
    strings = np.array([free_box().sample(random)[1] for _ in range(4000)])
    share = (strings**3 - 1.0) / (1e6 - 1.0)
    assert abs(share.mean() - 0.5) < 4.0 / np.sqrt(12.0 * len(share))
    space = free_box()
    points = random.random((50, 3))
    np.testing.assert_allclose(space.to_unit(space.from_unit(points)), points, atol=1e-12)
