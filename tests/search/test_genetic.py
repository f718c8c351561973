import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_fakes import judged, papers_box, unit_box
from searches import genetic_search

from agglom_mpi.search.proposals import NO_PARENT, OFFSPRING, RANDOM
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN


def bowl(strings):
    """Distance from the middle of the unit box: a smooth objective with one minimum."""
    return np.sqrt(np.sum((strings - 0.5) ** 2, axis=1))


def run(search, generations, worth=bowl):
    """Drive a search and return its batches, each with the numbers of its strings."""
    history, count = [], 0
    for _ in range(generations):
        batch = search.ask()
        ids = np.arange(count, count + len(batch.parameters))
        count += ids.size
        history.append((batch, ids))
        search.tell(judged(ids, batch.parameters, worth(batch.parameters)))
    return history


@pytest.mark.parametrize(("generations", "evaluations"), [(1, 20), (22, 314), (25, 356)])
def test_a_campaign_evaluates_as_many_strings_as_the_papers_say(generations, evaluations):
    history = run(genetic_search(unit_box(), seed=1), generations)
    assert sum(ids.size for _, ids in history) == evaluations
    assert evaluations == 20 + (generations - 1) * (20 - 6)


def test_the_first_generation_is_all_random():
    batch = genetic_search(papers_box(), seed=1).ask()
    assert batch.generation == 0
    assert batch.slot.tolist() == list(range(20))
    assert np.all(batch.origin == RANDOM)
    assert np.all(batch.parents == NO_PARENT)
    assert np.isnan(batch.parameters[:, 9]).all()


def test_a_population_is_kept_parents_then_offspring_then_random_strings():
    search = genetic_search(unit_box(), seed=1)
    run(search, 1)
    parents = [ranked.string for ranked in search.best(6)]
    batch = search.ask()
    assert batch.generation == 1
    assert batch.slot.tolist() == list(range(6, 20))
    assert batch.origin.tolist() == [OFFSPRING] * 6 + [RANDOM] * 8
    search.tell(judged(np.arange(20, 34), batch.parameters, bowl(batch.parameters)))
    assert search.population_ids.tolist() == parents + list(range(20, 34))


def test_neighbours_in_rank_mate_and_have_two_offspring_each():
    search = genetic_search(unit_box(), seed=1)
    run(search, 3)
    first, second, third, fourth, fifth, sixth = (ranked.string for ranked in search.best(6))
    pairs = [[first, second]] * 2 + [[third, fourth]] * 2 + [[fifth, sixth]] * 2
    batch = search.ask()
    assert batch.parents[:6].tolist() == pairs
    assert np.all(batch.parents[6:] == NO_PARENT)


def blends(blend):
    """Return the blending numbers of every component of many offspring."""
    search = genetic_search(unit_box(), seed=3, population=80, parents=40, blend=blend)
    ((first, _),) = run(search, 1)
    batch = search.ask()
    a, b = (first.parameters[batch.parents[:40, side]] for side in (0, 1))
    return (batch.parameters[:40] - b) / (a - b), batch.parameters[:40]


@given(st.integers(0, 2**40))
@settings(max_examples=25, derandomize=True, deadline=None)
def test_offspring_lie_between_their_parents_in_every_component(seed):
    search = genetic_search(papers_box(), seed)
    rng = np.random.default_rng(seed)
    history = run(search, 1, lambda strings: rng.random(len(strings)))
    first = history[0][0].parameters[:, :9]
    batch = search.ask()
    children = batch.parameters[:6, :9]
    a, b = first[batch.parents[:6, 0]], first[batch.parents[:6, 1]]
    # One subtraction, product and sum, each rounded once.
    slack = 4 * np.finfo(float).eps * np.maximum(abs(a), abs(b))
    assert np.all(children >= np.minimum(a, b) - slack)
    assert np.all(children <= np.maximum(a, b) + slack)


def test_every_component_of_every_offspring_has_its_own_blend():
    phi, _ = blends((0.0, 1.0))
    assert np.unique(np.round(phi, 9)).size == phi.size


def test_blends_are_uniform_on_their_range():
    phi, _ = blends((0.0, 1.0))
    # Mean of n uniform numbers: standard deviation 1/sqrt(12 n).
    assert abs(np.mean(phi) - 0.5) < 4 / np.sqrt(12 * phi.size)


def test_a_blend_beyond_one_mutates_out_of_the_hull_but_never_out_of_the_box():
    phi, children = blends((-1.0, 2.0))
    assert np.any(phi < -0.01)
    assert np.any(phi > 1.01)
    assert np.all((children >= 0) & (children <= 1))
    assert np.any((children == 0) | (children == 1))


def test_fixed_components_stay_exact_through_blending():
    lower, upper = np.zeros(TEN.count), np.ones(TEN.count)
    lower[4] = upper[4] = 0.1
    search = genetic_search(SearchSpace(lower, upper), seed=1, blend=(-0.5, 1.5))
    for batch, _ in run(search, 5):
        assert np.all(batch.parameters[:, 4] == 0.1)


@given(st.integers(0, 2**40))
@settings(max_examples=25, derandomize=True, deadline=None)
def test_keeping_the_parents_makes_the_best_monotone_and_the_top_the_best_ever_seen(seed):
    search, rng = genetic_search(unit_box(), seed), np.random.default_rng(seed)
    seen, before = [], np.inf
    for generation in range(6):
        batch = search.ask()
        objectives = rng.random(len(batch.parameters))
        seen.extend(objectives)
        search.tell(
            judged(np.arange(len(seen) - objectives.size, len(seen)), batch.parameters, objectives)
        )
        best = search.best(6)
        assert [ranked.objective for ranked in best] == sorted(seen)[:6]
        assert all(seen[ranked.string] == ranked.objective for ranked in best)
        assert best[0].objective <= before
        assert search.mean_of_top(6) == pytest.approx(np.mean(sorted(seen)[:6]), rel=1e-14)
        assert search.generation == generation + 1
        before = best[0].objective


def test_ties_are_ranked_by_string_number():
    search = genetic_search(unit_box(), seed=1, population=200)
    objectives = np.arange(200) % 3
    search.tell(judged(np.arange(200), search.ask().parameters, objectives))
    best = search.best(200)
    assert best == sorted(best, key=lambda ranked: (ranked.objective, ranked.string))


def test_what_is_not_finite_ranks_last():
    search = genetic_search(unit_box(), seed=1)
    batch = search.ask()
    objectives = np.arange(20.0)
    objectives[[0, 1, 2]] = np.nan, np.inf, -np.inf
    search.tell(judged(np.arange(20), batch.parameters, objectives))
    assert [ranked.string for ranked in search.best(20)] == [*range(3, 20), 0, 1, 2]
    assert search.mean_of_top(18) == np.inf


def test_asking_again_changes_nothing():
    search = genetic_search(unit_box(), seed=1)
    run(search, 2)
    for first, again in zip(search.ask(), search.ask(), strict=True):
        assert np.array_equal(first, again)


@given(st.integers(0, 2**40), st.randoms(use_true_random=False))
@settings(max_examples=25, derandomize=True, deadline=None)
def test_the_order_of_a_tell_does_not_matter(seed, shuffler):
    one, other = (genetic_search(papers_box(), seed, rescale=(2, 0.5)) for _ in range(2))
    rng, count = np.random.default_rng(seed), 0
    for _ in range(5):
        batch, twin = one.ask(), other.ask()
        for first, second in zip(batch, twin, strict=True):
            assert np.array_equal(first, second, equal_nan=True)
        ids = np.arange(count, count + len(batch.parameters))
        count += ids.size
        objectives = np.round(rng.random(ids.size), 1)
        one.tell(judged(ids, batch.parameters, objectives))
        order = shuffler.sample(range(ids.size), ids.size)
        other.tell(judged(ids[order], batch.parameters[order], objectives[order]))
        assert np.array_equal(one.population_ids, other.population_ids)
        assert one.best(20) == other.best(20)


def test_other_seeds_propose_other_strings():
    one, other = (genetic_search(unit_box(), seed).ask().parameters for seed in (1, 2))
    assert np.all(one != other)


def test_strings_of_different_slots_and_generations_differ():
    history = run(genetic_search(unit_box(), seed=1), 4)
    randoms = np.concatenate([batch.parameters[batch.origin == RANDOM] for batch, _ in history])
    assert np.unique(randoms).size == randoms.size


def test_a_search_uses_the_parameters_it_is_told_not_those_it_proposed():
    search = genetic_search(unit_box(), seed=1)
    search.tell(judged(np.arange(20), np.full((20, TEN.count), 0.25), np.arange(20.0)))
    assert np.all(search.ask().parameters[:6] == 0.25)


def test_a_tell_of_another_size_is_refused():
    search = genetic_search(unit_box(), seed=1)
    with pytest.raises(ValueError, match="20 new strings"):
        search.tell(judged(np.arange(19), np.zeros((19, TEN.count)), np.zeros(19)))


@pytest.mark.parametrize(
    "wrong",
    [
        {"parents": 5},
        {"parents": 0},
        {"parents": 12},
        {"blend": (1.0, 0.0)},
        {"rescale": (0, 0.5)},
        {"rescale": (4, 0.0)},
        {"rescale": (4, 1.5)},
    ],
)
def test_settings_that_make_no_search_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        genetic_search(unit_box(), seed=1, **wrong)


def test_without_random_strings_a_population_is_parents_and_offspring():
    search = genetic_search(unit_box(), seed=1, population=12, parents=6)
    run(search, 1)
    assert search.ask().origin.tolist() == [OFFSPRING] * 6


def test_the_box_shrinks_around_the_best_after_every_so_many_generations():
    search = genetic_search(unit_box(), seed=1, rescale=(4, 0.5))
    expected, told = unit_box(), []
    for generation in range(10):
        if generation in (4, 8):
            expected = expected.around(told[search.best(1)[0].string], 0.5)
        assert np.array_equal(search.box.lower, expected.lower)
        assert np.array_equal(search.box.upper, expected.upper)
        batch = search.ask()
        randoms = batch.parameters[batch.origin == RANDOM]
        assert np.all((randoms >= expected.lower) & (randoms <= expected.upper))
        ids = np.arange(len(told), len(told) + len(batch.parameters))
        told.extend(batch.parameters)
        search.tell(judged(ids, batch.parameters, bowl(batch.parameters)))
    # Cut at the border, a box can only be narrower than the factors make it, to rounding.
    assert np.all(search.box.upper - search.box.lower <= 0.25 + np.finfo(float).eps)


def test_offspring_remain_free_outside_the_restricted_box():
    search = genetic_search(unit_box(), seed=1, blend=(-3.0, 4.0), rescale=(1, 0.01))
    run(search, 1)
    children = search.ask().parameters[:6]
    assert np.any((children < search.box.lower) | (children > search.box.upper))
    assert np.all((children >= 0) & (children <= 1))


def test_the_box_is_left_alone_while_every_string_has_failed():
    search = genetic_search(unit_box(), seed=1, rescale=(1, 0.5))
    run(search, 1, lambda strings: np.full(len(strings), np.inf))
    assert search.box is search.space


def test_random_strings_of_coming_generations_are_known_until_the_box_changes():
    search = genetic_search(unit_box(), seed=1, rescale=(3, 0.5))
    ahead = {generation: search.known_proposals(generation) for generation in range(6)}
    assert [generation for generation in range(6) if ahead[generation] is None] == [3, 4, 5]
    for batch, _ in run(search, 3):
        _, early = ahead[batch.generation]
        assert np.array_equal(early.parameters, batch.parameters[batch.origin == RANDOM])
        assert np.array_equal(early.slot, batch.slot[batch.origin == RANDOM])
    assert search.known_proposals(5) is not None
    assert search.known_proposals(6) is None


def test_without_rescaling_random_strings_are_known_for_ever():
    search = genetic_search(unit_box(), seed=1)
    _, early = search.known_proposals(7)
    batch, _ = run(search, 8)[-1]
    assert np.array_equal(early.parameters, batch.parameters[6:])


def test_the_search_finds_the_bottom_of_a_bowl():
    found, undirected = [], []
    for seed in range(12):
        search = genetic_search(unit_box(), seed=seed)
        everything = np.concatenate([batch.parameters for batch, _ in run(search, 25)])
        assert search.best(1)[0].objective == bowl(everything).min()
        found.append(search.best(1)[0].objective)
        random = np.random.default_rng(seed).random(everything.shape)
        undirected.append(bowl(random).min())
    ahead = np.mean(undirected) - np.mean(found)
    assert ahead > 4.0 * np.sqrt((np.var(undirected, ddof=1) + np.var(found, ddof=1)) / 12)
