"""Parents that get more samples in every generation that they survive."""

import random

import numpy as np
import pytest
from goals import growth_target
from rules import fixed
from search_fakes import PARTICLES, Decisions, completed, failed, judged, unit_box
from searches import genetic_search

from agglom_mpi.search.ending import Generations
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import AGAIN, OFFSPRING, RANDOM

TARGET = growth_target(2.0)


def ensemble(samples):
    return Ensemble(fixed(samples), TARGET, PARTICLES)


def fed(ensemble, outcomes):
    for outcome in outcomes:
        ensemble.add(outcome)
    return ensemble.result()


def test_an_ensemble_that_goes_on_is_worth_what_all_its_samples_are():
    outcomes = [completed(r) for r in np.random.default_rng(0).uniform(1.0, 3.0, 30)]
    first = ensemble(12)
    fed(first, outcomes[:12])
    second = first.resample(10)
    fed(second, outcomes[12:22])
    last = fed(second.resample(8), outcomes[22:])
    whole = fed(ensemble(30), outcomes)
    assert last._replace(samples_used=30) == whole
    assert last.samples_used == 8
    assert first.result().samples_used == 12


def test_going_on_changes_nothing_of_what_was():
    before = ensemble(3)
    result = fed(before, [completed(1.5), completed(2.5), failed()])
    fed(before.resample(2), [failed(), failed()])
    assert before.result() == result


def test_failures_of_all_samples_decide_whether_a_string_is_given_up():
    good = ensemble(60)
    fed(good, [completed(2.0 + 0.01 * k) for k in range(60)])
    assert np.isfinite(fed(good.resample(5), [failed()] * 5).objective)
    bad = ensemble(5)
    fed(bad, [completed(2.0)] * 5)
    assert fed(bad.resample(5), [failed()] * 5).objective == np.inf


def test_each_failed_sample_is_counted_in_one_result():
    first = ensemble(20)
    assert fed(first, [failed()] + [completed(2.0)] * 19).failed == 1
    assert fed(first.resample(5), [completed(2.0)] * 4 + [failed()]).failed == 1


def worth(strings):
    return np.abs(strings[:, 0] - 0.3)


def test_parents_come_first_and_all_strings_are_new():
    search = genetic_search(unit_box(), 5, population=10, parents=4, again=True)
    batch = search.ask()
    search.tell(judged(np.arange(10), batch.parameters, worth(batch.parameters)))
    kept = [ranked.string for ranked in search.best(4)]
    second = search.ask()
    assert second.slot.tolist() == list(range(10))
    assert second.origin.tolist() == [AGAIN] * 4 + [OFFSPRING] * 4 + [RANDOM] * 2
    assert second.parents[:4].tolist() == [[string, -1] for string in kept]
    assert np.array_equal(second.parameters[:4], batch.parameters[kept])
    search.tell(judged(np.arange(10, 20), second.parameters, worth(second.parameters)))
    assert sorted(search.population_ids) == list(range(10, 20))


@pytest.mark.parametrize("again", [False, True])
def test_random_strings_are_known_by_the_numbers_that_they_will_have(again):
    search, count = genetic_search(unit_box(), 5, population=10, parents=4, again=again), 0
    ahead = [search.known_proposals(generation) for generation in range(4)]
    for first, batch in ahead:
        asked = search.ask()
        ids = np.arange(count, count + len(asked.parameters))
        count += len(ids)
        assert np.array_equal(asked.parameters[first - ids[0] :], batch.parameters)
        assert first + len(batch.parameters) == count
        search.tell(judged(ids, asked.parameters, worth(asked.parameters)))


def test_without_it_everything_is_as_published():
    one, other = (genetic_search(unit_box(), 5), genetic_search(unit_box(), 5, again=False))
    assert all(map(np.array_equal, one.ask(), other.ask()))


class History(Decisions):
    def proposed(self, batch, ids):
        self.batches.append((batch, ids.tolist()))


def inverted(noise, seed=1, more=None, shuffle=None, generations=12):
    """Search a flat objective of noisy samples; the history."""

    def sample(string, number):
        rng = np.random.default_rng([seed, string, number])
        return completed(2.0 * (1.3 + noise * rng.standard_normal()))

    history = History()
    inversion = Inversion(
        genetic_search(unit_box(), seed, population=10, parents=4, again=more is not None),
        lambda string: ensemble(4),
        Generations(generations=generations),
        more_samples=more or 1,
    )
    history.start(inversion)
    while not inversion.finished:
        needs = [(s, p.next_sample) for s, p in inversion.open_strings.items()]
        if shuffle is not None:
            history.propose_ahead(inversion, 2)
            needs = [(s, n + k) for s, n in needs for k in range(3)]
            shuffle.shuffle(needs)
        for string, number in needs:
            history.complete(inversion, string, number, [sample(string, number)])
    return history


@pytest.mark.slow
def test_luck_does_not_survive():
    """All strings are worth 0.3: what the best claims is nothing but luck."""
    best = [inverted(0.1, seed).summaries[-1].objective for seed in range(30)]
    again = [inverted(0.1, seed, more=4).summaries[-1].objective for seed in range(30)]
    luck, left = 0.3 - np.array(best), 0.3 - np.array(again)
    error = np.hypot(luck.std(ddof=1), left.std(ddof=1)) / np.sqrt(30)
    assert left.mean() < luck.mean() - 4.0 * error


def test_the_error_of_a_survivor_shrinks_with_its_samples():
    history = inverted(0.1, more=4)
    lives = {}
    for batch, ids in history.batches:
        for string, origin, parents in zip(ids, batch.origin, batch.parents, strict=True):
            lives[string] = lives[parents[0]] + 1 if origin == AGAIN else 1
    old = [string for string, age in lives.items() if age >= 4]
    assert old
    errors = np.array([history.results[string].standard_error for string in old])
    samples = 4 * np.array([lives[string] for string in old])
    # Of n normal samples the standard deviation is known to a share of 1/sqrt(2n) or better.
    assert np.all(np.abs(errors * np.sqrt(samples) / 0.1 - 1.0) < 5.0 / np.sqrt(2.0 * samples))


@pytest.mark.parametrize("seed", range(5))
def test_no_order_of_arrival_changes_a_decision(seed):
    def decided(history):
        return repr((sorted(history.results.items()), history.summaries))

    shuffled = inverted(0.1, more=3, shuffle=random.Random(seed), generations=5)
    assert decided(shuffled) == decided(inverted(0.1, more=3, generations=5))
