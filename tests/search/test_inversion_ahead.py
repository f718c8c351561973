"""Strings of coming generations that depend on no result, announced and judged ahead."""

import random

import numpy as np
import pytest
from goals import growth_target
from hypothesis import given, settings
from hypothesis import strategies as st
from rules import difference, ensemble_of
from search_fakes import PARTICLES, Decisions, completed, unit_box
from searches import genetic_search

from agglom_mpi.search.ending import Generations
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import RANDOM, Progress

GENERATIONS = 5
POPULATION, PARENTS = 8, 2
NEW = POPULATION - PARENTS
RANDOMS = NEW - PARENTS
"""New and random strings of each generation but the first."""


def simulate(parameters, sample):
    """Return what a rank would: a pure function of string and sample."""
    rng = np.random.default_rng([int(1e9 * parameters[0]), sample])
    return completed(1.0 + np.sum(parameters[:3]) * rng.normal(1.0, 0.1), rng.integers(1, 101))


class History(Decisions):
    """Write down what is announced, and all that is decided."""

    def __init__(self):
        super().__init__()
        self.ahead = []

    def proposed_ahead(self, batch, ids):
        self.ahead.append((batch, ids.tolist()))

    def proposed(self, batch, ids):
        self.batches.append((batch, ids.tolist()))

    def evaluated(self, string, result):
        assert string <= self.batches[-1][1][-1], "of a generation that has not come"
        super().evaluated(string, result)


def inversion(rescale=None, restore=None, generations=GENERATIONS):
    search = genetic_search(unit_box(), 11, population=POPULATION, parents=PARENTS, rescale=rescale)

    def ensemble(string):
        return ensemble_of(difference(0.02), growth_target(), PARTICLES, 2, 12)

    return Inversion(
        search, ensemble, Generations(generations=generations), restore=restore
    ), History()


def give(process, history, string, sample):
    history.complete(process, string, sample, [simulate(process.parameters(string), sample)])


def complete_ahead(process, history, string):
    """Give an announced string its samples until it needs no more."""
    while (progress := process.progress(string)) is not None:
        give(process, history, string, progress.next_sample)


def serve(process, history):
    """Compute what is needed next, nothing else."""
    while not process.finished:
        string, progress = next(iter(process.open_strings.items()))
        give(process, history, string, progress.next_sample)


@pytest.fixture(scope="module")
def reference():
    """Return what is decided where nothing is announced."""
    histories = {}
    for rescale in (None, (2, 0.5)):
        process, histories[rescale] = inversion(rescale)
        histories[rescale].start(process)
        serve(process, histories[rescale])
    return histories


def test_announced_are_the_random_strings_of_the_next_generation_that_is_not(reference):
    process, history = inversion()
    history.start(process)
    for generation in range(1, 4):
        first = POPULATION + (generation - 1) * NEW + PARENTS
        assert history.propose_ahead(process, 3) == list(range(first, first + RANDOMS))
        batch, ids = history.ahead[-1]
        assert (batch.generation, ids[0]) == (generation, first)
        proposed, numbers = reference[None].batches[generation]
        bred = proposed.origin != RANDOM
        assert ids == [n for n, child in zip(numbers, bred, strict=True) if not child]
        for name in ("parameters", "slot", "origin", "parents"):
            stored, wanted = getattr(batch, name), getattr(proposed, name)[~bred]
            assert stored.tobytes() == wanted.astype(stored.dtype).tobytes()
        for string, parameters in zip(ids, batch.parameters, strict=True):
            assert process.parameters(string).tobytes() == parameters.tobytes()
            assert process.progress(string) == Progress(0, 12)
            assert string not in process.open_strings
    assert history.propose_ahead(process, 3) == [], "at most three ahead"
    assert list(history.propose_ahead(process, 4)) == list(
        range(POPULATION + 3 * NEW + PARENTS, 32)
    )
    assert history.propose_ahead(process, 9) == [], "there are only so many generations"


def test_nothing_is_announced_at_the_end():
    process, history = inversion(generations=1)
    history.start(process)
    assert history.propose_ahead(process, 4) == []
    serve(process, history)
    assert history.propose_ahead(process, 4) == []


def test_strings_of_a_box_that_will_change_are_announced_when_it_has():
    process, history = inversion((2, 0.5))
    history.start(process)
    assert len(history.propose_ahead(process, 4)) == RANDOMS
    assert history.propose_ahead(process, 4) == []
    while process.generation < 2:
        string, progress = next(iter(process.open_strings.items()))
        give(process, history, string, progress.next_sample)
    assert len(history.propose_ahead(process, 4)) == RANDOMS
    assert [batch.generation for batch, _ in history.ahead] == [1, 3]


@pytest.mark.parametrize("rescale", [None, (2, 0.5)])
def test_strings_judged_ahead_get_the_results_that_they_would_have_got(reference, rescale):
    process, history = inversion(rescale)
    history.start(process)
    ahead = []
    while not process.finished:
        while strings := history.propose_ahead(process, 4):
            for string in strings:
                complete_ahead(process, history, string)
                ahead.append(string)
                assert string not in history.results, "not before its generation"
                assert (
                    process.samples_used(string) == reference[rescale].results[string].samples_used
                )
        string, progress = next(iter(process.open_strings.items()))
        assert string not in ahead, "it is not live, having been judged"
        give(process, history, string, progress.next_sample)
    assert len(ahead) == RANDOMS * (4 if rescale is None else 2)
    assert history.text() == reference[rescale].text()
    assert process.results == history.results


def test_a_string_half_judged_ahead_goes_on_where_it_was():
    process, history = inversion()
    history.start(process)
    [string, *_] = history.propose_ahead(process, 1)
    give(process, history, string, 0)
    give(process, history, string, 2)
    assert process.progress(string) == Progress(1, 12)
    while process.generation == 0:
        live, progress = next(iter(process.open_strings.items()))
        give(process, history, live, progress.next_sample)
    assert process.open_strings[string] == Progress(1, 12)
    give(process, history, string, 1)
    assert string not in process.open_strings or process.open_strings[string] == Progress(3, 12)


def test_outcomes_that_come_before_their_string_is_announced_count(reference):
    strings = list(range(POPULATION, POPULATION + NEW))
    ids = reference[None].batches[1][1]
    assert ids == strings
    process, history = inversion()
    rows = dict(zip(ids, reference[None].batches[1][0].parameters, strict=True))
    for string in strings[PARENTS:]:
        used = reference[None].results[string].samples_used
        outcomes = [simulate(rows[string], sample) for sample in range(used)]
        history.complete(process, string, 1, outcomes[1:])
        history.complete(process, string, 0, outcomes[:1])
    history.start(process)
    announced = history.propose_ahead(process, 1)
    assert list(announced) == strings[PARENTS:]
    for string in announced:
        assert process.progress(string) is None
        assert process.samples_used(string) == reference[None].results[string].samples_used
    serve(process, history)
    assert history.text() == reference[None].text()


def test_samples_after_the_end_of_a_string_judged_ahead_are_not_kept():
    process, history = inversion()
    history.start(process)
    [string, *_] = history.propose_ahead(process, 1)
    complete_ahead(process, history, string)
    used = process.samples_used(string)
    history.complete(process, string, used, [completed(99.0)] * 5)
    assert process.samples_used(string) == used
    serve(process, history)
    assert history.results[string].samples_used == used


def test_a_resume_announces_the_stored_strings_not_the_proposed_ones():
    moved, calls = 1e-9, []

    def restore(batch, first):
        calls.append((batch.generation, first))
        return batch._replace(parameters=np.clip(batch.parameters + moved, 0, 1))

    process, history = inversion(restore=restore)
    history.start(process)
    strings = history.propose_ahead(process, 1)
    assert calls == [(0, 0), (1, POPULATION + PARENTS)]
    original, first = inversion()
    first.start(original)
    first.propose_ahead(original, 1)
    stored = {string: process.parameters(string) for string in strings}
    for string in strings:
        wanted = np.clip(original.parameters(string) + moved, 0, 1)
        assert stored[string].tobytes() == wanted.tobytes()
        complete_ahead(process, history, string)
    serve(process, history)
    for string in strings:
        assert process.parameters(string).tobytes() == stored[string].tobytes()
    batch, ids = history.batches[1]
    told = batch.parameters[[ids.index(string) for string in strings]]
    assert told.tobytes() == np.array(list(stored.values())).tobytes()


@given(st.integers(0, 2**32), st.sampled_from([None, (2, 0.5)]), st.integers(0, 5))
@settings(derandomize=True, deadline=None, max_examples=15)
def test_decisions_depend_neither_on_announcements_nor_on_the_order(
    reference, seed, rescale, ahead
):
    chance = random.Random(seed)
    process, history = inversion(rescale)
    history.start(process)
    announced = []
    while not process.finished:
        if chance.random() < 0.1:
            announced += history.propose_ahead(process, ahead)
        strings = [
            s for s in (*process.open_strings, *announced) if process.progress(s) is not None
        ]
        string = chance.choice(strings)
        judged = process.progress(string).next_sample
        first, count = judged + chance.choice([0, 0, 1, 3]), chance.randint(1, 4)
        parameters = process.parameters(string)
        outcomes = [simulate(parameters, sample) for sample in range(first, first + count)]
        history.complete(process, string, first, outcomes)
    assert history.text() == reference[rescale].text()
