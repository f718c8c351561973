import numpy as np
import pytest
from search_fakes import judged, unit_box
from searches import cmaes_search

from agglom_mpi.search.proposals import GIVEN, MODEL, RANDOM
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN


def box(dimensions):
    lower, upper = np.ones(TEN.count), np.ones(TEN.count)
    upper[:dimensions] = 100.0
    return SearchSpace(lower, upper, logarithmic=np.arange(TEN.count) < 2)


def sphere(points):
    return np.sum((points - 0.3) ** 2, axis=1)


def run(search, generations, worth=sphere):
    batches = []
    for _ in range(generations):
        batches.append(batch := search.ask())
        ids = np.arange(len(batch.parameters)) + len(search)
        points = search.space.to_unit(batch.parameters)
        search.tell(judged(ids, batch.parameters, worth(points)))
    return batches


@pytest.mark.parametrize("dimensions", [1, 2, 10])
@pytest.mark.parametrize("worth", [sphere, lambda points: points.sum(axis=1)])
def test_strings_stay_in_the_box_and_differ(dimensions, worth):
    search = cmaes_search(box(dimensions), 1, 12, 0.8)
    strings = np.concatenate([batch.parameters for batch in run(search, 12, worth)])
    assert np.all((strings >= search.space.lower) & (strings <= search.space.upper))
    assert len(np.unique(strings, axis=0)) == len(strings)


@pytest.mark.parametrize("seed", range(3))
def test_it_goes_down_a_sphere_to_its_middle(seed):
    search = cmaes_search(box(10), seed, 12, 0.3)
    run(search, 100)
    # The distance falls by a constant factor in so many generations (Hansen 2016, section 4).
    assert search.best(1)[0].objective < 1e-6
    assert search.mean_of_top(12) < 1e-5


def test_the_same_tells_lead_to_the_same_strings_in_any_order():
    one, other = (cmaes_search(box(6), 3, 8, 0.3) for _ in range(2))
    for generation in range(6):
        batch, twin = one.ask(), other.ask()
        for first, second, again in zip(batch, twin, one.ask(), strict=True):
            assert np.array_equal(first, second)
            assert np.array_equal(first, again)
        ids = np.arange(8) + 8 * generation
        worth = sphere(one.space.to_unit(batch.parameters))
        one.tell(judged(ids, batch.parameters, worth))
        other.tell(judged(ids[::-1], batch.parameters[::-1], worth[::-1]))
    different = cmaes_search(box(6), 4, 8, 0.3).ask().parameters
    assert not np.array_equal(different, run(cmaes_search(box(6), 3, 8, 0.3), 1)[0].parameters)


def test_given_strings_come_first_and_it_begins_about_the_first_of_them():
    strings = unit_box().from_unit(np.full((2, TEN.count), 0.25))
    strings[1] = 0.75
    search = cmaes_search(unit_box(), 1, 200, 0.02, strings)
    first, second = run(search, 2, lambda points: np.zeros(len(points)))
    assert np.array_equal(first.parameters[:2], strings)
    assert first.origin.tolist() == [GIVEN] * 2 + [RANDOM] * 198
    assert first.slot.tolist() == list(range(200))
    # Six standard errors, for ten coordinates of any realisation; the box has its middle 176 away.
    error = 0.02 / np.sqrt(198)
    assert np.all(abs(first.parameters[2:].mean(axis=0) - 0.25) < 6.0 * error)
    assert set(second.origin) == {MODEL}
    assert search.known_proposals(1) is None


def test_what_fails_is_the_worst():
    search = cmaes_search(box(4), 1, 12, 0.3)

    def wall(points):
        return np.where(points[:, 0] > 0.6, np.nan, sphere(points))

    batches = run(search, 30, wall)
    late = np.concatenate([search.space.to_unit(batch.parameters) for batch in batches[15:]])
    assert np.all(late[:, 0] < 0.6)
    assert search.best(1)[0].objective < 1e-3


def test_it_goes_on_while_every_string_fails():
    search = cmaes_search(box(4), 1, 6, 0.3)
    strings = np.concatenate(
        [batch.parameters for batch in run(search, 5, lambda points: np.full(len(points), np.inf))]
    )
    assert np.isfinite(strings).all()
    assert len(np.unique(strings, axis=0)) == 30
    assert search.population_ids.tolist() == list(range(6))


def test_it_follows_the_strings_as_they_were_evaluated():
    one, other = (cmaes_search(box(4), 1, 6, 0.3) for _ in range(2))
    strings = one.ask().parameters
    one.tell(judged(np.arange(6), strings, np.arange(6.0)))
    other.tell(judged(np.arange(6), strings[::-1], np.arange(6.0)))
    assert not np.array_equal(one.ask().parameters, other.ask().parameters)
