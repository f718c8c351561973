"""The genetic search in a box of which some variables are searched by their logarithms."""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest
from search_fakes import judged, papers_box
from searches import genetic_search

from agglom_mpi.search.proposals import GIVEN, RANDOM
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN

LOGARITHMIC = np.arange(TEN.count) % 2 == 0


def space():
    """Return a box of four decades; every other variable is searched by its logarithm."""
    return SearchSpace(np.full(TEN.count, 1e-2), np.full(TEN.count, 1e2), logarithmic=LOGARITHMIC)


def told(search, objectives=None, seed=0):
    """Tell a search of the strings that it asks for; the batch."""
    batch = search.ask()
    ids = np.arange(len(batch.parameters)) + (search.population_ids.max(initial=-1) + 1)
    values = np.random.default_rng(seed).random(len(ids)) if objectives is None else objectives
    search.tell(judged(ids, batch.parameters, values))
    return batch


def test_draws_are_uniform_in_the_logarithm_or_in_the_variable_itself():
    strings = genetic_search(space(), 3, population=2000, parents=4).ask().parameters
    shares = np.where(LOGARITHMIC, (np.log10(strings) + 2.0) / 4.0, (strings - 1e-2) / 99.99)
    for column in shares.T:
        # Four standard errors have a chance of 6e-5.
        assert kstest(column, "uniform").pvalue > 6e-5
    assert np.all(abs(shares.mean(axis=0) - 0.5) < 4.0 / np.sqrt(12 * 2000))


@given(st.integers(0, 2**40))
@settings(derandomize=True, deadline=None, max_examples=25)
def test_offspring_lie_between_their_parents_in_every_component(seed):
    search = genetic_search(space(), seed)
    first = told(search, seed=seed).parameters
    batch = search.ask()
    a, b = (first[batch.parents[:6, side]] for side in (0, 1))
    children = batch.parameters[:6]
    # Logarithms of up to 5 are rounded, and so are sums of them.
    slack = 1.0 + 50 * np.finfo(float).eps
    assert np.all(children >= np.minimum(a, b) / slack)
    assert np.all(children <= np.maximum(a, b) * slack)


def test_blends_are_uniform_in_the_logarithm():
    search = genetic_search(space(), 3, population=400, parents=200)
    first = told(search).parameters
    batch = search.ask()
    a, b = (space().scaled(first[batch.parents[:200, side]]) for side in (0, 1))
    blends = ((space().scaled(batch.parameters[:200]) - b) / (a - b))[:, LOGARITHMIC]
    assert kstest(blends.ravel(), "uniform").pvalue > 6e-5
    assert abs(blends.mean() - 0.5) < 4.0 / np.sqrt(12 * blends.size)


def test_equal_parents_have_equal_children_to_rounding():
    search = genetic_search(space(), 1)
    search.tell(judged(np.arange(20), np.full((20, TEN.count), 0.37), np.arange(20.0)))
    assert np.allclose(search.ask().parameters[:6], 0.37, rtol=4 * np.finfo(float).eps, atol=0.0)


def test_the_box_shrinks_around_the_best_in_the_logarithm():
    search = genetic_search(space(), 1, rescale=(1, 0.5))
    best = np.ones(TEN.count)
    search.tell(judged(np.arange(20), np.tile(best, (20, 1)), np.arange(20.0)))
    # Four decades halved are two; the others are cut off at the lower end.
    assert np.allclose(search.box.lower[LOGARITHMIC], 0.1, rtol=1e-14)
    assert np.allclose(search.box.upper[LOGARITHMIC], 10.0, rtol=1e-14)
    assert np.all(search.box.lower[~LOGARITHMIC] == 1e-2)
    assert np.allclose(search.box.upper[~LOGARITHMIC], 1.0 + 0.25 * 99.99, rtol=1e-14)
    randoms = search.ask().parameters[6:]
    assert np.all((randoms >= search.box.lower) & (randoms <= search.box.upper))


def test_given_strings_come_first_and_the_rest_is_as_it_was():
    strings = np.random.default_rng(0).uniform(1.0, 2.0, (3, TEN.count))
    batch, plain = genetic_search(space(), 1, given=strings).ask(), genetic_search(space(), 1).ask()
    assert np.array_equal(batch.parameters[:3], strings)
    assert np.array_equal(batch.parameters[3:], plain.parameters[3:])
    assert batch.origin.tolist() == [GIVEN] * 3 + [RANDOM] * 17
    assert batch.slot.tolist() == list(range(20))


@pytest.mark.exact_bits
@pytest.mark.parametrize(
    ("rescale", "digest"), [(None, "358b42b8486cb661"), ((2, 0.5), "5301f579eafd0541")]
)
def test_without_logarithms_no_bit_is_other_than_before_there_were_any(rescale, digest):
    search, strings = genetic_search(papers_box(), 11, blend=(-0.5, 1.5), rescale=rescale), []
    for generation in range(6):
        strings.append(told(search, seed=generation).parameters)
    found = hashlib.sha256(np.concatenate(strings).tobytes()).hexdigest()[:16]
    assert found == digest
