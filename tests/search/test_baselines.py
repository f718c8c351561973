import numpy as np
import pytest
from scipy.stats import qmc
from search_fakes import judged, papers_box, unit_box
from searches import genetic_search, random_search, sobol_search

from agglom_mpi.random_streams import SOBOL_SCRAMBLE, search_stream
from agglom_mpi.search.methods.baselines import SOBOL_BITS, sobol_strings
from agglom_mpi.search.proposals import GIVEN, NO_PARENT, RANDOM
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN

METHODS = pytest.mark.parametrize("method", [random_search, sobol_search])


def batches(search, generations, worth=0.0):
    """Drive a search and return its batches."""
    found = []
    for _ in range(generations):
        found.append(batch := search.ask())
        ids = np.arange(len(batch.parameters)) + len(search)
        search.tell(judged(ids, batch.parameters, np.full(len(ids), worth)))
    return found


def strings_of(found):
    return np.concatenate([batch.parameters for batch in found])


def test_sobol_points_of_all_generations_are_one_scrambled_sequence():
    strings = strings_of(batches(sobol_search(unit_box(), 5, 7), 9))
    scramble = search_stream(5, SOBOL_SCRAMBLE, 0)
    wanted = qmc.Sobol(TEN.count, bits=SOBOL_BITS, rng=scramble).random(64)
    assert np.array_equal(strings[:63], wanted[:63])


def test_sobol_points_are_more_even_than_random_ones():
    spread = {
        method: [
            qmc.discrepancy(strings_of(batches(method(unit_box(), seed, 32), 4)))
            for seed in range(5)
        ]
        for method in (random_search, sobol_search)
    }
    assert max(spread[sobol_search]) < min(spread[random_search])


def test_random_strings_are_those_of_the_genetic_search_in_the_same_slots():
    ours = batches(random_search(papers_box(), 5, 12), 3)
    genetic = genetic_search(papers_box(), 5, 12, 4)
    assert np.array_equal(ours[0].parameters, genetic.ask().parameters, equal_nan=True)
    for generation in (1, 2):
        _, theirs = genetic.known_proposals(generation)
        assert np.array_equal(
            ours[generation].parameters[theirs.slot], theirs.parameters, equal_nan=True
        )


@METHODS
@pytest.mark.parametrize("count", [1, 3, 6])
def test_given_strings_come_first_and_the_rest_is_as_it_was(method, count):
    strings = np.random.default_rng(0).random((count, TEN.count))
    found = batches(method(unit_box(), 5, 6, strings), 2)
    plain = batches(method(unit_box(), 5, 6), 2)
    assert np.array_equal(found[0].parameters[:count], strings)
    assert found[0].origin.tolist() == [GIVEN] * count + [RANDOM] * (6 - count)
    assert found[0].slot.tolist() == list(range(6))
    assert np.array_equal(strings_of(found)[count:], strings_of(plain)[count:])


@METHODS
def test_nothing_depends_on_results_and_all_is_known_ahead(method):
    search = method(papers_box(), 5, 6)
    ahead = [search.known_proposals(generation) for generation in range(5)]
    assert [first for first, _ in ahead] == [0, 6, 12, 18, 24]
    for (_, early), batch in zip(ahead, batches(search, 5, np.inf), strict=True):
        assert all(np.array_equal(*pair, equal_nan=True) for pair in zip(early, batch, strict=True))
        assert np.all(batch.parents == NO_PARENT)


@METHODS
def test_the_best_of_all_strings_are_the_population(method):
    search, rng = method(unit_box(), 5, 6), np.random.default_rng(0)
    told = np.empty(0)
    for _ in range(4):
        values = np.where(rng.random(6) < 0.2, np.nan, rng.random(6))
        strings = search.ask().parameters
        search.tell(judged(np.arange(6) + len(told), strings, values))
        told = np.concatenate((told, values))
        order = np.lexsort((np.arange(len(told)), np.where(np.isnan(told), np.inf, told)))
        assert search.population_ids.tolist() == order[:6].tolist()
        best = search.best(1)[0]
        assert (best.string, best.objective) == (order[0], np.nanmin(told))
        assert search.mean_of_top(3) == pytest.approx(told[order[:3]].mean())


def test_points_are_spread_evenly_over_logarithms():
    lower, upper = np.full(TEN.count, 1e-3), np.full(TEN.count, 1e3)
    space = SearchSpace(lower, upper, logarithmic=np.arange(TEN.count) < 5)
    strings = sobol_strings(space, 1, 0, 64)
    assert np.all((strings >= lower) & (strings <= upper))
    # 64 points of a net have one in each 64th of every axis.
    cells = np.floor(64 * (np.log10(strings[:, :5]) + 3.0) / 6.0)
    assert all(sorted(column) == list(range(64)) for column in cells.T.tolist())
    assert np.all((strings[:, 5:] < 500.0).sum(axis=0) == 32)
