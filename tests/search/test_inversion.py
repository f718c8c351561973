import hashlib
import random

import numpy as np
import pytest
from goals import growth_target
from hypothesis import given, settings
from hypothesis import strategies as st
from rules import difference, ensemble_of, half_width
from search_fakes import PARTICLES, Decisions, completed, failed, unit_box
from searches import genetic_search

from agglom_mpi.search.ending import Generations, MeanOfBest, any_of
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import (
    GenerationSummary,
    StringEvaluated,
    StringsProposed,
)

SEED = 11


def simulate(parameters, sample):
    """Return what a rank would: a pure function of string and sample, noisy, failing at times."""
    digest = hashlib.sha256(parameters.tobytes()).digest()[:8]
    rng = np.random.default_rng([int.from_bytes(digest, "little"), sample])
    if rng.random() < 0.03:
        return failed()
    return completed(1.0 + np.sum(parameters[:3]) * rng.normal(1.0, 0.1), rng.integers(1, 101))


class History(Decisions):
    """Write down all that is decided, the order within a generation left out."""

    def proposed_ahead(self, batch, ids):
        raise AssertionError("nobody asked for strings of coming generations")

    def proposed(self, batch, ids):
        assert ids[0] == sum(len(earlier.parameters) for earlier, _ in self.batches)
        self.batches.append((batch, ids))


def inversion(generations=4, target=None, restore=None, rule=None):
    search = genetic_search(unit_box(), SEED, population=8, parents=2, rescale=(2, 0.5))
    rule = rule or difference(0.02)

    def ensemble(string):
        return ensemble_of(rule, growth_target(), PARTICLES, 2, 12)

    last = Generations(generations=generations)
    ending = last if target is None else any_of(target, last)
    return Inversion(search, ensemble, ending, restore), History()


def serve_in_order(process, history):
    """Compute what is needed next, nothing else: a single rank."""
    history.start(process)
    while not process.finished:
        string, progress = next(iter(process.open_strings.items()))
        outcome = simulate(process.parameters(string), progress.next_sample)
        history.complete(process, string, progress.next_sample, [outcome])


@pytest.fixture(scope="module")
def reference():
    process, history = inversion()
    serve_in_order(process, history)
    return history.text()


def serve_at_random(process, history, chance, ahead, repeats):
    """Start tasks in any order, run ahead, deliver late, in any order and more than once."""
    history.start(process)
    flying, started = [], set()
    while not process.finished:
        open_tasks = [
            (string, sample)
            for string, progress in process.open_strings.items()
            for sample in range(progress.next_sample, progress.next_sample + 1 + ahead)
            if (string, sample) not in started
        ]
        if open_tasks and (not flying or chance.random() < 0.6):
            task = chance.choice(open_tasks)
            started.add(task)
            flying.extend([task] * chance.randint(1, 1 + repeats))
        else:
            string, sample = flying.pop(chance.randrange(len(flying)))
            history.complete(
                process, string, sample, [simulate(process.parameters(string), sample)]
            )
    for string, sample in flying:
        history.complete(process, string, sample, [simulate(process.parameters(string), sample)])


@given(st.integers(0, 2**32), st.integers(0, 30), st.integers(0, 2))
@settings(max_examples=20, derandomize=True, deadline=None)
def test_decisions_do_not_depend_on_the_order_of_arrival(reference, seed, ahead, repeats):
    process, history = inversion()
    serve_at_random(process, history, random.Random(seed), ahead, repeats)
    assert history.text() == reference


def test_a_resume_may_hand_over_everything_before_the_start(reference):
    process, history = inversion()
    serve_in_order(process, history)
    rows = [(string, sample) for string in history.results for sample in range(12)]
    random.Random(3).shuffle(rows)
    outcomes = {row: simulate(process.parameters(row[0]), row[1]) for row in rows}
    resumed, replayed = inversion()
    for row in rows:
        replayed.complete(resumed, *row, [outcomes[row]])
    assert not replayed.batches
    replayed.start(resumed)
    assert resumed.finished
    assert replayed.text() == reference


def test_a_partial_resume_goes_on_to_the_same_end(reference):
    whole, history = inversion()
    serve_in_order(whole, history)
    resumed, replayed = inversion()
    for string in range(10):
        for sample in range(0, 12, 2):
            replayed.complete(resumed, string, sample, [simulate(whole.parameters(string), sample)])
    serve_in_order(resumed, replayed)
    assert replayed.text() == reference


def test_evaluations_and_samples_are_counted():
    process, history = inversion()
    serve_in_order(process, history)
    assert process.ended_by == Generations(generations=4)
    assert [summary.generation for summary in history.summaries] == [0, 1, 2, 3]
    assert [summary.evaluations for summary in history.summaries] == [8, 14, 20, 26]
    used = [sum(history.results[i].samples_used for i in range(n)) for n in (8, 14, 20, 26)]
    assert [summary.samples_used for summary in history.summaries] == used
    assert process.results == history.results


def test_a_summary_shows_the_best_string_with_its_error_and_the_mean_of_the_parents():
    process, history = inversion()
    serve_in_order(process, history)
    for summary in history.summaries:
        ranked = sorted((history.results[i].objective, i) for i in summary.population.tolist())
        assert (summary.objective, summary.best) == ranked[0]
        assert summary.standard_error == history.results[summary.best].standard_error
        assert summary.mean_of_top == (ranked[0][0] + ranked[1][0]) / 2


def test_a_generation_is_stored_before_it_can_be_dispatched():
    process, history = inversion()
    seen = []
    history.proposed = lambda batch, ids: seen.append((len(ids), list(process.open_strings)))
    assert not process.open_strings
    history.start(process)
    assert seen == [(8, [])]
    assert list(process.open_strings) == list(range(8))


def test_live_strings_show_what_is_judged_and_the_most_there_can_be():
    process, history = inversion(rule=half_width(1e-9))
    history.start(process)
    assert set(process.open_strings.values()) == {(0, 12)}
    history.complete(process, 3, 1, [completed(2.0)])
    assert process.open_strings[3] == (0, 12)
    history.complete(process, 3, 0, [completed(2.0)])
    assert process.open_strings[3] == (2, 12)


def test_the_first_copy_of_a_sample_wins():
    process, history = inversion(rule=half_width(1e-9))
    history.start(process)
    for sample, ratio in ((1, 2.0), (1, 9.0), (0, 2.0), (0, 9.0), (1, 9.0)):
        history.complete(process, 0, sample, [completed(ratio)])
    for sample in range(2, 5):
        history.complete(process, 0, sample, [completed(2.0)])
    assert process.results[0].mean_radius_ratio == 2.0


def test_samples_after_the_end_of_an_ensemble_are_not_used():
    process, history = inversion()
    history.start(process)
    for sample in (5, 4, 3, 2, 1, 0):
        history.complete(process, 0, sample, [completed(2.5 if sample < 2 else 9.0)])
    assert history.results[0].samples_used == 2
    assert history.results[0].objective == 0.25
    history.complete(process, 0, 6, [completed(9.0)])
    assert history.results[0].samples_used == 2


def test_the_mean_of_the_best_strings_stops_a_campaign_at_its_target():
    whole, history = inversion(generations=30)
    serve_in_order(whole, history)
    means = [summary.mean_of_top for summary in history.summaries]
    wanted = means[9]
    process, short = inversion(generations=30, target=MeanOfBest(top=2, objective=wanted))
    serve_in_order(process, short)
    reached = next(i for i, mean in enumerate(means) if mean <= wanted)
    assert process.ended_by == MeanOfBest(top=2, objective=wanted)
    assert len(short.summaries) == reached + 1
    assert not process.open_strings


def test_more_generations_begin_with_the_same_ones():
    short, long = inversion(generations=3), inversion(generations=5)
    for process, history in (short, long):
        serve_in_order(process, history)
    assert repr(long[1].summaries[:3]) == repr(short[1].summaries)


def test_a_resume_goes_by_the_stored_strings_not_by_the_proposed_ones():
    moved = 1e-9
    calls = []

    def restore(batch, first):
        calls.append((batch.generation, first))
        return batch._replace(parameters=np.clip(batch.parameters + moved, 0, 1))

    process, history = inversion(restore=restore)
    serve_in_order(process, history)
    assert calls == [(0, 0), (1, 8), (2, 14), (3, 20)]
    original, first = inversion()
    first.start(original)
    stored = np.clip(original.parameters(0) + moved, 0, 1)
    assert np.array_equal(process.parameters(0), stored)
    told = {
        int(string): parameters
        for batch, ids in history.batches
        for string, parameters in zip(ids, batch.parameters, strict=True)
    }
    # Offspring must descend from the stored strings: between both, moved once more themselves.
    batch, _ = history.batches[1]
    for child, (one, other) in zip(batch.parameters[:2], batch.parents[:2], strict=True):
        a, b = told[int(one)], told[int(other)]
        low, high = np.minimum(a, b), np.maximum(a, b)
        slack = 4 * np.finfo(float).eps
        assert np.all(child >= np.minimum(low + moved, 1) - slack)
        assert np.all(child <= np.minimum(high + moved, 1) + slack)


def test_a_campaign_in_which_everything_fails_still_ends():
    process, history = inversion(generations=2)
    history.start(process)
    while not process.finished:
        string, progress = next(iter(process.open_strings.items()))
        history.complete(process, string, progress.next_sample, [failed()])
    assert process.ended_by == Generations(generations=2)
    assert all(result.objective == np.inf for result in history.results.values())
    assert history.summaries[-1].objective == np.inf
    assert history.summaries[-1].best == 0


def test_decisions_come_in_order_and_none_is_made_before_it_is_asked_for():
    process, history = inversion(generations=2)
    whole = []
    history.record = lambda decisions: whole.extend(decisions)
    serve_in_order(process, history)
    kinds = [type(decision) for decision in whole]
    first = [StringsProposed, *[StringEvaluated] * 8, GenerationSummary]
    assert kinds == [*first, StringsProposed, *[StringEvaluated] * 6, GenerationSummary]
    resumed, replayed = inversion(generations=2)
    for string in range(8):
        outcomes = [simulate(process.parameters(string), sample) for sample in range(12)]
        replayed.complete(resumed, string, 0, outcomes)
    started = resumed.start()
    assert [type(next(started)) for _ in first] == first
    assert resumed.generation == 0, "the next generation is not proposed yet"
    assert type(next(started)) is StringsProposed
    assert resumed.generation == 1
