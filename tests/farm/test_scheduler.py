import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agglom_mpi.farm.messages import MOST_TASKS
from agglom_mpi.farm.scheduler import MESSAGES_IN_FLIGHT, Scheduler
from agglom_mpi.search.ensembles import Ensemble
from agglom_mpi.search.genetic import GeneticSearch
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.objectives import GrowthTarget
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.stopping import SuccessiveDifference
from agglom_mpi.simulation.outcome import COMPLETED, OUTCOME
from agglom_mpi.variables import COUNT

MAX_SAMPLES = 9
GENERATIONS = 3


class Decisions:
    """An observer that keeps what was decided."""

    def __init__(self):
        self.results, self.summaries, self.strings = {}, [], []

    def proposed(self, batch, ids):
        self.strings.append(batch.parameters.tobytes())

    def judged(self, string, result):
        self.results[string] = tuple(result)

    def generation_done(self, summary):
        self.summaries.append((summary.generation, summary.best, summary.population.tolist()))

    def everything(self):
        return self.strings, sorted(self.results.items()), self.summaries


def campaign():
    decisions = Decisions()
    search = GeneticSearch(
        SearchSpace(np.zeros(COUNT), np.ones(COUNT)), seed=5, population=6, parents=2
    )
    inversion = Inversion(
        search,
        lambda: Ensemble(SuccessiveDifference(0.02), GrowthTarget(), 100, 2, MAX_SAMPLES),
        GENERATIONS,
        None,
        None,
        decisions,
    )
    return inversion, decisions


def simulated(parameters, sample):
    """Return the outcome of a sample: a pure function of the string and the number."""
    record = np.zeros((), OUTCOME)
    noise = np.random.default_rng([int(1e6 * parameters[0]), sample]).normal(1.0, 0.05)
    record["state"], record["particles"] = COMPLETED, 50
    record["mean_radius_ratio"] = (1.0 + parameters[:2].sum()) * noise
    return record[()]


def serve(ranks, chance, known=(), seconds=lambda chance: 1e-3):
    """Drive a campaign with ranks as slow as chance wants; what was handed out and decided."""
    inversion, decisions = campaign()
    for string, sample, outcome in known:
        inversion.accept(string, sample, outcome)
    inversion.start()
    scheduler = Scheduler(inversion, ranks, [pair[:2] for pair in known])
    held = [[] for _ in range(ranks)]
    handed = []
    idle = 0
    while not inversion.finished:
        rank = chance.randrange(ranks)
        if held[rank] and chance.random() < 0.5:
            idle = 0
            for string, sample in held[rank].pop(0):
                scheduler.returned(rank, string, sample, seconds(chance))
                outcome = simulated(inversion.parameters(string), sample)
                inversion.accept(string, sample, outcome)
            continue
        tasks = scheduler.assign(rank)
        live = inversion.live
        for task in tasks:
            string, sample = int(task["string"]), int(task["sample"])
            assert string in live
            assert live[string].next_sample <= sample < live[string].max_samples
            assert task["parameters"].tobytes() == inversion.parameters(string).tobytes()
            handed.append((string, sample))
        if len(tasks):
            held[rank].append(tasks[["string", "sample"]].tolist())
        assert len(tasks) <= MOST_TASKS
        assert len(held[rank]) <= MESSAGES_IN_FLIGHT
        assert scheduler.in_flight == sum(len(batch) for queue in held for batch in queue)
        idle = 0 if len(tasks) else idle + 1
        assert idle < 200 * ranks, "nothing is handed out and nothing comes back"
    return handed, decisions


@pytest.fixture(scope="module")
def reference():
    return serve(1, random.Random(0))[1].everything()


@given(st.integers(1, 9), st.integers(0, 2**32), st.sampled_from([1e-5, 1e-3, 1.0]))
@settings(max_examples=60, deadline=None)
def test_every_schedule_ends_with_the_same_decisions(reference, ranks, seed, typical):
    """Each sample is handed out once, in the order of its string, and no needed one is left out."""
    handed, decisions = serve(
        ranks, random.Random(seed), seconds=lambda chance: typical * chance.random()
    )
    assert len(set(handed)) == len(handed)
    by_string = {}
    for string, sample in handed:
        assert sample == by_string.get(string, 0)
        by_string[string] = sample + 1
    for string, result in decisions.results.items():
        assert result[3] <= by_string[string]  # samples_used
    assert decisions.everything() == reference


@given(st.integers(1, 5), st.integers(0, 2**32), st.floats(0.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_known_samples_are_never_handed_out(reference, ranks, seed, share):
    chance = random.Random(seed)
    inversion, _ = campaign()
    inversion.start()
    known = [
        (string, sample, simulated(inversion.parameters(string), sample))
        for string in inversion.live
        for sample in range(MAX_SAMPLES)
        if chance.random() < share
    ]
    handed, decisions = serve(ranks, chance, known)
    pairs = {(string, sample) for string, sample, _ in known}
    assert pairs.isdisjoint(handed)
    assert len(set(handed)) == len(handed)
    assert decisions.everything() == reference


def test_the_string_whose_judgement_is_nearest_comes_first():
    inversion, _ = campaign()
    inversion.start()
    scheduler = Scheduler(inversion, 1)
    first, second = scheduler.assign(0), scheduler.assign(0)
    assert (first["string"].item(), first["sample"].item()) == (0, 0)
    assert (second["string"].item(), second["sample"].item()) == (1, 0)
    scheduler.returned(0, 0, 0, 1.0)
    inversion.accept(0, 0, simulated(inversion.parameters(0), 0))
    third = scheduler.assign(0)
    assert (third["string"].item(), third["sample"].item()) == (0, 1)


def test_a_rank_gets_no_more_than_it_can_hold():
    inversion, _ = campaign()
    inversion.start()
    scheduler = Scheduler(inversion, 2)
    counts = [len(scheduler.assign(0)) for _ in range(MESSAGES_IN_FLIGHT + 1)]
    assert counts == [1] * MESSAGES_IN_FLIGHT + [0]
    assert len(scheduler.assign(1)) == 1


def test_short_samples_travel_together_and_long_ones_alone():
    for seconds, wanted in ((1e-9, 6 * MAX_SAMPLES - 1), (1e-3, 5), (10.0, 1)):
        inversion, _ = campaign()
        inversion.start()
        scheduler = Scheduler(inversion, 1)
        task = scheduler.assign(0)[0]
        scheduler.returned(0, int(task["string"]), int(task["sample"]), seconds)
        assert len(scheduler.assign(0)) == min(wanted, MOST_TASKS)


def test_more_ranks_than_samples_leave_some_without_work():
    inversion, _ = campaign()
    inversion.start()
    scheduler = Scheduler(inversion, 100)
    tasks = [scheduler.assign(rank) for rank in range(100)]
    assert sum(map(len, tasks)) == 6 * MAX_SAMPLES
    assert max(int(task["sample"][0]) for task in tasks if len(task)) == MAX_SAMPLES - 1
    assert len(tasks[-1]) == 0
