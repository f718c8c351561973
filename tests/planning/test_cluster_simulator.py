import math

import numpy as np
import pytest
from examples import examples
from goals import growth_target
from hypothesis import strategies as st
from rules import difference, ensemble_of, fixed
from searches import genetic_search, surrogate_search
from summary_rows import rows_of

from agglom_mpi.outcome import SampleSummary
from agglom_mpi.planning import cluster_simulator as virtual
from agglom_mpi.planning.cluster_simulator import (
    ClusterSimulator,
    CriticalPath,
    TooManySamples,
)
from agglom_mpi.planning.forecast import FREE, Forecast, MessageCosts
from agglom_mpi.scheduling.estimators import BATCH_SECONDS
from agglom_mpi.search.ending import Generations
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN

COSTLY = MessageCosts(2e-3, 150e-6, 40e-6, 10e-6)
ROUNDING = 1e-9
"""Times are sums of at most some thousand numbers of one sign."""


class Drawn:
    """Random outcomes; times that scatter over decades from string to string and by half that
    from sample to sample, or that are all the same."""

    def __init__(self, decades=0.0, seed=0, typical=0.01):
        self.decades, self.seed, self.typical = decades, seed, typical

    def samples(self, parameters, first, count):
        drawn = [self.sample(parameters, number) for number in range(first, first + count)]
        return rows_of([outcome for outcome, _ in drawn]), np.array([time for _, time in drawn])

    def sample(self, parameters, sample):
        # Of the parameters, as a simulation: a string may not know its number.
        key = int(parameters[0] * 2**53)
        slow = np.random.default_rng([self.seed, key]).random()
        rng = np.random.default_rng([self.seed, key, sample + 1])
        ratio = 1.0 + parameters[1] + 0.1 * rng.normal()
        seconds = self.typical * 10.0 ** (self.decades * (slow + 0.5 * rng.random()))
        return SampleSummary(True, ratio, 50, (0.0, 0.0, 0.0), 1, 0), seconds


def cluster(ranks, costs=FREE, workload=None, population=20, generations=3, most=30):
    search = genetic_search(
        SearchSpace(np.zeros(TEN.count), np.ones(TEN.count)),
        seed=5,
        population=population,
        parents=population // 4 * 2,
    )
    inversion = Inversion(
        search,
        lambda string: ensemble_of(difference(0.003), growth_target(), 100, 2, most),
        Generations(generations=generations),
    )

    return ClusterSimulator(inversion, workload or Drawn(), ranks, costs)


@pytest.mark.parametrize("decades", [0.0, 2.0])
def test_a_lone_rank_without_costs_simulates_all_the_time(decades):
    # Samples so long that no batch holds two, and none is begun that is not needed.
    forecast = cluster(1, workload=Drawn(decades, typical=BATCH_SECONDS)).run()
    assert forecast.busy == pytest.approx(1.0, rel=ROUNDING)
    assert forecast.used == forecast.simulated
    assert forecast.seconds == pytest.approx(forecast.work)


@examples(
    40,
    ranks=st.integers(1, 30),
    population=st.integers(4, 12),
    decades=st.floats(0.0, 4.0),
    seed=st.integers(0, 1000),
    latency=st.sampled_from([0.0, 1e-3, 0.1]),
)
def test_no_scheduler_beats_the_bound_and_no_rank_works_all_the_time_and_more(
    ranks, population, decades, seed, latency
):
    forecast = cluster(
        ranks, MessageCosts(latency, 0.0, 0.0), Drawn(decades, seed), population, most=20
    ).run()
    assert forecast.bound <= forecast.seconds * (1.0 + ROUNDING)
    assert forecast.work <= forecast.busy * forecast.seconds * ranks * (1.0 + ROUNDING)
    assert forecast.busy <= 1.0 + ROUNDING
    assert forecast.used <= forecast.simulated


def test_two_ranks_are_faster_than_one_but_not_more_than_twice():
    one, two = (cluster(ranks, workload=Drawn(1.0)).run() for ranks in (1, 2))
    assert 1.5 < one.work / two.seconds <= 2.0
    assert one.work == pytest.approx(two.work, rel=ROUNDING)


def test_the_number_of_ranks_decides_nothing():
    runs = [
        cluster(ranks, costs, Drawn(2.0)) for ranks, costs in ((1, FREE), (7, COSTLY), (500, FREE))
    ]
    forecasts = [run.run() for run in runs]
    assert len(runs[0].path.used) == 20 + 2 * 10
    assert all(run.path.used == runs[0].path.used for run in runs)
    assert forecasts[2].simulated > forecasts[0].simulated


def test_latency_makes_it_slower():
    seconds = [
        cluster(4, MessageCosts(latency, 0.0, 0.0)).run().seconds
        for latency in (0.0, 0.01, 0.1, 1.0)
    ]
    assert seconds == sorted(seconds)
    # A generation cannot begin before the results of the one before have travelled, and its tasks.
    assert seconds[3] > seconds[0] + 3 * 2 * 1.0


def test_a_rank_0_that_is_slow_limits_all_ranks():
    forecast = cluster(50, MessageCosts(0.0, 0.02, 0.02)).run()
    assert forecast.limit == "rank 0"
    # It takes every sample that is used, one after the other.
    assert 0.02 * forecast.used <= forecast.seconds
    assert 0.9 < forecast.master <= 1.0 + ROUNDING


def test_ranks_that_need_not_finish_what_is_complete_are_sooner_done(monkeypatch):
    costs = MessageCosts(1e-3, 0.0, 0.0)
    runs = [cluster(60, costs, Drawn(1.0), generations=6) for _ in range(2)]
    forecasts = [runs[0].run()]
    monkeypatch.setattr(virtual.Scheduler, "cancellations", lambda scheduler: [])
    forecasts.append(runs[1].run())
    assert runs[0].path.used == runs[1].path.used
    assert forecasts[0].seconds < forecasts[1].seconds
    assert forecasts[0].wasted < forecasts[1].wasted


def test_equal_samples_of_a_large_population_keep_ten_ranks_at_useful_work():
    forecast = cluster(10, population=300, generations=2).run()
    assert forecast.limit == "work"
    assert 0.9 <= forecast.reached <= 1.0


def test_a_thousand_ranks_are_limited_by_the_longest_samples():
    forecast = cluster(1000, workload=Drawn(3.0)).run()
    assert forecast.limit == "chain"
    assert forecast.bound == forecast.chain


def test_a_forecast_is_given_up_when_it_takes_too_many_samples(monkeypatch):
    monkeypatch.setattr(virtual, "MAX_SIMULATED", 50)
    with pytest.raises(TooManySamples):
        cluster(3).run()


def test_a_forecast_says_what_would_take_longest():
    forecast = Forecast(
        ranks=4, seconds=10.0, busy=0.5, simulated=200, used=150, work=20.0, chain=3.0, master=0.1
    )
    assert (forecast.bound, forecast.reached, forecast.wasted) == (5.0, 0.5, 0.25)
    assert forecast.limit == "work"
    assert forecast._replace(chain=6.0).limit == "chain"
    assert forecast._replace(master=0.7).limit == "rank 0"
    assert math.isclose(forecast._replace(chain=6.0).bound, 6.0)


@pytest.mark.parametrize(
    ("lag", "longest", "seconds"),
    [
        (1, [2.0, 3.0, 0.0, 4.0], 9.0),
        (2, [2.0, 3.0, 0.0, 4.0], 7.0),  # the last waits for the second
        (2, [9.0, 1.0, 1.0, 1.0], 10.0),
        (2, [5.0], 5.0),
    ],
)
def test_a_chain_leads_from_generations_to_those_that_learn_from_them(lag, longest, seconds):
    path = CriticalPath(lag)
    path.dependent = [[string] for string in range(len(longest))]
    needed = {string: [0.0, time] for string, time in enumerate(longest) if time}
    assert path.seconds(needed) == seconds


@pytest.mark.parametrize("ranks", [1, 30])
def test_batches_that_learn_from_the_one_but_last_wait_for_every_second_generation(ranks):
    search = surrogate_search(SearchSpace(np.zeros(TEN.count), np.ones(TEN.count)), 5, 8, 6)
    inversion = Inversion(
        search,
        lambda string: ensemble_of(fixed(1), growth_target(), 100, 1, 1),
        Generations(generations=6),
    )
    same = Drawn()  # all samples take 0.01 s
    run = ClusterSimulator(inversion, same, ranks, FREE, lag=2)
    forecast = run.run()
    assert forecast.used == 8 + 4 * 6
    # 30 ranks hold two generations at once, so that three pairs follow each other.
    assert forecast.chain == pytest.approx(0.03)
    wanted = 0.03 if ranks == 30 else 0.01 * forecast.simulated
    assert forecast.seconds == pytest.approx(wanted)


@pytest.mark.parametrize("ranks", [1, 30])
def test_a_run_that_ends_early_is_a_part_of_the_whole(ranks):
    whole_run, part_run = cluster(ranks, generations=10), cluster(ranks, generations=10)
    whole, part = whole_run.run(), part_run.run(most=500)
    assert part.simulated < whole.simulated
    share = part_run.samples_used / whole.used
    extended = part.extended(share, 10 / (part_run.inversion.generation + 1))
    assert extended.share == share
    assert extended.used == whole.used == whole_run.samples_used
    assert extended.seconds == pytest.approx(whole.seconds, rel=0.3)
    assert extended.bound <= extended.seconds


@pytest.mark.parametrize("message", [1e-3, 3e-3])
def test_what_all_ranks_take_to_begin_is_not_extended(message):
    costs = MessageCosts(latency=1e-3, message=message)
    whole_run, part_run = (cluster(300, costs, generations=10) for _ in range(2))
    whole, part = whole_run.run(), part_run.run(most=1500)
    share = part_run.samples_used / whole.used, 10 / (part_run.inversion.generation + 1)
    errors = [
        abs(part.extended(*share, first).seconds - whole.seconds)
        for first in (None, part_run.first)
    ]
    assert errors[1] < errors[0]


def test_the_progress_is_shown_and_goes_on(monkeypatch):
    monkeypatch.setattr(virtual, "PROGRESS_MESSAGES", 10)
    shown = []
    forecast = cluster(4).run(show=lambda *progress: shown.append(progress))
    generations, samples = zip(*shown, strict=True)
    assert list(generations) == sorted(generations)
    assert list(samples) == sorted(samples)
    assert samples[-1] >= forecast.simulated / 2


def test_messages_grow_until_rank_0_is_below_half_of_its_time(monkeypatch):
    costs = MessageCosts(1e-3, 25e-6, 1e-6)
    runs = [cluster(16, costs, Drawn(typical=4e-4), 100, most=100) for _ in range(2)]
    grown = runs[0].run()
    monkeypatch.setattr(virtual.Scheduler, "_range_limit", lambda scheduler, used: 1)
    monkeypatch.setattr(virtual.Scheduler, "_batch_size", lambda scheduler: 1)
    single = runs[1].run()
    assert grown.used == single.used
    assert grown.master < 0.5
    assert grown.seconds < single.seconds
